"""COLMAP's text model: cameras.txt and images.txt. Its unit of length and its world are arbitrary.

Pixel centres have half-integer coordinates in COLMAP, integer ones here.
"""

from pathlib import Path, PurePosixPath
from shlex import quote

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.camera.formats.loose import Loose, LooseCamera, Reader
from services.mocap.camera.formats.parsing import array_of, text_of
from services.mocap.errors import CalibrationError, nearest
from services.mocap.types import Floats

_CAMERAS, _IMAGES, _BINARY = "cameras.txt", "images.txt", "images.bin"
_HALF_PX = 0.5
# The parameters of each model in their order; f is both fx and fy.
_MODELS: dict[str, tuple[str, ...]] = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "SIMPLE_RADIAL_FISHEYE": ("f", "cx", "cy", "k1"),
    "RADIAL_FISHEYE": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
}


def read_colmap(folder: Path) -> Loose:
    """A camera for every image, named after its folder if each image has its own folder."""
    if (folder / _BINARY).exists() and not (folder / _IMAGES).exists():
        raise CalibrationError(
            f"{folder}: is COLMAP's binary model: expected its text model: type: colmap model_converter "
            f"--input_path {quote(str(folder))} --output_path {quote(str(folder))} --output_type TXT"
        )
    lenses = {row[0]: row[1:] for row in _rows(folder / _CAMERAS)}
    images = _rows(folder / _IMAGES, every=2)
    files = [PurePosixPath(" ".join(row[9:])) for row in images]
    folders = [file.parent.name for file in files]
    has_folders = all(folders) and len(set(folders)) == len(folders)  # cam01/000.png, cam02/000.png, …
    names = folders if has_folders else [file.stem for file in files]
    path = folder / _IMAGES
    cameras = []
    for name, row in zip(names, images, strict=True):
        if len(row) < 10 or row[8] not in lenses:
            raise CalibrationError(
                f"{path}: image {row[0]}: expected ten values (ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, "
                f"NAME) with a camera of {_CAMERAS}"
            )
        w, x, y, z, *t = array_of(row[1:8], (7,), f"{path}: image {row[0]}")
        R = Rotation.from_quat([x, y, z, w]).as_matrix()
        cameras.append(_camera(folder / _CAMERAS, name, lenses[row[8]], R, np.array(t)))
    remark = (
        f"{folder}: COLMAP's unit of length and axes are arbitrary: give --scale (metres per unit) and "
        "--its-up to xormocap calibrate --import, and compare with something measured"
    )
    return Loose(cameras, None, is_scale_arbitrary=True, remarks=(remark,))


COLMAP = Reader(
    read_colmap,
    lambda path: (path / _IMAGES).exists() or (path / _BINARY).exists(),
    (f"{_CAMERAS} with {_IMAGES}",),
)


def _camera(path: Path, name: str, lens: list[str], R: Floats, t: Floats) -> LooseCamera:
    model, *words = lens or ["?"]
    values = array_of(words, (-1,), f"{path}: {name}")
    size, given = values[:2], values[2:]
    if model not in _MODELS:
        raise CalibrationError(f"{path}: model {model}: cannot be used: {nearest(model, _MODELS)}")
    if len(given) != len(_MODELS[model]):
        raise CalibrationError(
            f"{path}: model {model}: expected {len(_MODELS[model])} parameters, found {len(given)}"
        )
    value = dict(zip(_MODELS[model], given, strict=True))
    fx, fy = value.get("fx", value.get("f")), value.get("fy", value.get("f"))
    fisheye = model.endswith("FISHEYE")
    coefficients = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    return LooseCamera(
        name=name,
        K=np.array([[fx, 0.0, value["cx"] - _HALF_PX], [0.0, fy, value["cy"] - _HALF_PX], [0.0, 0.0, 1.0]]),
        distortion=np.array([value.get(name, 0.0) for name in coefficients]),
        R=R,
        t=t,
        size_px=(round(size[0]), round(size[1])),
        fisheye=fisheye,
    )


def _rows(path: Path, every: int = 1) -> list[list[str]]:
    """The words of every nth line that is not a comment."""
    lines = [line for line in text_of(path).splitlines() if not line.startswith("#")]
    while lines and not lines[-1].strip():
        lines.pop()
    rows = [line.split() for line in lines[::every] if line.strip()]
    if not rows:
        raise CalibrationError(f"{path}: is empty: expected a COLMAP model, exported as text")
    return rows
