"""Lenses from a calibration file of any tool, to be held while cameras are calibrated with a board."""

from collections.abc import Mapping, Sequence
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
    for name, match in match_by_name(list(cameras), [Path(f"{name}.toml") for name in there]).items():
        lens = there[match.stem]
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


def check_lens_sizes(
    lenses: Mapping[str, Intrinsics], sizes_px: Mapping[str, tuple[int, int] | None]
) -> None:
    """Raise CalibrationError if a camera's lens is for pictures of another size (width, height) than its own,
    where that is known.

    It is not converted: cameras crop their pictures in some modes.
    """
    for camera, lens in lenses.items():
        size_px = sizes_px[camera]
        if size_px is not None and size_px != lens.size_px:
            known, found = ("{}x{}".format(*size) for size in (lens.size_px, size_px))
            raise CalibrationError(
                f"--lens: {camera}: the lens is for {known} pixels, but the clip has {found}: record "
                "clips and take with the settings of the lens, or calibrate lenses with these settings"
            )
