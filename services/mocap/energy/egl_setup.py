"""What a machine has for OpenGL without a window, as its files tell: libraries, vendor files, a driver.

Nothing is loaded here. People trip over what lies between driver and program: libEGL asks vendor files which
drivers there are, and a container gets NVIDIA's only when it asks for `graphics`. Where one of these is
missing a program gets a software renderer and is told nothing.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from services.mocap.energy.egl_files import (
    FILENAMES,
    FOLDERS,
    exists,
    find,
    library_folders,
    may_be_opened,
    mesa_card,
    mesa_driver,
    render_nodes,
    text,
    vendor_files,
)

PACKAGES = "libegl1 libgl1 libgl1-mesa-dri"
"""What Debian and Ubuntu call libEGL, libGL and Mesa's drivers."""
CAPABILITIES = "NVIDIA_DRIVER_CAPABILITIES"
INDEX_VARIABLE = "GLCONTEXT_DEVICE_INDEX"
"""Where a user says which EGL device to take; glcontext heeds it."""
_WANTED_CAPABILITIES = "graphics,compute,utility"
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
        folders, nodes = library_folders(root, env), render_nodes(root)
        vendors = {path: text(path) for path in vendor_files(root, env)}
        of_nvidia = [path for path, content in vendors.items() if "libEGL_nvidia" in content]
        has_mesa = bool(find(folders, _MESA_LIBRARY) and mesa_driver(folders, env))
        return cls(
            libegl=find(folders, "libEGL.so.1"),
            libgl=find(folders, "libGL.so.1"),
            vendor_files=tuple(vendors),
            nvidia_driver=exists(root / "proc/driver/nvidia/version")
            or any((root / "dev").glob("nvidia[0-9]*")),
            nvidia_library=find(folders, _NVIDIA_LIBRARY),
            nvidia_vendor_file=next(iter(of_nvidia), None),
            capabilities=env.get(CAPABILITIES),
            overriding=next((name for name in (FILENAMES, FOLDERS) if env.get(name)), None),
            mesa_is_whole=has_mesa or not any("libEGL_mesa" in content for content in vendors.values()),
            mesa_card=mesa_card(root),
            render_nodes=tuple(nodes),
            closed_nodes=tuple(node for node in nodes if not may_be_opened(node)),
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
