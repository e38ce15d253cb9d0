"""Files, text, XML and numbers of all formats; what is wrong with them is a CalibrationError."""

from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers.expat import ExpatError, ParserCreate

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.errors import CalibrationError, in_short
from services.mocap.types import Floats

_NEAR_ROTATION = 0.01


def has_suffix(path: Path, suffixes: tuple[str, ...]) -> bool:
    """Whether the name ends in one of the suffixes, which are in lower case."""
    return path.name.lower().endswith(suffixes)


def files_in(path: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """A file, whatever its suffix, or those in a folder that have one of the suffixes."""
    if not path.is_dir():
        return [path]
    return sorted(file for file in path.iterdir() if file.is_file() and has_suffix(file, suffixes))


def has_files(path: Path, suffixes: tuple[str, ...]) -> bool:
    """Whether a file has one of the suffixes, or any file in a folder has."""
    return any(has_suffix(file, suffixes) for file in files_in(path, suffixes))


def array_of(value: object, shape: tuple[int, ...], where: str) -> Floats:
    """Numbers from a file in a shape, -1 for any length; raises CalibrationError, beginning with where."""
    try:
        reshaped = np.asarray(value, np.float64).reshape(shape)
    except (TypeError, ValueError):
        numbers = "a number" if shape == () else "numbers" if shape == (-1,) else f"numbers of shape {shape}"
        raise CalibrationError(f"{where}: expected {numbers}, found {in_short(value)}") from None
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
