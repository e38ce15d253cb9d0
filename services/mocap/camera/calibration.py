"""Calibration files in the layout of Pose2Sim and anipose: TOML with one table per camera.

A table holds name, size, matrix, distortions, rotation (world to camera), translation (metres), fisheye.
"""

from collections import Counter
from pathlib import Path
from typing import Annotated, Literal, TypeAlias, TypeVar

import cv2
import numpy as np
import tomli_w
from pydantic import AfterValidator, Field, field_validator, model_validator
from scipy.spatial.transform import Rotation

from services.mocap.atomic import atomic_folder, write_file
from services.mocap.camera.camera import R_ZUP_YUP, Camera, nfc
from services.mocap.errors import CalibrationError, StrictModel, in_short, load_toml, validated
from services.mocap.types import Floats

Up: TypeAlias = Literal["y", "z"]
_Value = TypeVar("_Value")


def _named_as_compared(table: dict[str, _Value]) -> dict[str, _Value]:
    """A table by camera with the names as they are compared; raises ValueError if two are the same."""
    by_camera = {nfc(name): value for name, value in table.items()}
    if len(by_camera) < len(table):
        ((twice, _),) = Counter(map(nfc, table)).most_common(1)
        raise ValueError(
            f"{twice}: two entries have names that look like this one, but are "
            "spelled with different characters (ü, or u and dots): remove one"
        )
    return by_camera


ByCamera: TypeAlias = Annotated[dict[str, _Value], AfterValidator(_named_as_compared)]
"""A table by camera, however a file spells their names."""

_Three: TypeAlias = Annotated[list[float], Field(min_length=3, max_length=3)]
_ThreeByThree: TypeAlias = Annotated[list[_Three], Field(min_length=3, max_length=3)]

_LARGEST_SKEW_PX = 0.1
_ROTATION_TOLERANCE = 1e-3
"""Allowed deviation of a rotation matrix from orthonormal: some files have only four digits."""
_LARGEST_STUDIO_M = 100.0
_EXPORT_AGAIN = "export it again from the calibration tool as a rotation from world to camera"


class _CameraTable(StrictModel):
    """One camera's table; a description states a field's valid values."""

    name: Annotated[str, AfterValidator(nfc)] = Field(
        pattern=r"^[^./\\\x00-\x1f][^/\\\x00-\x1f]*$", description="a name that can be a file's name"
    )
    size: list[float] = Field(
        min_length=2, max_length=2, description="[width, height] in pixels, such as [1920, 1080]"
    )
    matrix: _ThreeByThree = Field(description="the 3x3 camera matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    distortions: list[float] = Field(description="4, 5 or 8 finite numbers (4 for a fisheye lens)")
    rotation: _Three | _ThreeByThree = Field(
        description="3 finite numbers, the rotation vector from world to camera, or a 3x3 rotation matrix"
    )
    translation: _Three = Field(description="3 finite numbers in metres, world to camera")
    fisheye: bool = Field(default=False, description="true or false")

    @field_validator("size")
    @classmethod
    def _whole_pixels(cls, size: list[float]) -> list[float]:
        if any(length < 1 or length != int(length) for length in size):
            raise ValueError(f"expected [width, height] in integer pixels, found {in_short(size)}")
        return size

    @field_validator("rotation")
    @classmethod
    def _is_rotation(cls, rotation: list[float] | list[list[float]]) -> list[float] | list[list[float]]:
        R = np.array(rotation)
        if R.ndim == 2 and not np.allclose(R @ R.T, np.eye(3), atol=_ROTATION_TOLERANCE):
            raise ValueError(f"not a rotation (its rows are not orthonormal): {_EXPORT_AGAIN}")
        if R.ndim == 2 and np.linalg.det(R) < 0:
            raise ValueError(f"not a rotation (determinant -1, mirrored axes): {_EXPORT_AGAIN}")
        return rotation

    @model_validator(mode="after")
    def _fits_together(self) -> "_CameraTable":
        (fx, skew, cx), (shear, fy, cy), last = self.matrix
        width, height = self.size
        if last != [0.0, 0.0, 1.0] or shear != 0.0 or abs(skew) > _LARGEST_SKEW_PX:
            raise ValueError(
                "matrix: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with zeros and a one there"
            )
        if fx <= 0 or fy <= 0:
            raise ValueError(f"matrix: expected positive focal lengths, found fx = {fx:g} and fy = {fy:g}")
        if not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
            raise ValueError(
                f"matrix: the principal point ({cx:g}, {cy:g}) is outside the picture of "
                f"{width:g}x{height:g} pixels: check that matrix and size belong to the same video"
            )
        allowed = (4,) if self.fisheye else (4, 5, 8)
        if len(self.distortions) not in allowed:
            numbers = "4 numbers for a fisheye lens" if self.fisheye else "4, 5 or 8 numbers"
            raise ValueError(f"distortions: expected {numbers}, found {len(self.distortions)}")
        return self


def read_calibration(path: Path, up: Up) -> tuple[Camera, ...]:
    """The cameras in the file's order, in the internal z-up world.

    up: the axis that points up in the file's world. Tables without any field of a camera are ignored.
    Raises CalibrationError, which names the file, the table and the field.
    """
    tables = {
        key: table
        for key, table in load_toml(path, CalibrationError).items()
        if isinstance(table, dict) and table.keys() & (_CameraTable.model_fields.keys() - {"name"})
    }
    if not tables:
        raise CalibrationError(
            f"{path}: contains no camera: expected a table such as [cam01] for every camera"
        )
    cameras = tuple(
        _camera(validated(_CameraTable, {"name": key, **table}, f"{path}: [{key}] ", CalibrationError))
        for key, table in tables.items()
    )
    _check_together(path, list(tables), cameras)
    return tuple(camera.with_world_turned(R_ZUP_YUP) for camera in cameras) if up == "y" else cameras


def write_calibration(path: Path, cameras: tuple[Camera, ...], up: Up) -> None:
    """Writes cameras of the internal z-up world; up: the axis that points up in the file's world."""
    write_file(path, _text(cameras, up))


def write_pose2sim(path: Path, cameras: tuple[Camera, ...], up: Up) -> None:
    """The same, and the table of metadata that files of Pose2Sim and anipose have."""
    metadata = tomli_w.dumps({"metadata": {"adjusted": False, "error": 0.0}})
    write_file(path, f"{_text(cameras, up)}\n{metadata}")


def write_opencv(folder: Path, cameras: tuple[Camera, ...], up: Up) -> None:
    """A folder with a YAML file of OpenCV's FileStorage per camera; R and T transform from world to
    camera."""
    with atomic_folder(folder) as part:
        for camera in _in_file_world(cameras, up):
            storage = cv2.FileStorage(str(part / f"{camera.name}.yml"), cv2.FILE_STORAGE_WRITE)
            storage.write("image_width", camera.width_px)
            storage.write("image_height", camera.height_px)
            storage.write("camera_matrix", camera.K)
            storage.write("distortion_coefficients", np.asarray(camera.distortion)[None])
            storage.write("R", camera.R_camera_world)
            storage.write("T", camera.t_camera_world_m[:, None])
            storage.write("fisheye", int(camera.fisheye))
            storage.release()


def _in_file_world(cameras: tuple[Camera, ...], up: Up) -> tuple[Camera, ...]:
    return tuple(camera.with_world_turned(R_ZUP_YUP.T) for camera in cameras) if up == "y" else cameras


def _text(cameras: tuple[Camera, ...], up: Up) -> str:
    tables = {
        camera.name: {
            "name": camera.name,
            "size": [camera.width_px, camera.height_px],
            "matrix": camera.K.tolist(),
            "distortions": camera.distortion.tolist(),
            "rotation": Rotation.from_matrix(camera.R_camera_world).as_rotvec().tolist(),
            "translation": camera.t_camera_world_m.tolist(),
            "fisheye": camera.fisheye,
        }
        for camera in _in_file_world(cameras, up)
    }
    return tomli_w.dumps(tables)


def _camera(table: _CameraTable) -> Camera:
    rotation = np.array(table.rotation)
    turn = Rotation.from_rotvec(rotation) if rotation.ndim == 1 else Rotation.from_matrix(rotation)
    return Camera(
        name=table.name,
        width_px=int(table.size[0]),
        height_px=int(table.size[1]),
        K=np.array(table.matrix),
        distortion=np.array(table.distortions),
        R_camera_world=turn.as_matrix(),
        t_camera_world_m=np.array(table.translation),
        fisheye=table.fisheye,
    )


def _check_together(path: Path, tables: list[str], cameras: tuple[Camera, ...]) -> None:
    """Names are unique, and the cameras stand no farther apart than a studio is wide."""
    first_with: dict[str, str] = {}
    for table, camera in zip(tables, cameras, strict=True):
        if camera.name in first_with:
            raise CalibrationError(
                f"{path}: [{table}] name: {camera.name} is also the name in [{first_with[camera.name]}]: "
                "expected a different name for every camera"
            )
        first_with[camera.name] = table
    centres_m: Floats = np.array([camera.centre_world_m for camera in cameras])
    apart_m = np.linalg.norm(centres_m - centres_m[0], axis=1)
    if apart_m.max() > _LARGEST_STUDIO_M:
        farthest = int(apart_m.argmax())
        raise CalibrationError(
            f"{path}: [{tables[farthest]}] translation: this camera stands {apart_m[farthest]:.0f} m from "
            f"[{tables[0]}]: expected metres, so divide by 1000 if these are millimetres"
        )
