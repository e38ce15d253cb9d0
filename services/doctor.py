"""What this machine has: what `xormocap doctor` prints."""

import os
import platform
import sys
import time
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

import av
import numpy as np

from services.launcher import ServiceFailedError, free_endpoint
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.search.chains import ALL_SEGMENTS
from services.mocap.synth.studio import studio_cameras

_LIBRARIES = (
    "numpy",
    "numba",
    "scipy",
    "opencv-contrib-python-headless",
    "pyzmq",
    "av",
    "pydantic",
    "trimesh",
)
_TIMED_S = 0.5


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
        _energy(),
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


def _energy() -> Check:
    """The rate of the energy of the whole body before eight cameras of 320x240."""
    rig, body = Rig.of(studio_cameras()), build_body(Actor())
    backend, pose = CpuBackend(body, rig), np.zeros((1, N_DOF))
    pose[0, 2] = body.pelvis_height_m
    region = Region.whole(rig)
    picture = Picture.whole(rig, backend.coverage(pose, ALL_SEGMENTS, region)[0])
    energy = backend.energy(Problem(pose[0], tuple(range(N_DOF)), ALL_SEGMENTS, picture))
    energy(pose)
    count, began = 0, time.perf_counter()
    while (elapsed_s := time.perf_counter() - began) < _TIMED_S:
        energy(pose)
        count += 1
    return Check("energy", True, f"cpu backend, {count / elapsed_s:.0f} evaluations per second on one core")
