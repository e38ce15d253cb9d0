"""Lenses from a calibration file of any tool, to be held while cameras are calibrated with a board."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from services.mocap.calibration.lens import N_INTRINSICS, Intrinsics, Lens, intrinsic_values
from services.mocap.camera.formats.reading import read_loose
from services.mocap.errors import CalibrationError
from services.mocap.take.recordings import match_by_name

_HELD = (False,) * N_INTRINSICS
_MOST_COEFFICIENTS = {False: 5, True: 4}
"""By whether the lens is OpenCV's fisheye model."""


def known_lenses(path: Path, cameras: Sequence[str]) -> dict[str, Intrinsics]:
    """The lenses of those cameras that the file has, matched by their names; poses in it are ignored.

    Raises CalibrationError if it has none of them, or a lens model that cannot be held.
    """
    there = {camera.name: camera for camera in read_loose(path, needs_pose=False).cameras}
    found = {}
    for name, match in match_by_name(list(cameras), [Path(name) for name in there]).items():
        lens = there[str(match)]
        used = np.trim_zeros(lens.distortion, "b")
        if lens.size_px is None:
            raise CalibrationError(f"{path}: {lens.name}: size is missing: expected the pictures' size")
        if len(used) > _MOST_COEFFICIENTS[lens.fisheye]:
            raise CalibrationError(
                f"{path}: {lens.name}: has {len(used)} lens coefficients: expected at most "
                f"{_MOST_COEFFICIENTS[lens.fisheye]}"
            )
        model: Lens = "fisheye" if lens.fisheye else "wide" if len(used) > 4 else "normal"
        found[name] = Intrinsics(model, lens.size_px, intrinsic_values(lens.K, used), _HELD)
    if not found:
        raise CalibrationError(
            f"{path}: has lenses of {', '.join(there)}: expected those of {', '.join(cameras)}"
        )
    return found
