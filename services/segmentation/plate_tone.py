"""Detects a clean plate of another contrast, as a photograph has, or far lighter or darker than the pictures.

Smaller gains of a channel, of exposure and white balance, are left to services.segmentation.exposure.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from services.mocap.types import Bytes, Floats
from services.segmentation.exposure import FLICKER_LIMIT
from services.segmentation.pixels import Levels

_BINS = 32
"""Of as many pixels each, by their level in the plate."""
_FEWEST_BINS = 5
_WIDTH_PX = 640
"""Larger pictures tell no more."""
_SMOOTHED_PX = 5
"""Noise in the plate would flatten the curve."""
_FAR_LEVELS = 2.0
"""A bin whose median is farther off the curve counts less: it may show the actor."""
_ALIKE_LEVELS = 4.0
"""A pixel looks as expected if no channel is farther off."""
_WORTH = 0.03
"""Share of the picture that has to look as expected only with the curves: wrong ones spoil silhouettes."""
_SLOPES = (0.2, 5.0)
"""Of the curves that cameras have."""


@dataclass(frozen=True, eq=False)
class Tone:
    """Levels of a picture by levels of a plate, by channel: parabolas, straight beyond the plate's levels."""

    factors: Floats
    """(3, 3) by channel: of 1, x and x², x from 0 to 255."""
    ends: Floats
    """(3, 2) by channel the lowest and highest level of the plate."""

    def of(self, levels: Levels) -> tuple[Levels, Levels]:
        """The picture's levels (3, H, W) for a plate's (3, H, W), and the slopes there."""
        a, b, c = self.factors.T[:, :, None, None]
        inside = levels.clip(*self.ends.T[:, :, None, None])
        slopes = b + 2 * c * inside
        mapped = a + b * inside + c * inside**2 + slopes * (levels - inside)
        return mapped.astype(np.float32), slopes.astype(np.float32)


def plate_tone(plate: Levels, picture: Bytes) -> Tone | None:
    """The tone in which a plate (3, H, W) looks like a picture (H, W, 3).

    None if a gain in each channel that exposure.py evens out explains the picture about as well. Curves are
    fitted to the medians of pixels that have about the same level in the plate, so that an actor in the
    picture hardly matters.
    """
    known, seen = _smoothed(plate), _smoothed(np.moveaxis(picture, 2, 0))
    parabolas, gains, ends = [], [], []
    for of_plate, of_picture in zip(known, seen, strict=True):
        x, y = _medians(of_plate, of_picture)
        if len(x) < _FEWEST_BINS:
            return None
        powers = np.stack([np.ones_like(x), x, x**2], axis=1)
        a, b, c = _fitted(powers, y)
        slopes = b + 2 * c * x[[0, -1]]
        if slopes.min() < _SLOPES[0] or slopes.max() > _SLOPES[1]:
            return None
        parabolas.append((a, b, c))
        gains.append(_fitted(x[:, None], y))
        ends.append(x[[0, -1]])
    tone = Tone(np.array(parabolas), np.array(ends))
    by_gain = known * np.clip(gains, 1 - FLICKER_LIMIT, 1 + FLICKER_LIMIT)[:, :, None]
    better = _share_alike(tone.of(known)[0], seen) - _share_alike(by_gain, seen)
    return tone if better > _WORTH else None


def _smoothed(channels: Levels | Bytes) -> Levels:
    """Channels (3, h, w) without noise, of large pictures smaller ones."""
    _, height, width = channels.shape
    share = min(1.0, _WIDTH_PX / width)
    size_px = round(share * width), max(round(share * height), 1)
    small = (cv2.resize(one, size_px, interpolation=cv2.INTER_AREA) for one in channels)
    return np.stack([cv2.blur(one.astype(np.float32), (_SMOOTHED_PX, _SMOOTHED_PX)) for one in small])


def _share_alike(expected: Levels | Floats, seen: Levels) -> float:
    return float((np.abs(expected - seen).max(axis=0) < _ALIKE_LEVELS).mean())


def _medians(plate: Levels, picture: Levels) -> tuple[Floats, Floats]:
    """Medians (B,) of a plate's levels and of a picture's in bins of pixels (H, W) of like plate levels."""
    edges = np.unique(np.quantile(plate, np.linspace(0, 1, _BINS + 1)))
    bins = np.digitize(plate, edges[1:-1])
    of_bins = (bins == k for k in range(len(edges) - 1))
    filled = [of_bin for of_bin in of_bins if of_bin.any()]
    x, y = (np.array([float(np.median(one[of_bin])) for of_bin in filled]) for one in (plate, picture))
    return x, y


def _fitted(terms: Floats, y: Floats) -> Floats:
    """The factors (n,) of terms (B, n) whose sum is near to most of y (B,)."""
    start = np.linalg.lstsq(terms, y, rcond=None)[0]
    scale = np.abs(terms).max(axis=0)
    found = least_squares(
        lambda factors: terms @ factors - y, start, loss="cauchy", f_scale=_FAR_LEVELS, x_scale=1 / scale
    )
    return np.asarray(found.x)
