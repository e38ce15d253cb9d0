"""Qualisys Track Manager's calibration, .qca.txt: XML in millimetres and 64ths of pixels.

A camera's axes there are x right, y up, z backwards; transform holds its place in the world and, row by row,
its axes. Lens coefficients are OpenCV's, of coordinates at focal length 1; centres count from the sensor's
corner, and fov_video says which part of the sensor the picture is.
"""

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from services.mocap.camera.formats.loose import Loose, LooseCamera, Reader
from services.mocap.camera.formats.parsing import array_of, has_suffix, rotation_of, xml_root
from services.mocap.errors import CalibrationError
from services.mocap.types import Floats

_PER_PIXEL = 64.0
_SUFFIXES = (".qca.txt", ".qca")
_R_OPENCV_QUALISYS = np.diag([1.0, -1.0, -1.0])


def read_qualisys(path: Path) -> Loose:
    """The video cameras of the file, by serial number; marker cameras are ignored."""
    cameras = [tag for tag in xml_root(path, "Qualisys").iter("camera") if tag.find("intrinsic") is not None]
    video = [tag for tag in cameras if "video" in tag.get("model", "video").lower()]
    remarks = []
    if 0 < len(video) < len(cameras):
        remarks.append(f"{path}: {len(cameras) - len(video)} cameras are not video cameras and are ignored")
    turned = [
        tag.get("serial", "?") for tag in video or cameras if tag.get("viewrotation", "0") not in ("0", "")
    ]
    if turned:
        remarks.append(
            f"{path}: pictures of {', '.join(turned)} are rotated in Qualisys (viewrotation): the "
            "calibration is for videos without rotation: check with xormocap calibrate --check"
        )
    serials = [tag.get("serial", str(number + 1)) for number, tag in enumerate(video or cameras)]
    found = [_camera(path, *each) for each in zip(serials, video or cameras, strict=True)]
    remarks += [
        f"{path}: camera {serial}: has no pose or lens (transform, intrinsic) and is left out"
        for serial, camera in zip(serials, found, strict=True)
        if camera is None
    ]
    return Loose([camera for camera in found if camera is not None], metres=1e-3, remarks=tuple(remarks))


QUALISYS = Reader(read_qualisys, lambda path: has_suffix(path, _SUFFIXES), _SUFFIXES)


def _camera(path: Path, serial: str, tag: Element) -> LooseCamera | None:
    """None for one that Qualisys has not calibrated: its numbers are zero."""
    where = f"{path}: camera {serial}"
    left, top, right, bottom = _numbers(tag, where, "fov_video", ("left", "top", "right", "bottom"))
    fx, fy, cx, cy, skew = _numbers(
        tag, where, "intrinsic", ("focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "skew")
    )
    k1, k2, k3 = _numbers(tag, where, "intrinsic", tuple(f"radialDistortion{i}" for i in (1, 2, 3)))
    p1, p2 = _numbers(tag, where, "intrinsic", ("tangentalDistortion1", "tangentalDistortion2"))
    centre_world_mm = _numbers(tag, where, "transform", ("x", "y", "z"))
    names = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
    axes = _numbers(tag, where, "transform", names)
    if not axes.any() or fx == 0:
        return None
    R = _R_OPENCV_QUALISYS @ rotation_of(axes, where)
    K = np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, _PER_PIXEL]]) / _PER_PIXEL
    K[:2, 2] -= left, top
    return LooseCamera(
        name=serial,
        K=K,
        distortion=np.array([k1, k2, p1, p2, k3]),
        R=R,
        t=-R @ centre_world_mm,
        size_px=(round(right - left + 1), round(bottom - top + 1)),
    )


def _numbers(camera: Element, where: str, name: str, attributes: tuple[str, ...]) -> Floats:
    """(n,) values of attributes of a camera's element; raises CalibrationError."""
    tag = camera.find(name)
    if tag is None:
        raise CalibrationError(f"{where}: {name}: is missing: expected it in every camera")
    texts = {each: tag.get(each, "0" if each == "skew" else "") for each in attributes}
    return np.array([array_of(text, (), f"{where}: {name} {each}") for each, text in texts.items()])
