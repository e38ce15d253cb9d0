"""OpenCap's calibrations: a .pickle per camera, in millimetres. They are read without running what they name.

OpenCap's board stands upright, so that its y axis points down.
"""

import pickle  # noqa: TID251  (of what a file names, nothing is looked up or run)
from io import BytesIO
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from services.mocap.camera.formats.loose import Loose, LooseCamera, Reader
from services.mocap.camera.formats.parsing import array_of, files_in, has_suffix, rotation_of
from services.mocap.errors import CalibrationError
from services.mocap.types import Floats

_SUFFIXES = (".pickle",)
_NUMBERS = "fiu"
_COMMON_NAME = "cameraIntrinsicsExtrinsics"
"""OpenCap's name of every file, each in the folder of its camera."""


def read_opencap(path: Path) -> Loose:
    """One camera per file, named like the file, or like its folder."""
    remark = f"{path}: OpenCap's world is that of its board, whose y axis points down: --its-up -y is assumed"
    return Loose([_camera(file) for file in _files(path)], metres=1e-3, remarks=(remark,), up="-y")


OPENCAP = Reader(
    read_opencap, lambda path: any(has_suffix(file, _SUFFIXES) for file in _files(path)), _SUFFIXES
)


def _files(path: Path) -> list[Path]:
    """The files of a session: a file, those in a folder, or those in the folders in it."""
    return files_in(path, _SUFFIXES) or sorted(path.rglob(f"{_COMMON_NAME}.pickle"))


def _camera(path: Path) -> LooseCamera:
    fields = _load(path)

    def numbers(name: str, shape: tuple[int, ...]) -> Floats:
        if name not in fields:
            raise CalibrationError(f"{path}: {name}: is missing: expected a calibration of OpenCap")
        return array_of(fields[name], shape, f"{path}: {name}")

    height, width = numbers("imageSize", (2,))
    return LooseCamera(
        name=path.parent.name if path.stem == _COMMON_NAME else path.stem,
        K=numbers("intrinsicMat", (3, 3)),
        distortion=numbers("distortion", (-1,)),
        R=rotation_of(numbers("rotation", (3, 3)), f"{path}: rotation"),
        t=numbers("translation", (3,)),
        size_px=(round(width), round(height)),
    )


class _Inert:
    """Stands for an object of NumPy that a pickle describes; keeps what it is told, and does nothing."""

    def __init__(self, *told: Any) -> None:
        self.told = told
        self.state: Any = ()

    def __setstate__(self, state: Any) -> None:
        self.state = state


_NUMPY: dict[str, type[Any]] = {
    name: type(name, (_Inert,), {}) for name in ("_reconstruct", "_frombuffer", "scalar", "ndarray", "dtype")
}
"""A stand-in for each of the names that NumPy's pickles use."""


class _Reader(pickle.Unpickler):
    """Knows arrays and numbers of NumPy, as inert objects, and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        if module.partition(".")[0] == "numpy" and name in _NUMPY:
            return _NUMPY[name]
        if (module, name) == ("_codecs", "encode"):
            return _latin  # how older protocols write bytes
        raise pickle.UnpicklingError(f"names {module}.{name}")


def _latin(text: object, encoding: object = "latin1") -> bytes:
    if not isinstance(text, str) or encoding != "latin1":
        raise pickle.UnpicklingError("has bytes in an unknown encoding")
    return text.encode("latin1")


def _load(path: Path) -> dict[str, Any]:
    """The file's fields, with arrays for NumPy's objects; raises CalibrationError."""

    def refuse(why: str) -> NoReturn:
        raise CalibrationError(f"{path}: {why}: expected a calibration of OpenCap, numbers and arrays only")

    try:
        content = _Reader(BytesIO(path.read_bytes())).load()
        if not isinstance(content, dict):
            refuse("holds no table of fields")
        return {str(name): _as_numbers(value) for name, value in content.items()}
    except OSError as problem:
        refuse(f"cannot be read ({problem.strerror})")
    except Exception as problem:  # a damaged pickle can raise anything
        if isinstance(problem, CalibrationError):
            raise
        refuse(f"is no such pickle ({str(problem)[:80]})")


def _as_numbers(value: Any) -> Any:
    """An array for an inert object; other values as they are. Raises ValueError for one without numbers."""
    if isinstance(value, _NUMPY["_reconstruct"]):
        _, shape, dtype, is_fortran, data = value.state
        return _array(data, dtype, shape, "F" if is_fortran else "C")
    if isinstance(value, _NUMPY["_frombuffer"]):
        data, dtype, shape, order = value.told
        return _array(data, dtype, shape, order)
    if isinstance(value, _NUMPY["scalar"]):
        dtype, data = value.told
        return _array(data, dtype, (), "C")
    return value


def _array(data: Any, dtype: _Inert, shape: Any, order: Any) -> Floats:
    """dtype: told are the code, such as f8, and two flags; the state's second item is the order of bytes."""
    code, byte_order = dtype.told[0], dtype.state[1] if len(dtype.state) > 1 else "|"
    if not isinstance(code, str) or code[:1] not in _NUMBERS:
        raise ValueError(f"has an array of {code}")
    kind = np.dtype(code).newbyteorder(">" if byte_order == ">" else "<")
    values = np.frombuffer(bytes(data), kind).astype(np.float64)
    return np.asarray(values.reshape(shape, order="F" if order == "F" else "C"), np.float64)
