"""How far a codec's errors exceed a clean plate's noise near whoever moves: a still plate does not show them.

A codec describes a still scene once, and well; around what moves it does so again for every picture, within
few bits. These errors are alike in patches of pixels, so that a patch of nine tells hardly more than one
pixel, whereas the noise of a sensor averages out in it.
"""

import cv2
import numpy as np

from services.mocap.types import Longs
from services.segmentation.comparison import Comparison
from services.segmentation.pixels import MEAN_STEPS
from services.segmentation.plate import Plate

_PATCH_PX = 3
"""Width of the patches over which errors are averaged."""
_SURELY_LEVELS = 20.0
"""A patch that is farther off the plate in one channel is no error."""
_NEAR_PX, _FAR_PX = (3, 16), 48
"""Errors are measured between 3 and 16 pixels from such patches, since a codec's blocks have up to 16, and
compared with those farther away than 48."""
_FARTHEST_LEVELS, _BINS = 16.0, 160
"""Range and number of the bins in which patches are counted; those farther off are in the last."""
_QUANTILE = 0.75
"""Of the patches; what is left of the actor among the near ones is above it."""
_LEAST_PATCHES = 500
_USUAL_LEVELS = 0.8
"""Deviation that near patches have even in good recordings, because the actor's outline is blurred."""
_MOST_LEVELS = 5.0
"""With more, clothes in about the wall's colour would be taken for the wall."""


class CodecErrors:
    """Measures one camera's errors near what moves."""

    def __init__(self, plate: Plate) -> None:
        self._plate = plate
        self._near, self._far = np.zeros((2, _BINS), np.int64)
        """(_BINS,) number of patches by how far they are off the plate."""

    def add(self, compared: Comparison) -> None:
        """Take in a picture that was compared with the plate."""
        known = compared.expected.astype(np.float32) * np.float32(1 / MEAN_STEPS)
        off = [
            cv2.blur(seen, (_PATCH_PX, _PATCH_PX)) for seen in compared.channels.astype(np.float32) - known
        ]
        surely = (np.abs(off).max(axis=0) > _SURELY_LEVELS).view(np.uint8)
        surely = cv2.morphologyEx(surely, cv2.MORPH_OPEN, np.ones((_PATCH_PX, _PATCH_PX), np.uint8))
        if not surely.any():
            return
        away_px = cv2.distanceTransform(1 - surely, cv2.DIST_L2, cv2.DIST_MASK_5)
        off_levels = np.sqrt(np.square(off).mean(axis=0)).clip(0, _FARTHEST_LEVELS)
        is_lit = np.sum(off, axis=0) >= 0  # others may be in shadow
        nearest_px, farthest_px = _NEAR_PX
        for counts, chosen in (
            (self._near, (away_px > nearest_px) & (away_px < farthest_px)),
            (self._far, away_px > _FAR_PX),
        ):
            counts += np.histogram(off_levels[chosen & is_lit], _BINS, (0, _FARTHEST_LEVELS))[0]

    @property
    def levels(self) -> float:
        """Deviation per channel and pixel that stands for the errors; 0 while too little was seen.

        With n and f how far a share of _QUANTILE of the near and of the far patches is off at most, and u the
        usual difference, it is 3 √(n² - f² - u²), because a patch of 3x3 pixels whose errors are alike may
        count only as much as one whose errors average out; at most _MOST_LEVELS.
        """
        if min(self._near.sum(), self._far.sum()) < _LEAST_PATCHES:
            return 0.0
        near, far = _quantile(self._near), _quantile(self._far)
        beyond2 = near**2 - far**2 - _USUAL_LEVELS**2
        return float(min(_PATCH_PX * np.sqrt(max(beyond2, 0.0)), _MOST_LEVELS))

    @property
    def plate(self) -> Plate:
        """The plate with the errors as noise."""
        return self._plate.with_noise(self.levels)


def _quantile(counts: Longs) -> float:
    """The level below which a share of _QUANTILE of the counted patches (_BINS,) is."""
    bin_above = np.searchsorted(np.cumsum(counts), _QUANTILE * counts.sum())
    return float((bin_above + 0.5) * _FARTHEST_LEVELS / _BINS)
