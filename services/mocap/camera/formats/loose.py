"""A camera from another tool's file: perhaps without a size, in any unit and world."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers.expat import ExpatError, ParserCreate

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.errors import CalibrationError
from services.mocap.types import Floats

_NEAR_ROTATION = 0.01
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
    remarks: tuple[str, ...] = ()
    up: Axis = "z"
    """The axis that points up in the format's world, if the user does not say another."""


def array_of(value: object, shape: tuple[int, ...], where: str) -> Floats:
    """Numbers from a file in a shape, -1 for any length; raises CalibrationError, beginning with where."""
    try:
        reshaped = np.asarray(value, np.float64).reshape(shape)
    except (TypeError, ValueError):
        raise CalibrationError(f"{where}: expected numbers of shape {shape}, found something else") from None
    if not np.isfinite(reshaped).all():
        raise CalibrationError(f"{where}: expected finite numbers")
    return reshaped


def rotation_of(value: object, where: str) -> Floats:
    """A rotation (3, 3) from a rotation vector or a matrix; raises CalibrationError where it is neither."""
    array = array_of(value, (-1,), where)
    if array.size == 3:
        return np.asarray(Rotation.from_rotvec(array).as_matrix(), np.float64)
    if array.size != 9:
        raise CalibrationError(f"{where}: expected a rotation vector of 3 numbers or a matrix of 3x3")
    R = array.reshape(3, 3)
    if not np.allclose(R @ R.T, np.eye(3), atol=_NEAR_ROTATION) or np.linalg.det(R) < 0:
        raise CalibrationError(f"{where}: is not a rotation: export it again from the calibration tool")
    return np.asarray(Rotation.from_matrix(R).as_matrix(), np.float64)


def text_of(path: Path) -> str:
    """A file's text; raises CalibrationError where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise CalibrationError(f"{path}: is missing: expected a calibration file") from None
    except (OSError, UnicodeDecodeError):
        raise CalibrationError(f"{path}: cannot be read: expected a calibration in text") from None


def xml_root(path: Path, tool: str) -> Element:
    """The root element of the file of a tool; a document type is refused, so that there are no entities."""
    builder, parser = TreeBuilder(), ParserCreate()

    def refuse(*_: object) -> None:
        raise CalibrationError(
            f"{path}: declares a document type (<!DOCTYPE>): expected the calibration that {tool} exports, "
            "which has none"
        )

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    try:
        parser.Parse(text_of(path), True)
    except ExpatError:
        raise CalibrationError(f"{path}: is not XML: expected the calibration that {tool} exports") from None
    return builder.close()
