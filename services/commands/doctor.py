"""`xormocap doctor`: checks what this machine has."""

import os
import platform
import sys
import time
from dataclasses import dataclass
from enum import Enum
from importlib.metadata import PackageNotFoundError, version

import av
import numpy as np
from rich.markup import escape
from rich.table import Table

from services.commands.consoles import stdout
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.egl_setup import EglSetup
from services.mocap.energy.engine import Engine, Found, find_device, open_engine
from services.mocap.energy.picture import Picture, Region
from services.mocap.energy.settings import EngineSettings
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import whole_body_energy
from services.mocap.synth.studio import studio_cameras
from services.runs import ServiceFailedError
from services.runs.launcher import free_endpoint

_LIBRARIES = (
    *("numpy", "numba", "scipy", "opencv-contrib-python-headless", "pyzmq"),
    *("moderngl", "av", "pydantic", "trimesh"),
)
_TIMED_S = 0.5
_BATCH = 256


class State(Enum):
    """What a finding means for tracking."""

    OK = "[green]ok[/]"
    HINT = "[yellow]hint[/]"
    """Everything works, but would be faster after a fix."""
    MISSING = "[red]missing[/]"


@dataclass(frozen=True)
class Check:
    """One check."""

    name: str
    state: State
    finding: str


def examine() -> list[Check]:
    """Check everything that the services need; takes a few seconds, longer the first time."""
    python = f"{platform.python_version()} on {platform.platform()}"
    found = find_device()
    try:
        opengl = opengl_checks(EglSetup.look(), found)
    finally:
        if found.device is not None:
            found.device.close()
    with open_engine(EngineSettings()) as engine, open_engine(EngineSettings(backend="cpu")) as cpu:
        energy = energy_checks(engine, cpu)
    return [
        Check("python", State.OK, python),
        Check("cores", State.OK, f"{os.cpu_count()} ({platform.machine()})"),
        _libraries(),
        _h264(),
        _loopback(),
        *opengl,
        *energy,
    ]


def _libraries() -> Check:
    found, missing = [], []
    for name in _LIBRARIES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            missing.append(name)
    if missing:
        return Check("libraries", State.MISSING, f"{', '.join(missing)}: run scripts/setup")
    return Check("libraries", State.OK, ", ".join(found))


def _h264() -> Check:
    try:
        av.codec.Codec("libx264", "w")
    except av.error.FFmpegError:
        return Check("H.264", State.MISSING, "PyAV has no libx264: install the av wheel from PyPI")
    return Check("H.264", State.OK, f"libx264 in PyAV {av.__version__}")


def _loopback() -> Check:
    try:
        return Check("loopback", State.OK, f"three ports in a row are free, such as {free_endpoint()}")
    except ServiceFailedError as error:
        return Check("loopback", State.MISSING, str(error))


def opengl_checks(setup: EglSetup, found: Found) -> list[Check]:
    """Checks of OpenGL on the GPU; a machine without a GPU lacks nothing that is required."""
    device, vendors = found.device, ", ".join(map(str, setup.vendor_files)) or "none"
    lacking = f"no {' and no '.join(setup.lacking)}" if setup.lacking else f"{setup.libegl}"
    checks = [Check("EGL", State.OK, f"{lacking}; vendor files: {vendors}")]
    if setup.nvidia_driver:
        library = setup.nvidia_library or "no EGL library"
        vendor_file = setup.nvidia_vendor_file or "no vendor file"
        checks.append(Check("NVIDIA", State.OK, f"driver found, with {library} and {vendor_file}"))
    if device is None:
        finding = f"none, so only the cpu backend runs here: {found.problem}"
    else:
        kind = "hardware" if device.is_hardware else "a software renderer"
        finding = (
            f"device {device.index}, {device.renderer}: {kind}; {device.version}, with compute shaders, fp64 "
            "and int64"
        )
    checks.append(Check("OpenGL", State.OK, finding))
    if device is not None and device.is_hardware:
        return checks
    wanting = [part for part in (found.problem if device else "", setup.remedy()) if part]
    return [*checks, *(Check("for a GPU", State.HINT, part) for part in wanting)]


def energy_checks(engine: Engine, cpu: Engine) -> list[Check]:
    """The backend that auto chooses, and the evaluation rates of the whole body in eight cameras of 320x240
    with default settings: of cpu, and of the GPU unless it fails."""
    state, chosen = State.OK, engine.name
    rates = [f"cpu backend, {_rate(cpu, 1):.0f} evaluations per second on one core"]
    if chosen != "cpu":
        one, batch = _rate(engine, 1), _rate(engine, _BATCH)
        if engine.name == chosen:
            rates.append(f"{chosen} backend, {one:.0f} one by one and {batch:.0f} in batches of {_BATCH}")
        else:
            state = State.HINT
    return [
        Check("backend", state, f"auto chooses {engine.name}: {engine.reason}"),
        Check("energy", State.OK, "; ".join(rates)),
    ]


def _rate(engine: Engine, batch: int) -> float:
    """Evaluations per second."""
    rig, body = Rig.of(studio_cameras()), build_body(Actor())
    backend, poses = engine.backend(body, rig), np.zeros((batch, N_DOF))
    poses[:, DOF_INDEX["root_z"]] = body.pelvis_height_m
    region = Region.whole(rig)
    picture = Picture.whole(rig, backend.coverage(poses[:1], ALL_SURFACES, region)[0])
    search = SearchSettings()
    energy = whole_body_energy(Model(body, rig, backend), picture, search)
    energy(poses)
    count, began = 0, time.perf_counter()
    while (elapsed_s := time.perf_counter() - began) < _TIMED_S:
        energy(poses)
        count += batch
    backend.close()
    return count / elapsed_s


def doctor() -> None:
    """List what this machine has, and what is missing."""
    table, checks = Table(show_header=False, box=None), examine()
    for check in checks:
        table.add_row(check.state.value, check.name, escape(check.finding))
    stdout.print(table)
    if any(check.state is State.MISSING for check in checks):
        sys.exit(1)
