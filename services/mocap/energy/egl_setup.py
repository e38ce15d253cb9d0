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
INDEX_VARIABLE = "GLCONTEXT_DEVICE_INDEX"
"""Where a user says which EGL device to take; glcontext heeds it."""
_FILENAMES, _FOLDERS = "__EGL_VENDOR_LIBRARY_FILENAMES", "__EGL_VENDOR_LIBRARY_DIRS"
"""Environment variables that say where vendor files are."""
_VENDOR_FOLDERS = ("etc/glvnd/egl_vendor.d", "usr/share/glvnd/egl_vendor.d")
_LIBRARY_FOLDERS = (
    *("usr/local/nvidia/lib64", "usr/local/lib", "usr/lib/*-linux-gnu*", "lib/*-linux-gnu*"),
    *("usr/lib64", "usr/lib"),
)
_DRIVERS = ("dri/*_dri.so", "libgallium-*.so")  # of Mesa: one a file, and since 24.2 all in one
_CARDS = {"0x1002": "AMD", "0x8086": "Intel"}  # by PCI's number of the maker
_DISPLAY_CLASS = "0x03"
_WANTED_CAPABILITIES = "graphics,compute,utility"
_exists = os.path.exists
"""Unlike Path.exists, it sees nothing in a folder that may not be looked into."""
_MESA_LIBRARY = "libEGL_mesa.so.0"
_NVIDIA_LIBRARY = "libEGL_nvidia.so.0"
_NVIDIA_VENDOR_FILE = "/usr/share/glvnd/egl_vendor.d/10_nvidia.json"
_NVIDIA_VENDOR_TEXT = (
    '{"file_format_version": "1.0.0", "ICD": {"library_path": "' + _NVIDIA_LIBRARY + '"}}'  # all of the file
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
    mesa_is_whole: bool
    """Whether Mesa's part of EGL and a driver are here, or no vendor file asks for them."""
    mesa_card: str
    """Who made the graphics card that Mesa drives, AMD or Intel; empty without one."""
    render_nodes: tuple[Path, ...]
    """Through which programs reach it."""
    closed_nodes: tuple[Path, ...]
    """Those of them that this user may not open."""

    @classmethod
    def look(cls, root: Path = Path("/"), env: Mapping[str, str] = os.environ) -> "EglSetup":
        """Look below a root folder, in the way that an environment says."""
        folders = _paths(env.get("LD_LIBRARY_PATH")) + _found(root, _LIBRARY_FOLDERS)  # as the loader looks
        nodes = _found(root, ("dev/dri/renderD*",))
        vendors = {path: _text(path) for path in _vendor_files(root, env)}
        of_nvidia = [path for path, content in vendors.items() if "libEGL_nvidia" in content]
        has_mesa = bool(_find(folders, _MESA_LIBRARY)) and _has_mesa_driver(folders, env)
        return cls(
            libegl=_find(folders, "libEGL.so.1"),
            libgl=_find(folders, "libGL.so.1"),
            vendor_files=tuple(vendors),
            nvidia_driver=_exists(root / "proc/driver/nvidia/version")
            or any((root / "dev").glob("nvidia[0-9]*")),
            nvidia_library=_find(folders, _NVIDIA_LIBRARY),
            nvidia_vendor_file=next(iter(of_nvidia), None),
            capabilities=env.get(CAPABILITIES),
            overriding=next((name for name in (_FILENAMES, _FOLDERS) if env.get(name)), None),
            mesa_is_whole=has_mesa or not any("libEGL_mesa" in content for content in vendors.values()),
            mesa_card=_mesa_card(root),
            render_nodes=tuple(nodes),
            closed_nodes=tuple(node for node in nodes if not os.access(node, os.R_OK | os.W_OK)),
        )

    @property
    def gpu(self) -> str:
        """Who made the GPU that is here: NVIDIA, AMD or Intel; empty where none is seen."""
        return "NVIDIA" if self.nvidia_driver else self.mesa_card

    @property
    def lacking(self) -> list[str]:
        """The libraries without which there is no OpenGL at all."""
        named = (("libEGL.so.1", self.libegl), ("libGL.so.1", self.libgl))
        return [name for name, path in named if path is None]

    def remedy(self) -> str:
        """What to do so that programs find the drivers, as a sentence; empty where nothing seems amiss."""
        parts = [self._nvidia_remedy() if self.nvidia_driver else self._node_remedy()]
        if self.lacking or not self.vendor_files or not self.mesa_is_whole:
            parts.insert(0, f"run apt-get install --no-install-recommends {PACKAGES}")
        return "; ".join(part for part in parts if part)

    def _node_remedy(self) -> str:
        """What stands between an AMD or Intel card and programs."""
        if not self.mesa_card:
            return ""
        if not self.render_nodes:
            return (
                f"the {self.mesa_card} GPU has no /dev/dri/renderD128: start the container with --device "
                "/dev/dri, or without a container load the card's kernel driver"
            )
        if len(self.closed_nodes) == len(self.render_nodes):
            node = self.closed_nodes[0]
            return (
                f"you may not open {node}: run sudo usermod -aG render $USER and log in again, or start the "
                f"container with --group-add $(stat -c %g {node})"
            )
        return ""

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


def _paths(listed: str | None) -> list[Path]:
    """The paths of an environment variable."""
    return [Path(name) for name in (listed or "").split(":") if name]


def _found(root: Path, patterns: Iterable[str]) -> list[Path]:
    return [path for pattern in patterns for path in sorted(root.glob(pattern))]


def _find(folders: Iterable[Path], name: str) -> Path | None:
    """The first file of that name."""
    return next((folder / name for folder in folders if _exists(folder / name)), None)


def _has_mesa_driver(folders: Iterable[Path], env: Mapping[str, str]) -> bool:
    """Whether Mesa has any driver: without one its part of EGL has nothing that draws."""
    named = any(_found(folder, ("*_dri.so",)) for folder in _paths(env.get("LIBGL_DRIVERS_PATH")))
    return named or any(_found(folder, _DRIVERS) for folder in folders)


def _vendor_files(root: Path, env: Mapping[str, str]) -> list[Path]:
    """As libglvnd finds them: files named in the environment, or else those of folders named there, or else
    those of the usual folders, by name."""
    if env.get(_FILENAMES):
        return [path for path in _paths(env[_FILENAMES]) if _exists(path)]
    folders = _paths(env.get(_FOLDERS)) or [root / folder for folder in _VENDOR_FOLDERS]
    return [path for folder in folders for path in _found(folder, ("*.json",))]


def _mesa_card(root: Path) -> str:
    """Who made the graphics card that Mesa drives, AMD or Intel; empty without one."""
    for device in _found(root, ("sys/bus/pci/devices/*",)):
        maker = _CARDS.get(_text(device / "vendor").strip())
        if maker and _text(device / "class").startswith(_DISPLAY_CLASS):
            return maker
    return ""


def _text(path: Path) -> str:
    """A file's text; empty where it cannot be read."""
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""
