"""Reads calibrations of all known formats, and converts their unit and world."""

from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from services.mocap.camera.camera import R_ZUP_YUP, Camera, nearest_to_rays_m
from services.mocap.camera.formats.biocv import BIOCV
from services.mocap.camera.formats.colmap import COLMAP
from services.mocap.camera.formats.loose import Axis, Loose, LooseCamera, Reader
from services.mocap.camera.formats.opencap import OPENCAP
from services.mocap.camera.formats.qualisys import QUALISYS
from services.mocap.camera.formats.storage import EASYMOCAP, OPENCV
from services.mocap.camera.formats.toml_tables import TOML, read_toml
from services.mocap.camera.formats.vicon import VICON
from services.mocap.errors import CalibrationError
from services.mocap.types import Floats

Format: TypeAlias = Literal["toml", "opencv", "qualisys", "vicon", "easymocap", "colmap", "opencap", "biocv"]
"""toml: Pose2Sim, anipose, FreeMoCap, caliscope."""
Units: TypeAlias = Literal["auto", "m", "cm", "mm"]

_FORMATS: dict[Format, Reader] = {
    "toml": TOML,
    "qualisys": QUALISYS,
    "vicon": VICON,
    "easymocap": EASYMOCAP,
    "colmap": COLMAP,
    "opencap": OPENCAP,
    "biocv": BIOCV,
    "opencv": OPENCV,
}
"""A file or a folder is of the first format that recognises it."""
_METRES: dict[Units, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_SURELY_MM = 50.0
"""Cameras farther apart than this, in the file's unit, are in millimetres: no studio is 50 m wide."""
# Turns a world in which that axis points up into one in which z does.
_R_ZUP: dict[Axis, Floats] = {
    "z": np.eye(3),
    "y": R_ZUP_YUP,
    "-y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "-z": np.diag([1.0, -1.0, -1.0]),
}
_LENGTHS = (4, 5, 8)


class UnknownFormatError(CalibrationError):
    """The file is of none of the known formats."""


def read_any(
    path: Path,
    kind: Format | None,
    size_px: tuple[int, int] | None,
    units: Units,
    scale: float,
    up: Axis | None,
) -> tuple[tuple[Camera, ...], list[str]]:
    """Cameras in the internal z-up world, and remarks for the user.

    kind: None to detect it. size_px: picture size, if the file does not contain it. units: of its lengths,
    if the format does not define it. scale: multiplies its lengths. up: the axis that points up in it; None
    for that of the format. Raises CalibrationError.
    """
    loose = read_loose(path, kind)
    metres, more = _metres_per_unit(path, loose, units)
    remarks = [*loose.remarks, *more]
    cameras = tuple(
        _camera(path, camera, size_px, metres * scale).with_world_turned(_R_ZUP[up or loose.up])
        for camera in loose.cameras
    )
    if not _look_together(cameras):
        remarks.append(
            f"{path}: most cameras look away from where their axes meet: check that its rotations and "
            "translations transform points from the world to the camera"
        )
    return cameras, remarks


def read_loose(path: Path, kind: Format | None = None, *, needs_pose: bool = True) -> Loose:
    """The cameras as the file has them; raises CalibrationError if it has none.

    kind: None to detect it. needs_pose: False to read lenses whose cameras have no pose, of TOML files.
    """
    if not path.exists():
        raise CalibrationError(f"{path}: is missing: expected a calibration, a file or a folder")
    kind = kind or format_of(path)
    loose = read_toml(path, needs_pose=needs_pose) if kind == "toml" else _FORMATS[kind].read(path)
    if not loose.cameras:
        raise CalibrationError(f"{path}: contains no camera that is calibrated: expected one or more")
    return loose


def format_of(path: Path) -> Format:
    """Detect the format by name and content; raises UnknownFormatError."""
    for kind, reader in _FORMATS.items():
        if reader.recognises(path):
            return kind
    known = ", ".join(name for reader in _FORMATS.values() for name in reader.files)
    raise UnknownFormatError(
        f"{path}: is not a known calibration format: expected a file of one of these, or a folder with those "
        f"of all cameras: {known}"
    )


def _metres_per_unit(path: Path, loose: Loose, units: Units) -> tuple[float, list[str]]:
    """The unit of the file's lengths, and a remark where it is guessed.

    Raises CalibrationError if units differs from what the format defines.
    """
    said = _METRES.get(units)
    if loose.metres is not None:
        if said not in (None, loose.metres):
            defined = next(unit for unit, metres in _METRES.items() if metres == loose.metres)
            raise CalibrationError(
                f"{path}: --units {units}: its format defines {defined} as its unit: leave out --units, or "
                "give --scale if the file's lengths are wrong"
            )
        return loose.metres, []
    if said is not None:
        return said, []
    centres = np.array([-camera.R.T @ camera.t for camera in loose.cameras])
    if loose.is_scale_arbitrary or np.ptp(centres, axis=0).max() <= _SURELY_MM:
        return _METRES["m"], []
    remark = (
        f"{path}: its lengths are assumed to be millimetres, by their size: --units of xormocap calibrate "
        "--import overrides this"
    )
    return _METRES["mm"], [remark]


def _camera(path: Path, camera: LooseCamera, size_px: tuple[int, int] | None, metres: float) -> Camera:
    size_px = camera.size_px or size_px
    if size_px is None:
        raise CalibrationError(
            f"{path}: does not contain the picture size of {camera.name}: give --size WxH to xormocap "
            "calibrate --import"
        )
    # As many coefficients as calibration.toml allows: zeros are added, and zeros at the end are left out.
    lengths = (4,) if camera.fisheye else _LENGTHS
    used = int(np.flatnonzero(camera.distortion).max(initial=-1)) + 1
    fitting = next((length for length in lengths if length >= used), None)
    if fitting is None:
        raise CalibrationError(
            f"{path}: {camera.name} has {used} lens coefficients: expected at most {lengths[-1]}: calibrate "
            "it with a simpler lens model"
        )
    return Camera(
        name=camera.name,
        width_px=size_px[0],
        height_px=size_px[1],
        K=camera.K,
        distortion=np.pad(camera.distortion[:used], (0, fitting - used)),
        R_camera_world=camera.R,
        t_camera_world_m=camera.t * metres,
        fisheye=camera.fisheye,
    )


def _look_together(cameras: tuple[Camera, ...]) -> bool:
    """Whether the point nearest to all optical axes is in front of most cameras."""
    centres_m = np.array([camera.centre_world_m for camera in cameras])
    axes = np.array([camera.R_camera_world[2] for camera in cameras])
    ahead = np.einsum("ci,ci->c", nearest_to_rays_m(centres_m, axes) - centres_m, axes) > 0
    return bool(2 * ahead.sum() >= len(cameras))
