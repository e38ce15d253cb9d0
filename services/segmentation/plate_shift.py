"""Detects a camera that was moved after its clean plate was recorded: the shift of the plate against the
pictures."""

from collections.abc import Iterable, Iterator
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from services.mocap.types import Bytes
from services.segmentation.pixels import Levels

_Level = TypeVar("_Level", np.uint8, np.float32)

_LEAST_PX, _MOST_PX = 0.25, 6.0
"""A smaller shift does no harm; a larger one is another view, for which the calibration is wrong."""
_GAIN = 0.97
"""A shift counts only if it leaves at most this share of the difference in outlines."""
_UNTIL = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
_SMOOTHING_PX = 5
_ALIKE_LEVELS = 12.0
"""Brightness that differs by less, on average over five pixels, is the stage's."""
_INNER = (slice(8, -8), slice(8, -8))


def plate_shift_px(plate_bgr: Bytes, picture_bgr: Bytes) -> tuple[float, float]:
    """How far to the right and down a plate (H, W, 3) has to move to lie on a picture (H, W, 3).

    (0, 0) if it fits, or if no shift improves it. It is the shift with the best correlation of the pictures
    (Evangelidis, Psarakis, PAMI 30(10), 2008), which is independent of the light and almost independent of a
    person in front of a stage with outlines.
    """
    plate, picture = grey_of(plate_bgr), grey_of(picture_bgr)
    plate *= np.float32(np.median(picture / np.maximum(plate, 1)))  # remove differences of exposure
    rough = _correlated(plate, picture, np.full(plate.shape, 1, np.uint8))
    alike = np.abs(cv2.blur(picture - _moved(plate, *rough), (5, 5))) < _ALIKE_LEVELS
    stage = np.asarray(cv2.erode(alike.view(np.uint8), np.ones((9, 9), np.uint8)), np.uint8)
    right, down = _correlated(plate, picture, stage)
    if not _LEAST_PX <= float(np.hypot(right, down)) <= _MOST_PX:
        return 0.0, 0.0
    seen, *of_plates = (
        slopes_of(np.asarray(cv2.GaussianBlur(grey, (0, 0), 1.0), np.float32))
        for grey in (picture, plate, _moved(plate, right, down))
    )
    there = stage[_INNER] > 0
    before, after = (float(np.mean(np.abs(seen - slopes)[_INNER][there])) for slopes in of_plates)
    return (right, down) if after < _GAIN * before else (0.0, 0.0)


def _correlated(plate: Levels, picture: Levels, stage: Bytes) -> tuple[float, float]:
    """The shift (right, down) of a plate (H, W) that correlates best, by pixels of the stage (H, W); (0, 0):
    none."""
    matrix = np.eye(2, 3, dtype=np.float32)
    try:
        _, found = cv2.findTransformECC(
            picture, plate, matrix, cv2.MOTION_TRANSLATION, _UNTIL, stage, _SMOOTHING_PX
        )
    except cv2.error:  # nothing to correlate: a stage of one colour
        return 0.0, 0.0
    return -float(found[0, 2]), -float(found[1, 2])


def shifted(frames: Iterable[Bytes], shift_px: tuple[float, float]) -> Iterator[Bytes]:
    """Frames (H, W, 3) moved to the right and down; their edges are repeated."""
    for frame in frames:
        yield frame if shift_px == (0.0, 0.0) else _moved(frame, *shift_px)


def _moved(picture: NDArray[_Level], right: float, down: float) -> NDArray[_Level]:
    matrix = np.array([[1.0, 0.0, right], [0.0, 1.0, down]])
    size_px = picture.shape[1], picture.shape[0]
    moved = cv2.warpAffine(picture, matrix, size_px, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved).astype(picture.dtype)


def grey_of(picture_bgr: Bytes) -> Levels:
    """The brightness (H, W) of a picture (H, W, 3)."""
    return np.asarray(cv2.cvtColor(picture_bgr, cv2.COLOR_BGR2GRAY), np.float32)


def slopes_of(grey: Levels) -> Levels:
    """Gradient magnitude of a brightness (H, W)."""
    return np.asarray(np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)))
