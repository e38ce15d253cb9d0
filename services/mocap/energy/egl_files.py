"""Looking for libraries, vendor files and graphics cards below a root folder."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

FILENAMES, FOLDERS = "__EGL_VENDOR_LIBRARY_FILENAMES", "__EGL_VENDOR_LIBRARY_DIRS"
"""Environment variables that say where vendor files are."""
_VENDOR_FOLDERS = ("etc/glvnd/egl_vendor.d", "usr/share/glvnd/egl_vendor.d")
_LIBRARY_FOLDERS = (
    "usr/local/nvidia/lib64",
    "usr/local/lib",
    "usr/lib/*-linux-gnu*",
    "lib/*-linux-gnu*",
    "usr/lib64",
    "usr/lib",
)
_DRIVERS = ("dri/*_dri.so", "libgallium-*.so")  # of Mesa: one a file, and since 24.2 all in one
_CARDS = {"0x1002": "AMD", "0x8086": "Intel"}  # by PCI's number of the maker
_DISPLAY_CLASS = "0x03"


def library_folders(root: Path, env: Mapping[str, str]) -> list[Path]:
    """Where the loader looks, more or less in its order."""
    named = [Path(name) for name in env.get("LD_LIBRARY_PATH", "").split(":") if name]
    return [*named, *(folder for pattern in _LIBRARY_FOLDERS for folder in sorted(root.glob(pattern)))]


def find(folders: Iterable[Path], name: str) -> Path | None:
    """The first file of that name."""
    return next((folder / name for folder in folders if exists(folder / name)), None)


def mesa_driver(folders: Iterable[Path], env: Mapping[str, str]) -> Path | None:
    """One of Mesa's drivers: without any its part of EGL has nothing that draws."""
    named = [Path(name) for name in env.get("LIBGL_DRIVERS_PATH", "").split(":") if name]
    in_named = (path for folder in named for path in sorted(folder.glob("*_dri.so")))
    usual = (path for folder in folders for pattern in _DRIVERS for path in sorted(folder.glob(pattern)))
    return next((path for paths in (in_named, usual) for path in paths), None)


def vendor_files(root: Path, env: Mapping[str, str]) -> list[Path]:
    """As libglvnd finds them: files named in the environment, or else those of folders named there, or else
    those of the usual folders, by name."""
    named = env.get(FILENAMES)
    if named:
        return [Path(name) for name in named.split(":") if exists(Path(name))]
    listed = env.get(FOLDERS)
    folders = [Path(f) for f in listed.split(":")] if listed else [root / f for f in _VENDOR_FOLDERS]
    return [path for folder in folders for path in sorted(folder.glob("*.json"))]


def mesa_card(root: Path) -> str:
    """Who made the graphics card that Mesa drives, AMD or Intel; empty without one."""
    for device in sorted((root / "sys/bus/pci/devices").glob("*")):
        if text(device / "class").startswith(_DISPLAY_CLASS):
            maker = _CARDS.get(text(device / "vendor").strip())
            if maker:
                return maker
    return ""


def render_nodes(root: Path) -> list[Path]:
    """Through which programs without a display reach graphics cards, but for NVIDIA's own driver."""
    return sorted((root / "dev/dri").glob("renderD*"))


def may_be_opened(path: Path) -> bool:
    """Whether this user may read and write a file."""
    return os.access(path, os.R_OK | os.W_OK)


def exists(path: Path) -> bool:
    """Whether there is such a file, as far as this user can see."""
    try:
        return path.exists()
    except OSError:  # a folder that may not be looked into
        return False


def text(path: Path) -> str:
    """A file's text; empty where it cannot be read."""
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""
