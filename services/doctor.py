"""What this machine has: what `xormocap doctor` prints."""

import os
import platform
import sys
import time
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

import av
import numpy as np

from services.launcher import ServiceFailedError, free_endpoint
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.egl_setup import EglSetup
from services.mocap.energy.engine import Engine, open_device, open_engine
from services.mocap.energy.picture import Picture, Region
from services.mocap.energy.settings import EngineSettings
from services.mocap.search.chains import ALL_SEGMENTS
from services.mocap.search.settings import SearchSettings
from services.mocap.search.solve import Model, whole_body_energy
from services.mocap.synth.studio import studio_cameras

if TYPE_CHECKING:
    from services.mocap.energy.gl.device import GlDevice

_LIBRARIES = (
    "numpy",
    "numba",
    "scipy",
    "opencv-contrib-python-headless",
    "pyzmq",
    "moderngl",
    "av",
    "pydantic",
    "trimesh",
)
_TIMED_S = 0.5
_BATCH = 256


@dataclass(frozen=True)
class Check:
    """One thing that was looked at."""

    name: str
    ok: bool
    finding: str


def examine() -> list[Check]:
    """Look at everything that the services need; takes a few seconds, longer the first time."""
    return [
        Check("python", sys.version_info >= (3, 11), f"{platform.python_version()} on {platform.platform()}"),
        Check("cores", True, f"{os.cpu_count()} ({platform.machine()})"),
        _libraries(),
        _h264(),
        _loopback(),
        *_opengl(),
        *_energy(),
    ]


def _libraries() -> Check:
    found, missing = [], []
    for name in _LIBRARIES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            missing.append(name)
    if missing:
        return Check("libraries", False, f"{', '.join(missing)}: run scripts/setup")
    return Check("libraries", True, ", ".join(found))


def _h264() -> Check:
    try:
        av.codec.Codec("libx264", "w")
    except av.error.FFmpegError:
        return Check("H.264", False, "PyAV has no libx264: install the av wheel from PyPI")
    return Check("H.264", True, f"libx264 in PyAV {av.__version__}")


def _loopback() -> Check:
    try:
        return Check("loopback", True, f"three ports in a row are free, such as {free_endpoint()}")
    except ServiceFailedError as error:
        return Check("loopback", False, str(error))


def opengl_checks(setup: EglSetup, device: "GlDevice | str") -> list[Check]:
    """What stands between a program and the GPU; a machine without one lacks nothing that is needed.

    device: OpenGL as it opened, or why it did not.
    """
    vendors = ", ".join(map(str, setup.vendor_files)) or "none"
    lacking = f"no {' and no '.join(setup.lacking)}" if setup.lacking else f"{setup.libegl}"
    checks = [Check("EGL", True, f"{lacking}; vendor files: {vendors}")]
    if setup.nvidia_driver:
        library = setup.nvidia_library or "no library for EGL"
        vendor_file = setup.nvidia_vendor_file or "no vendor file"
        checks.append(Check("NVIDIA", True, f"a driver, with {library} and {vendor_file}"))
    if isinstance(device, str):
        checks.append(Check("OpenGL", True, f"none, so that only the cpu backend runs here: {device}"))
    else:
        kind = "hardware" if device.is_hardware else "a software renderer"
        checks.append(
            Check(
                "OpenGL",
                True,
                f"{device.renderer}: {kind}; {device.version}, with compute shaders, fp64 and int64",
            )
        )
    remedy = setup.remedy()
    if remedy and (isinstance(device, str) or not device.is_hardware):
        checks.append(Check("for a GPU", True, remedy))
    return checks


def _opengl() -> list[Check]:
    device = open_device()
    try:
        return opengl_checks(EglSetup.look(), device)
    finally:
        if not isinstance(device, str):
            device.close()


def _energy() -> list[Check]:
    """What auto takes, and the rate of the energy of the whole body before eight cameras of 320x240, as the
    search evaluates it by default."""
    with open_engine(EngineSettings()) as engine, open_engine(EngineSettings(backend="cpu")) as cpu:
        rates = [f"cpu backend, {_rate(cpu, 1):.0f} evaluations per second on one core"]
        if engine.name == "gl":
            one, batch = _rate(engine, 1), _rate(engine, _BATCH)
            rates.append(f"gl backend, {one:.0f} one by one and {batch:.0f} in batches of {_BATCH}")
        return [
            Check("backend", True, f"auto takes {engine.name}: {engine.reason}"),
            Check("energy", True, "; ".join(rates)),
        ]


def _rate(engine: Engine, batch: int) -> float:
    """Evaluations per second."""
    rig, body = Rig.of(studio_cameras()), build_body(Actor())
    backend, poses = engine.backend(body, rig), np.zeros((batch, N_DOF))
    poses[:, DOF_INDEX["root_z"]] = body.pelvis_height_m
    region = Region.whole(rig)
    picture = Picture.whole(rig, backend.coverage(poses[:1], ALL_SEGMENTS, region)[0])
    search = SearchSettings()
    energy = whole_body_energy(Model(body, rig, backend), picture, poses[0], search.cost, search.detail_px)
    energy(poses)
    count, began = 0, time.perf_counter()
    while (elapsed_s := time.perf_counter() - began) < _TIMED_S:
        energy(poses)
        count += batch
    backend.close()
    return count / elapsed_s
