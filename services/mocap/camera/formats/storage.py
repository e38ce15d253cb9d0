"""OpenCV's FileStorage, as XML or YAML: one file per camera, and EasyMocap's pair of files for all."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from services.mocap.camera.formats.loose import Loose, LooseCamera, array_of, rotation_of, text_of
from services.mocap.errors import CalibrationError
from services.mocap.types import Floats

STORAGE_SUFFIXES = (".xml", ".yml", ".yaml")
INTRI, EXTRI = "intri.yml", "extri.yml"
_MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "M", "intrinsics")
_DISTORTION = ("distortion_coefficients", "Distortion_Coefficients", "dist_coeffs", "distCoeffs", "dist", "D")
_ROTATION = ("R", "rotation_matrix", "rotation", "rvec", "Rot")
_TRANSLATION = ("T", "translation_vector", "translation", "tvec", "t")
_WIDTH, _HEIGHT = ("image_width", "image_Width", "width"), ("image_height", "image_Height", "height")


def read_opencv(path: Path) -> Loose:
    """One camera per file, named like the file: a file, or a folder of them."""
    files = (
        sorted(f for f in path.iterdir() if f.suffix.lower() in STORAGE_SUFFIXES) if path.is_dir() else [path]
    )
    return Loose([_camera(file) for file in files], None)


def read_easymocap(folder: Path) -> Loose:
    """intri.yml (K_1, dist_1, perhaps H_1, W_1) and extri.yml (R_1, Rot_1, T_1) of the cameras in names."""
    intri, extri = _Storage(folder / INTRI), _Storage(folder / EXTRI)
    return Loose([_easymocap_camera(intri, extri, name) for name in intri.strings("names")], 1.0)


def _camera(path: Path) -> LooseCamera:
    storage = _Storage(path)
    rotation, translation = storage.first(_ROTATION), storage.first(_TRANSLATION)
    if rotation is None or translation is None:
        raise CalibrationError(
            f"{path}: has no {'rotation (R or rvec)' if rotation is None else 'translation (T or tvec)'}: "
            "expected the camera's pose, from world to camera, besides its lens"
        )
    return LooseCamera(
        name=path.stem,
        K=array_of(storage.need(_MATRIX), (3, 3), f"{path}: {_MATRIX[0]}"),
        distortion=array_of(storage.need(_DISTORTION), (-1,), f"{path}: {_DISTORTION[0]}"),
        R=rotation_of(rotation, f"{path}: R"),
        t=array_of(translation, (3,), f"{path}: T"),
        size_px=_size(storage, _WIDTH, _HEIGHT),
        fisheye=storage.first(("fisheye",)) not in (None, 0, "false"),
    )


def _easymocap_camera(intri: "_Storage", extri: "_Storage", name: str) -> LooseCamera:
    rotation = extri.first((f"Rot_{name}",))
    if rotation is None:
        rotation = extri.need((f"R_{name}",))
    return LooseCamera(
        name=name,
        K=array_of(intri.need((f"K_{name}",)), (3, 3), f"{intri.path}: K_{name}"),
        distortion=array_of(intri.need((f"dist_{name}",)), (-1,), f"{intri.path}: dist_{name}"),
        R=rotation_of(rotation, f"{extri.path}: R_{name}"),
        t=array_of(extri.need((f"T_{name}",)), (3,), f"{extri.path}: T_{name}"),
        size_px=_size(intri, (f"W_{name}",), (f"H_{name}",)),
    )


def _size(storage: "_Storage", widths: tuple[str, ...], heights: tuple[str, ...]) -> tuple[int, int] | None:
    width, height = storage.first(widths), storage.first(heights)
    if isinstance(width, float) and isinstance(height, float) and width > 0 and height > 0:
        return round(width), round(height)
    return None


class _Storage:
    """A file's values by name."""

    def __init__(self, path: Path) -> None:
        text = text_of(path)
        self.path = path
        try:
            self._file: Any = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
            self._names = set(self._file.root().keys())
        except (cv2.error, SystemError):
            raise CalibrationError(f"{path}: expected a file of OpenCV's FileStorage (XML or YAML)") from None

    def first(self, names: tuple[str, ...]) -> Floats | float | str | None:
        """The value of the first of these names that exists."""
        name = next((name for name in names if name in self._names), None)
        if name is None:
            return None
        node = self._file.getNode(name)
        if node.isMap():
            matrix = node.mat()
            return None if matrix is None else np.asarray(matrix, np.float64)
        if node.isSeq():
            return np.array([node.at(i).real() for i in range(node.size())])
        return str(node.string()) if node.isString() else float(node.real())

    def need(self, names: tuple[str, ...]) -> Floats | float | str:
        """The same; raises CalibrationError if there is none."""
        value = self.first(names)
        if value is None:
            raise CalibrationError(f"{self.path}: {names[0]}: is missing: expected it in this file")
        return value

    def strings(self, name: str) -> list[str]:
        """A list of strings; raises CalibrationError where there is none."""
        node = self._file.getNode(name) if name in self._names else None
        if node is None or not node.isSeq() or not node.size():
            raise CalibrationError(f"{self.path}: {name}: is missing: expected the list of cameras")
        each = [node.at(i) for i in range(node.size())]
        return [item.string() if item.isString() else f"{item.real():g}" for item in each]
