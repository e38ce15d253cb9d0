"""Finds how far a picture is shifted against the clean plate, because the camera shakes or stabilises.

The calibration holds for the plate, so that pictures are moved back to it.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from services.mocap.types import Bytes, Floats, Ints, Mask
from services.segmentation.pixels import Levels

_TILES_DOWN, _TILES_ACROSS, _PER_TILE = 12, 16, 5
"""The strongest outlines of each tile are anchors, so that the actor does not hide them all."""
_FEWEST_TILES = 40
"""With outlines across a direction; with fewer, the actor's could pass for the stage's."""
_LEAST_SLOPE = 1.5
"""Levels per pixel; smaller slopes may be noise."""
_SMOOTHING_PX = 1.0
_MOST_PX, _LEAST_PX = 6, 0.15
"""Shifts beyond are not looked for; smaller ones do no harm."""
_ROUNDS, _SETTLED_PX = 6, 0.01
_FAR_LEVELS = 4.0
"""Anchors that are farther off count little: somebody stands before them."""
_BETTER = 0.9
"""A shift counts only if it leaves at most this share of the loss."""


@dataclass(frozen=True, eq=False)
class Anchors:
    """Pixels on a plate's outlines, from which the shift of a picture is computed."""

    rows: Ints
    columns: Ints
    terms: Floats
    """(n, 3) the brightness of each, and its slopes to the right and down times -1, in levels per pixel; the
    slopes are 0 in a direction for which there are too few outlines."""

    @staticmethod
    def on(plate_bgr: Levels) -> "Anchors":
        """The strongest outlines of each part of a plate (H, W, 3)."""
        grey = _smoothed(plate_bgr)
        slopes = [np.gradient(grey, axis=axis) for axis in (1, 0)]
        chosen = [_strongest(np.abs(slope)) for slope in slopes]
        told = [slope * of_slope.any() for slope, of_slope in zip(slopes, chosen, strict=True)]
        rows, columns = np.nonzero(chosen[0] | chosen[1])
        terms = np.stack([grey, -told[0], -told[1]], axis=-1)[rows, columns]
        return Anchors(rows.astype(np.int32), columns.astype(np.int32), terms.astype(np.float64))

    @staticmethod
    def none() -> "Anchors":
        """Anchors for which every picture is steady."""
        return Anchors(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros((0, 3)))

    def shift_px(self, picture_bgr: Bytes) -> tuple[float, float]:
        """How far to the right and down a picture (H, W, 3) of the plate's size lies; (0, 0): it is steady.

        With exposure g, an anchor's brightness m and slopes s, the shift d minimises the sum of
        log(1 + (r / far)²), r = g (m - s·d) minus the picture at the anchor. It counts only if the picture
        then looks clearly more like the plate.
        """
        if not self.terms[:, 1:].any():
            return 0.0, 0.0
        grey, shift, weights = _smoothed(picture_bgr), np.zeros(2), np.ones(len(self.rows))
        still = grey[self.rows, self.columns]
        for n in range(_ROUNDS):
            right, down = np.rint(shift).astype(int)
            seen = grey[self.rows + down, self.columns + right]
            found, weights = _solved(self.terms, seen, weights)
            if found[0] <= 0:  # a black picture, for example
                return 0.0, 0.0
            before, shift = shift, ((right, down) + found[1:] / found[0]).clip(0.5 - _MOST_PX, _MOST_PX - 0.5)
            if n > 0 and np.hypot(*(shift - before)) < _SETTLED_PX:  # the first round weighs all alike
                break
        if np.hypot(*shift) < _LEAST_PX:
            return 0.0, 0.0
        _, still_weights = _solved(self.terms[:, :1], still, weights)
        is_shifted = (1 - weights).mean() < _BETTER * (1 - still_weights).mean()
        return (float(shift[0]), float(shift[1])) if is_shifted else (0.0, 0.0)


def _strongest(slopes: Levels) -> Mask:
    """The steepest pixels (H, W) of each tile; none where few tiles have any."""
    chosen, n_tiles = np.zeros(slopes.shape, bool), 0
    rows, columns = (np.arange(_MOST_PX, size - _MOST_PX) for size in slopes.shape)
    if (len(rows) // _TILES_DOWN) * (len(columns) // _TILES_ACROSS) < _PER_TILE:
        return chosen
    for some_rows in np.array_split(rows, _TILES_DOWN):
        for some_columns in np.array_split(columns, _TILES_ACROSS):
            tile = np.s_[some_rows[0] : some_rows[-1] + 1, some_columns[0] : some_columns[-1] + 1]
            least = np.partition(slopes[tile], -_PER_TILE, axis=None)[-_PER_TILE]
            chosen[tile] = slopes[tile] >= max(least, _LEAST_SLOPE)
            n_tiles += bool(chosen[tile].any())
    return chosen if n_tiles >= _FEWEST_TILES else np.zeros_like(chosen)


def _solved(terms: Floats, seen: Levels, weights: Floats) -> tuple[Floats, Floats]:
    """The factors (k,) of terms (n, k) that explain best what is seen (n,), by weights (n,); and the weights
    (n,) that the residuals give, small for hidden anchors."""
    weighted = terms.T * weights
    found = np.asarray(np.linalg.lstsq(weighted @ terms, weighted @ seen, rcond=1e-9)[0], np.float64)
    off_levels = np.asarray(terms @ found - seen, np.float64)
    return found, 1 / (1 + (off_levels / _FAR_LEVELS) ** 2)


def _smoothed(picture_bgr: Bytes | Levels) -> Levels:
    grey = cv2.cvtColor(picture_bgr, cv2.COLOR_BGR2GRAY)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), _SMOOTHING_PX), np.float32)
