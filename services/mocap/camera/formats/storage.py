"""OpenCV's FileStorage, as XML or YAML: one file per camera, and EasyMocap's pair of files for all."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from services.mocap.camera.formats.loose import Loose, LooseCamera, Reader
from services.mocap.camera.formats.parsing import array_of, files_in, has_files, rotation_of, text_of
from services.mocap.errors import CalibrationError
from services.mocap.types import Floats

_SUFFIXES = (".xml", ".yml", ".yaml")
# Names that tools give to values, without capitals and underscores.
_MATRIX = ("cameramatrix", "k", "m", "mtx", "intrinsics", "intrinsicmatrix", "intrinsic", "matrix")
_DISTORTION = (
    "distortioncoefficients", "distortion", "distcoeffs", "distcoef", "dist", "d", "distortions",
)  # fmt: skip
_ROTATION = ("r", "rotationmatrix", "rotation", "rvec", "rotationvector", "rot")
_TRANSLATION = ("t", "translationvector", "translation", "tvec")
_WIDTH, _HEIGHT = ("imagewidth", "width", "w"), ("imageheight", "height", "h")
_SIZE = ("imagesize", "size", "resolution", "framesize")


def read_opencv(path: Path) -> Loose:
    """One camera per file, named like the file: a file, or a folder of them."""
    return Loose([_camera(file) for file in files_in(path, _SUFFIXES)], metres=None)


def _easymocap_pair(path: Path) -> tuple[Path, Path] | None:
    """intri.yml and extri.yml of a folder, or of either file's; also Intrinsic.yml and Extrinsic.yml."""
    folder = path if path.is_dir() else path.parent
    if path.is_file() and not path.name.lower().startswith(("intri", "extri")):
        return None
    files = files_in(folder, _SUFFIXES)
    pair = [
        next((f for f in files if f.name.lower().startswith(begin)), None) for begin in ("intri", "extri")
    ]
    return None if pair[0] is None or pair[1] is None else (pair[0], pair[1])


def read_easymocap(path: Path) -> Loose:
    """intri.yml (K_1, dist_1, perhaps H_1, W_1) and extri.yml (R_1, Rot_1, T_1) of the cameras in names.

    Pose2Sim writes other names into `names` than into the fields, where it counts from 1.
    """
    pair = _easymocap_pair(path)
    if pair is None:
        raise CalibrationError(f"{path}: expected a folder with EasyMocap's intri.yml and extri.yml")
    intri, extri = map(_Storage, pair)
    names = intri.strings("names")
    fields = [name if intri.first((f"K_{name}",)) is not None else str(i + 1) for i, name in enumerate(names)]
    cameras = [_easymocap_camera(intri, extri, *each) for each in zip(names, fields, strict=True)]
    return Loose(cameras, metres=None)


OPENCV = Reader(read_opencv, lambda path: has_files(path, _SUFFIXES), _SUFFIXES)
EASYMOCAP = Reader(
    read_easymocap, lambda path: _easymocap_pair(path) is not None, ("intri.yml with extri.yml",)
)


def _camera(path: Path) -> LooseCamera:
    storage = _Storage(path)
    matrix, rotation, translation = map(storage.first, (_MATRIX, _ROTATION, _TRANSLATION))
    if isinstance(matrix, np.ndarray) and matrix.shape == (3, 4):  # OpenPose's CameraMatrix is the pose
        rotation, translation = matrix[:, :3], matrix[:, 3]
        matrix = storage.first(_MATRIX[1:])
    if rotation is None or translation is None:
        raise CalibrationError(
            f"{path}: has no {'rotation (R or rvec)' if rotation is None else 'translation (T or tvec)'}: "
            "expected the camera's pose, from world to camera, besides its lens"
        )
    if matrix is None:
        raise CalibrationError(f"{path}: camera_matrix: is missing: expected the lens besides the pose")
    return LooseCamera(
        name=path.stem,
        K=array_of(matrix, (3, 3), f"{path}: camera_matrix"),
        distortion=array_of(storage.need(_DISTORTION), (-1,), f"{path}: distortion_coefficients"),
        R=rotation_of(rotation, f"{path}: R"),
        t=array_of(translation, (3,), f"{path}: T"),
        size_px=_size(storage, _WIDTH, _HEIGHT),
        fisheye=str(storage.first(("fisheye",))).lower() in ("1.0", "true", "yes"),
    )


def _easymocap_camera(intri: "_Storage", extri: "_Storage", name: str, field: str) -> LooseCamera:
    rotation = extri.first((f"Rot_{field}",))
    if rotation is None:
        rotation = extri.need((f"R_{field}",))
    return LooseCamera(
        name=name,
        K=array_of(intri.need((f"K_{field}",)), (3, 3), f"{intri.path}: K_{field}"),
        distortion=array_of(intri.need((f"dist_{field}",)), (-1,), f"{intri.path}: dist_{field}"),
        R=rotation_of(rotation, f"{extri.path}: R_{field}"),
        t=array_of(extri.need((f"T_{field}",)), (3,), f"{extri.path}: T_{field}"),
        size_px=_size(intri, (f"W_{field}",), (f"H_{field}",)),
    )


def _size(storage: "_Storage", widths: tuple[str, ...], heights: tuple[str, ...]) -> tuple[int, int] | None:
    width, height = storage.first(widths), storage.first(heights)
    if width is None and height is None:
        both = storage.first(_SIZE)
        if isinstance(both, np.ndarray) and both.size == 2:
            width, height = map(float, both.ravel())
    if isinstance(width, float) and isinstance(height, float) and width > 0 and height > 0:
        return round(width), round(height)
    return None


def _plain(name: str) -> str:
    return name.lower().replace("_", "")


def _numbers(node: Any) -> list[float]:
    """The numbers of a sequence, row by row if it has rows."""
    items = [node.at(i) for i in range(node.size())]
    return [number for item in items for number in (_numbers(item) if item.isSeq() else [item.real()])]


class _Storage:
    """A file's values by name."""

    def __init__(self, path: Path) -> None:
        text = text_of(path)
        self.path = path
        try:
            self._file: Any = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
            self._names = {_plain(name): name for name in self._file.root().keys()}  # noqa: SIM118  (no dict)
        except (cv2.error, SystemError):
            raise CalibrationError(f"{path}: expected a file of OpenCV's FileStorage (XML or YAML)") from None

    def first(self, names: tuple[str, ...]) -> Floats | float | str | None:
        """The value of the first of these names that exists, whatever its capitals and underscores."""
        name = next((self._names[_plain(name)] for name in names if _plain(name) in self._names), None)
        if name is None:
            return None
        node = self._file.getNode(name)
        if node.isMap():
            matrix = node.mat()
            return None if matrix is None else np.asarray(matrix, np.float64)
        if node.isSeq():
            return np.array(_numbers(node))
        return str(node.string()) if node.isString() else float(node.real())

    def need(self, names: tuple[str, ...]) -> Floats | float | str:
        """The same; raises CalibrationError if there is none."""
        value = self.first(names)
        if value is None:
            raise CalibrationError(f"{self.path}: {names[0]}: is missing: expected it in this file")
        return value

    def strings(self, name: str) -> list[str]:
        """A list of strings; raises CalibrationError where there is none."""
        node = self._file.getNode(name) if name in self._names.values() else None
        if node is None or not node.isSeq() or not node.size():
            raise CalibrationError(f"{self.path}: {name}: is missing: expected the list of cameras")
        each = [node.at(i) for i in range(node.size())]
        return [item.string() if item.isString() else f"{item.real():g}" for item in each]
