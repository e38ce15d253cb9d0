"""The actor's colours: how likely each is, learnt from pixels that are surely the actor's."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from services.mocap.types import Bytes
from services.segmentation.pixels import Levels

BINS = 32
"""Per channel; a bin is 8 levels wide."""
BIN_SHIFT = 3
_BIN_VOLUME = float(8**3)
_BROAD = 1.0 / 220.0**3
"""Density of a colour that was never seen, per cubic level: nearly all are possible."""
_BROAD_SHARE = 0.1
"""Of the actor's pixels, that may have any colour: what the actor turns to the cameras later."""
_OWN_SHARE = 0.5
"""Of the other pixels, that have colours as this camera saw them; the rest as all cameras did."""
_LEAST_PIXELS = 200


def _counts() -> NDArray[np.float64]:
    return np.zeros((BINS, BINS, BINS))


def bins_of(pixels: Bytes) -> NDArray[np.int64]:
    """The bins (N,) of pixels' colours (N, 3), the three axes flattened."""
    blue, green, red = (pixels >> BIN_SHIFT).T.astype(np.int64)
    bins: NDArray[np.int64] = (blue * BINS + green) * BINS + red
    return bins


@dataclass(eq=False)
class ActorColours:
    """A histogram of the actor's colours in one camera."""

    counts: NDArray[np.float64] = field(default_factory=_counts)
    """(BINS, BINS, BINS) by blue, green and red."""

    def add(self, pixels: Bytes) -> None:
        """Take in pixels (N, 3) that are surely the actor's."""
        self.counts += np.bincount(bins_of(pixels), minlength=BINS**3).reshape(self.counts.shape)

    @property
    def n_pixels(self) -> int:
        """How many have been taken in."""
        return int(self.counts.sum())

    def log_density(self, of_all: "ActorColours") -> Levels:
        """(BINS, BINS, BINS) logarithm of the density of colours, per cubic level.

        of_all: what all cameras saw together: clothes that one camera sees before a wall of their colour,
        another sees before something else.
        """
        known = [
            (h, w) for h, w in ((self, _OWN_SHARE), (of_all, 1 - _OWN_SHARE)) if h.n_pixels >= _LEAST_PIXELS
        ]
        density = np.full(self.counts.shape, _BROAD * (_BROAD_SHARE if known else 1.0))
        total = sum(weight for _, weight in known)
        for histogram, weight in known:
            share = (1 - _BROAD_SHARE) * weight / total
            density += share * _smoothed(histogram.counts) / (histogram.n_pixels * _BIN_VOLUME)
        log_density: Levels = np.log(density).astype(np.float32)
        return log_density


def _smoothed(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Counts (B, B, B) of which each bin gives a quarter to either neighbour along every axis."""
    for axis in range(3):
        moved = np.moveaxis(counts, axis, 0)
        smooth = moved / 2
        smooth[1:] += moved[:-1] / 4
        smooth[:-1] += moved[1:] / 4
        counts = np.moveaxis(smooth, 0, axis)
    return counts
