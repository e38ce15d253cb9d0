"""What figures were measured on."""

import os
import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from services.mocap.energy.engine import find_device

_PACKAGES = ("numpy", "numba", "moderngl", "opencv-contrib-python-headless", "pyrender")


@dataclass(frozen=True)
class Machine:
    """A machine and its software."""

    cores: int | None
    cpu: str
    python: str
    gl_renderer: str | None
    gl_version: str | None
    versions: dict[str, str]

    def __str__(self) -> str:
        return f"{self.cpu}, {self.cores} cores; OpenGL: {self.gl_renderer or 'none'}; Python {self.python}"


def this_machine() -> Machine:
    """The one that this runs on."""
    gl_renderer = gl_version = None
    device = find_device().device
    if device is not None:
        gl_renderer, gl_version = device.renderer, device.version
        device.close()
    return Machine(os.cpu_count(), _cpu(), platform.python_version(), gl_renderer, gl_version, _installed())


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()


def _installed() -> dict[str, str]:
    found = {}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
