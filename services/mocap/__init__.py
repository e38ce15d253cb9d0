"""The motion-capture library that the services share: no sockets, no processes, no global state.

Conventions everywhere inside: metres, radians, seconds; right-handed world with z up; the body's own
frame has x forward, y to its left, z up; pixel centres lie at whole coordinates (OpenCV's convention).
A y-up take is converted to z-up when it is read, and back when results are written.

For notebooks: `from services.mocap import load_result, open_take, draw_frame`, and the names of what their
arrays hold: DOF_NAMES, JOINT_NAMES, SEGMENT_NAMES, REFERENCE_JOINTS, PARTS.
To fit and track: services.library.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from services.mocap.compiled import keep_compiled_code

keep_compiled_code()

if TYPE_CHECKING:
    from services.mocap.body.skeleton import DOF_NAMES, JOINT_NAMES, SEGMENT_NAMES
    from services.mocap.export.overlay import draw_frame
    from services.mocap.result.result import Result, load_result
    from services.mocap.take.folder import Take, open_take
    from services.mocap.take.marks import PARTS
    from services.mocap.take.tables import REFERENCE_JOINTS

_HOMES = {
    "load_result": "result.result",
    "Result": "result.result",
    "open_take": "take.folder",
    "Take": "take.folder",
    "draw_frame": "export.overlay",
    "DOF_NAMES": "body.skeleton",
    "JOINT_NAMES": "body.skeleton",
    "SEGMENT_NAMES": "body.skeleton",
    "REFERENCE_JOINTS": "take.tables",
    "PARTS": "take.marks",
}
__all__ = [
    "DOF_NAMES",
    "JOINT_NAMES",
    "PARTS",
    "REFERENCE_JOINTS",
    "SEGMENT_NAMES",
    "Result",
    "Take",
    "draw_frame",
    "load_result",
    "open_take",
]


def __getattr__(name: str) -> object:
    """Names for notebooks, imported lazily, because services need other parts of the library."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
