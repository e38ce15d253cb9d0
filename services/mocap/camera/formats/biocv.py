"""bioCV's calibrations, .calib: a text file per camera, in millimetres.

Width, height, the 3x3 camera matrix, the 4x4 transform from the world to the camera, the lens coefficients.
"""

from pathlib import Path

from services.mocap.camera.formats.loose import Loose, LooseCamera, array_of, rotation_of, text_of
from services.mocap.errors import CalibrationError

_MM = 1e-3
_BEFORE_LENS = 2 + 9 + 16


def biocv_files(path: Path) -> list[Path]:
    """A file, or those in a folder."""
    return [path] if path.is_file() else sorted(path.glob("*.calib"))


def read_biocv(path: Path) -> Loose:
    """One camera per file, named like the file (`00.mp4.calib` is camera 00)."""
    return Loose([_camera(file) for file in biocv_files(path)], 1.0)


def _camera(path: Path) -> LooseCamera:
    words = text_of(path).split()
    if len(words) < _BEFORE_LENS + 4:
        raise CalibrationError(
            f"{path}: has {len(words)} numbers: expected width, height, a 3x3 camera matrix, a 4x4 "
            "transform and 4 lens coefficients or more"
        )
    values = array_of(words, (-1,), str(path))
    transform = values[11:_BEFORE_LENS].reshape(4, 4)
    return LooseCamera(
        name=path.name.partition(".")[0],
        K=values[2:11].reshape(3, 3),
        distortion=values[_BEFORE_LENS:],
        R=rotation_of(transform[:3, :3], f"{path}: rotation"),
        t=transform[:3, 3] * _MM,
        size_px=(round(values[0]), round(values[1])),
    )
