"""Vicon's calibration, .xcp: XML in millimetres, with OpenCV's camera axes.

ORIENTATION is a quaternion (x, y, z, w) that rotates from the world to the camera, POSITION the camera's
centre in the world. VICON_RADIAL corrects a point of the picture whose distance from PRINCIPAL_POINT is r px:
it lies 1 + k1 r^2 + k2 r^4 + k3 r^6 times as far from it for a camera without distortion. OpenCV's
coefficients say the opposite, where a point lies in the picture, and are fitted to it.
"""

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.camera.formats.loose import Loose, LooseCamera, Reader
from services.mocap.camera.formats.parsing import array_of, has_suffix, xml_root
from services.mocap.errors import CalibrationError
from services.mocap.types import Floats

_SUFFIXES = (".xcp",)
_RADII = 200
_LARGEST_CORRECTION = 4.0


def read_vicon(path: Path) -> Loose:
    """The video cameras of the file, by device number; marker cameras are ignored where there are both."""
    frames = [(tag, tag.find("KeyFrames/KeyFrame")) for tag in xml_root(path, "Vicon").iter("Camera")]
    calibrated = [(tag, frame) for tag, frame in frames if frame is not None]
    video = [
        (tag, frame)
        for tag, frame in calibrated
        if "video" in f"{tag.get('TYPE')} {tag.get('DISPLAY_TYPE')}".lower()
    ]
    remarks = []
    if 0 < len(video) < len(calibrated):
        ignored = len(calibrated) - len(video)
        remarks.append(f"{path}: {ignored} cameras are not video cameras and are ignored")
    cameras = [_camera(path, *each) for each in video or calibrated]
    return Loose(cameras, metres=1e-3, remarks=tuple(remarks))


VICON = Reader(read_vicon, lambda path: has_suffix(path, _SUFFIXES), _SUFFIXES)


def _camera(path: Path, tag: Element, frame: Element) -> LooseCamera:
    where = f"{path}: camera {tag.get('DEVICEID')}"

    def numbers(of: Element, name: str, count: int) -> Floats:
        return array_of(of.get(name, "").split(), (count,), f"{where}: {name}")

    width, height = numbers(tag, "SENSOR_SIZE", 2)
    (focal_px,) = numbers(frame, "FOCAL_LENGTH", 1)
    (aspect,) = numbers(tag, "PIXEL_ASPECT_RATIO", 1) if tag.get("PIXEL_ASPECT_RATIO") else (1.0,)
    cx, cy = numbers(frame, "PRINCIPAL_POINT", 2)
    quaternion = numbers(frame, "ORIENTATION", 4)
    if not np.any(quaternion):
        raise CalibrationError(f"{where}: ORIENTATION: is zero: expected a camera that Vicon has calibrated")
    R = np.asarray(Rotation.from_quat(quaternion).as_matrix(), np.float64)
    reach_px = float(np.hypot(max(cx, width - cx), max(cy, height - cy)))
    return LooseCamera(
        name=tag.get("DEVICEID", "?"),
        K=np.array([[focal_px, 0.0, cx], [0.0, focal_px / aspect, cy], [0.0, 0.0, 1.0]]),
        distortion=_distortion(where, frame, focal_px, reach_px),
        R=R,
        t=-R @ numbers(frame, "POSITION", 3),
        size_px=(round(width), round(height)),
    )


def _distortion(where: str, frame: Element, focal_px: float, reach_px: float) -> Floats:
    """(8,) OpenCV's coefficients: a radius u is divided by 1 + k4 u^2 + k5 u^4 + k6 u^6 in the picture.

    reach_px: from the principal point to the farthest corner. VICON_RADIAL2 holds a word, the centre, k1, k2
    and k3; the older VICON_RADIAL k1 and k2.
    """
    if frame.get("VICON_RADIAL2"):
        radial = frame.get("VICON_RADIAL2", "").split()[3:6]
    else:
        radial = frame.get("VICON_RADIAL", "0 0").split()[:2]
    per_px = array_of([*radial, 0, 0, 0][:3], (3,), f"{where}: VICON_RADIAL")
    powers = np.array([2, 4, 6])
    radii_px = np.linspace(0, reach_px, _RADII)[1:]
    times = 1 + radii_px[:, None] ** powers @ per_px
    if not 1 / _LARGEST_CORRECTION < times.min() <= times.max() < _LARGEST_CORRECTION:
        raise CalibrationError(
            f"{where}: VICON_RADIAL: moves a point of the picture to {times[np.abs(times - 1).argmax()]:.3g} "
            "times its distance from the centre: expected Vicon's coefficients, of radii in pixels"
        )
    corrected = radii_px * times / focal_px
    pixels_per_unit = radii_px / times  # what an error of the ratio moves in the picture
    k4_to_k6 = np.linalg.lstsq(
        corrected[:, None] ** powers * pixels_per_unit[:, None], (times - 1) * pixels_per_unit
    )[0]
    return np.concatenate([np.zeros(5), k4_to_k6])
