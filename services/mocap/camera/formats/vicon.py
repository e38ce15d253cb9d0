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
_POWERS = np.array([2.0, 4.0, 6.0])
_EXACT_PX, _MOST_OFF_PX = 0.1, 1.0
"""How far off three coefficients may be before six are fitted, and how far these."""


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
    cameras = []
    for tag, frame in video or calibrated:
        camera = _camera(path, tag, frame)
        if camera is not None:
            cameras.append(camera)
            continue
        where = f"{path}: camera {tag.get('DEVICEID')}"
        remarks.append(f"{where}: has no pose or lens (ORIENTATION, FOCAL_LENGTH) and is left out")
    return Loose(cameras, metres=1e-3, remarks=tuple(remarks))


VICON = Reader(read_vicon, lambda path: has_suffix(path, _SUFFIXES), _SUFFIXES)


def _camera(path: Path, tag: Element, frame: Element) -> LooseCamera | None:
    """None for one that Vicon has not calibrated: its numbers are zero."""
    where = f"{path}: camera {tag.get('DEVICEID')}"

    def numbers(of: Element, name: str, count: int) -> Floats:
        return array_of(of.get(name, "").split(), (count,), f"{where}: {name}")

    width, height = numbers(tag, "SENSOR_SIZE", 2)
    (focal_px,) = numbers(frame, "FOCAL_LENGTH", 1)
    (aspect,) = numbers(tag, "PIXEL_ASPECT_RATIO", 1) if tag.get("PIXEL_ASPECT_RATIO") else (1.0,)
    cx, cy = numbers(frame, "PRINCIPAL_POINT", 2)
    quaternion = numbers(frame, "ORIENTATION", 4)
    if not quaternion.any() or focal_px == 0:
        return None
    R = np.asarray(Rotation.from_quat(quaternion).as_matrix(), np.float64)
    if focal_px <= 0 or aspect <= 0:
        raise CalibrationError(f"{where}: FOCAL_LENGTH and PIXEL_ASPECT_RATIO: expected numbers over 0")
    reach_px = float(np.hypot(max(cx, width - cx), max(cy, height - cy) * aspect))
    return LooseCamera(
        name=tag.get("DEVICEID", "?"),
        K=np.array([[focal_px, 0.0, cx], [0.0, focal_px / aspect, cy], [0.0, 0.0, 1.0]]),
        distortion=_distortion(where, frame, focal_px, reach_px),
        R=R,
        t=-R @ numbers(frame, "POSITION", 3),
        size_px=(round(width), round(height)),
    )


def _distortion(where: str, frame: Element, focal_px: float, reach_px: float) -> Floats:
    """OpenCV's coefficients for Vicon's correction: k1 to k3 of its usual model (5,) if they suffice, or all
    six of its rational one (8,).

    reach_px: from the principal point to the farthest corner, where pixels are square. VICON_RADIAL2 holds a
    word, the centre, k1, k2 and k3; the older VICON_RADIAL k1 and k2.
    """
    if frame.get("VICON_RADIAL2"):
        radial = frame.get("VICON_RADIAL2", "").split()[3:6]
    else:
        radial = frame.get("VICON_RADIAL", "0 0").split()[:2]
    per_px = array_of([*radial, 0, 0, 0][:3], (3,), f"{where}: VICON_RADIAL")
    radii_px = np.linspace(0, reach_px, _RADII)[1:]
    times = 1 + radii_px[:, None] ** _POWERS @ per_px
    if not 0 < times.min() <= times.max() < _LARGEST_CORRECTION or np.any(np.diff(radii_px * times) <= 0):
        raise CalibrationError(
            f"{where}: VICON_RADIAL: moves a point of the picture to {times[np.abs(times - 1).argmax()]:.3g} "
            "times its distance from the centre, as no lens does: expected Vicon's coefficients, in pixels"
        )
    for n_coefficients, most_px in ((3, _EXACT_PX), (6, _MOST_OFF_PX)):
        k, off_px = _fitted(radii_px, times, focal_px, n_coefficients)
        if off_px < most_px:
            return np.concatenate([k[:2], (0.0, 0.0), k[2:]])  # k1, k2, p1, p2, k3, …
    raise CalibrationError(
        f"{where}: VICON_RADIAL: OpenCV's lens model cannot express it: undistort the videos with Vicon's "
        "tools, and leave VICON_RADIAL out"
    )


def _fitted(radii_px: Floats, times: Floats, focal_px: float, n_coefficients: int) -> tuple[Floats, float]:
    """OpenCV's first coefficients, and by how many pixels a point of the picture is off with them at most.

    A point whose corrected radius is u, in focal lengths, lies in the picture u times
    (1 + k1 u^2 + k2 u^4 + k3 u^6) / (1 + k4 u^2 + k5 u^4 + k6 u^6) from the centre. The error is infinite if
    coefficients fold the corners of the undistorted picture back into it.
    """
    corrected = radii_px * times / focal_px
    largest = max(corrected[-1], radii_px[-1] / focal_px)

    def terms(u: Floats) -> Floats:
        return np.asarray((u / largest)[:, None] ** _POWERS)

    columns = np.hstack([times[:, None] * terms(corrected), -terms(corrected)])[:, :n_coefficients]
    scaled = np.linalg.lstsq(columns * radii_px[:, None], (1 - times) * radii_px)[0]
    above, below = np.pad(scaled, (0, 6 - n_coefficients)).reshape(2, 3)

    def distorted_px(u: Floats) -> Floats:
        return np.asarray(focal_px * u * (1 + terms(u) @ above) / (1 + terms(u) @ below))

    grows = np.all(np.diff(distorted_px(np.linspace(0, largest, _RADII))) > 0)
    off_px = float(np.abs(distorted_px(corrected) - radii_px).max()) if grows else np.inf
    return scaled / np.tile(largest**_POWERS, 2)[:n_coefficients], off_px
