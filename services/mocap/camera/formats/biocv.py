"""bioCV's calibrations, .calib: a text file per camera, in millimetres.

Width, height, the 3x3 camera matrix, the 4x4 transform from the world to the camera, the lens coefficients.
"""

from pathlib import Path

from services.mocap.camera.formats.loose import Loose, LooseCamera, Reader
from services.mocap.camera.formats.parsing import array_of, files_in, has_files, rotation_of, text_of
from services.mocap.errors import CalibrationError

_SUFFIXES = (".calib",)
_BEFORE_LENS = 2 + 9 + 16


def read_biocv(path: Path) -> Loose:
    """One camera per file, named like the file (`00.mp4.calib` is camera 00)."""
    return Loose([_camera(file) for file in files_in(path, _SUFFIXES)], metres=1e-3)


BIOCV = Reader(read_biocv, lambda path: has_files(path, _SUFFIXES), _SUFFIXES)


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
        t=transform[:3, 3],
        size_px=(round(values[0]), round(values[1])),
    )
