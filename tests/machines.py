"""Machines as they might be: what stands there for EGL."""

from pathlib import Path

from services.mocap.energy.egl_setup import EglSetup

MESA = EglSetup(
    libegl=Path("/usr/lib/libEGL.so.1"),
    libgl=Path("/usr/lib/libGL.so.1"),
    vendor_files=(Path("/usr/share/glvnd/egl_vendor.d/50_mesa.json"),),
    nvidia_driver=False,
    nvidia_library=None,
    nvidia_vendor_file=None,
    capabilities=None,
    overriding=None,
    mesa_is_whole=True,
    mesa_card="",
    render_nodes=(),
    closed_nodes=(),
)
"""Without a GPU, with all of Mesa."""
