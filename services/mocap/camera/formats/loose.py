"""A camera from another tool's file: perhaps without a size, in any unit and world."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from services.mocap.types import Floats

Axis: TypeAlias = Literal["z", "y", "-y", "-z"]


@dataclass(frozen=True, eq=False)
class LooseCamera:
    """One camera of a file, x_camera = R @ x_world + t, with OpenCV's axes."""

    name: str
    K: Floats
    """(3, 3)"""
    distortion: Floats
    """(n,) OpenCV's coefficients, for any n up to 14."""
    R: Floats
    """(3, 3)"""
    t: Floats
    """(3,) in the file's unit."""
    size_px: tuple[int, int] | None
    fisheye: bool = False


@dataclass(frozen=True, eq=False)
class Loose:
    """All cameras of a file."""

    cameras: list[LooseCamera]
    metres: float | None
    """The format's unit of length; None if the format does not define it."""
    is_scale_arbitrary: bool = False
    """Whether the lengths' size says nothing about their unit."""
    remarks: tuple[str, ...] = ()
    up: Axis = "z"
    """The axis that points up in the format's world, if the user does not say another."""


@dataclass(frozen=True)
class Reader:
    """One format."""

    read: Callable[[Path], Loose]
    """Raises CalibrationError."""
    recognises: Callable[[Path], bool]
    """Whether a file or a folder is of this format."""
    files: tuple[str, ...]
    """The names or suffixes of its files, for an error."""
