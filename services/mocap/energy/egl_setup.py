"""What a machine has for OpenGL without a window, as its files tell: libraries, vendor files, a driver.

Nothing is loaded here. People trip over what lies between driver and program: libEGL asks vendor files which
drivers there are, and a container gets NVIDIA's only when it asks for `graphics`. Where one of these is
missing a program gets a software renderer and is told nothing.
"""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

PACKAGES = "libegl1 libgl1 libgl1-mesa-dri"
"""What Debian and Ubuntu call libEGL, libGL and Mesa's drivers."""
CAPABILITIES = "NVIDIA_DRIVER_CAPABILITIES"
_WANTED_CAPABILITIES = "graphics,compute,utility"
_NVIDIA_LIBRARY = "libEGL_nvidia.so.0"
_NVIDIA_VENDOR_FILE = "/usr/share/glvnd/egl_vendor.d/10_nvidia.json"
_NVIDIA_VENDOR_TEXT = (
    '{"file_format_version": "1.0.0", "ICD": {"library_path": "' + _NVIDIA_LIBRARY + '"}}'  # all of the file
)
_VENDOR_FOLDERS = ("etc/glvnd/egl_vendor.d", "usr/share/glvnd/egl_vendor.d")
_FILENAMES, _FOLDERS = "__EGL_VENDOR_LIBRARY_FILENAMES", "__EGL_VENDOR_LIBRARY_DIRS"
_LIBRARY_FOLDERS = (
    "usr/local/nvidia/lib64",
    "usr/local/lib",
    "usr/lib/*-linux-gnu*",
    "lib/*-linux-gnu*",
    "usr/lib64",
    "usr/lib",
)


@dataclass(frozen=True)
class EglSetup:
    """What was found."""

    libegl: Path | None
    libgl: Path | None
    vendor_files: tuple[Path, ...]
    """In the order in which libEGL asks them."""
    nvidia_driver: bool
    """Whether the kernel has NVIDIA's driver, or the container one of its devices."""
    nvidia_library: Path | None
    """The driver's own part of EGL."""
    nvidia_vendor_file: Path | None
    """The one that names NVIDIA's library."""
    capabilities: str | None
    """What the container asks of NVIDIA's driver; None where nothing is said."""
    overriding: str | None
    """The environment variable that says where vendor files are; None where the usual folders are asked."""

    @classmethod
    def look(cls, root: Path = Path("/"), env: Mapping[str, str] = os.environ) -> "EglSetup":
        """Look below a root folder, in the way that an environment says."""
        folders = _library_folders(root, env)
        vendor_files = tuple(_vendor_files(root, env))
        return cls(
            libegl=_find(folders, "libEGL.so.1"),
            libgl=_find(folders, "libGL.so.1"),
            vendor_files=vendor_files,
            nvidia_driver=_exists(root / "proc/driver/nvidia/version")
            or any((root / "dev").glob("nvidia[0-9]*")),
            nvidia_library=_find(folders, _NVIDIA_LIBRARY),
            nvidia_vendor_file=next((p for p in vendor_files if "libEGL_nvidia" in _text(p)), None),
            capabilities=env.get(CAPABILITIES),
            overriding=next((name for name in (_FILENAMES, _FOLDERS) if env.get(name)), None),
        )

    @property
    def lacking(self) -> list[str]:
        """The libraries without which there is no OpenGL at all."""
        named = (("libEGL.so.1", self.libegl), ("libGL.so.1", self.libgl))
        return [name for name, path in named if path is None]

    def remedy(self) -> str:
        """What to do so that programs find the drivers, as a sentence; empty where nothing seems amiss."""
        parts = [self._nvidia_remedy()] if self.nvidia_driver else []
        if self.lacking or not self.vendor_files:
            parts.insert(0, f"run apt-get install --no-install-recommends {PACKAGES}")
        return "; ".join(part for part in parts if part)

    def _nvidia_remedy(self) -> str:
        """The first step between NVIDIA's driver and libEGL that is missing."""
        granted = {part.strip() for part in (self.capabilities or "").split(",")}
        if self.capabilities is not None and not granted & {"graphics", "all"}:
            return (
                f"start the container with {CAPABILITIES}={_WANTED_CAPABILITIES} "
                f"in its environment: it has {self.capabilities or 'an empty one'}"
            )
        if self.nvidia_library is None:
            return (
                f"NVIDIA's driver is here without {_NVIDIA_LIBRARY}: start the container with {CAPABILITIES}="
                f"{_WANTED_CAPABILITIES} in its environment, or without a container install libnvidia-gl of "
                "the driver's version (on Debian libegl-nvidia0)"
            )
        if self.nvidia_vendor_file is None and self.overriding:
            return f"unset {self.overriding}: what it names does not lead to NVIDIA's driver"
        if self.nvidia_vendor_file is None:
            return f"write {_NVIDIA_VENDOR_TEXT} to {_NVIDIA_VENDOR_FILE}"
        return ""


def _library_folders(root: Path, env: Mapping[str, str]) -> list[Path]:
    named = [Path(name) for name in env.get("LD_LIBRARY_PATH", "").split(":") if name]
    return [*named, *(folder for pattern in _LIBRARY_FOLDERS for folder in sorted(root.glob(pattern)))]


def _find(folders: Iterable[Path], name: str) -> Path | None:
    return next((folder / name for folder in folders if _exists(folder / name)), None)


def _vendor_files(root: Path, env: Mapping[str, str]) -> list[Path]:
    """As libglvnd finds them: files named in the environment, or else those of folders named there, or else
    those of the usual folders, by name."""
    named = env.get(_FILENAMES)
    if named:
        return [Path(name) for name in named.split(":") if _exists(Path(name))]
    listed = env.get(_FOLDERS)
    folders = [Path(f) for f in listed.split(":")] if listed else [root / f for f in _VENDOR_FOLDERS]
    return [path for folder in folders for path in sorted(folder.glob("*.json"))]


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a folder that may not be looked into
        return False


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""
