"""How a picture's exposure and white balance differ from the plate's."""

from dataclasses import dataclass

import numba
import numpy as np

from services.mocap.types import Bytes, Ints
from services.segmentation.pixels import Levels

_GAUGE_PIXELS = 1500
"""More would not make the estimate of the exposure better."""
_GAUGE_LEVELS = (20.0, 245.0)
"""Darker pixels are noise, brighter ones may be clipped."""
_CAST_REACHES = (0.25, 0.1)
"""How far a channel may be from the exposure, and its pixels from each other."""
_RATIO_BINS = 2048
FLICKER_LIMIT = 0.4
"""Largest relative change of exposure that is evened out."""


@dataclass(frozen=True, eq=False)
class Gauge:
    """Pixels spread over a picture at which the exposure of frames is compared."""

    places: Ints
    """(n,) flat pixel indices."""
    reference: Levels
    """(n, 3) their colours in the reference picture."""

    @staticmethod
    def on(reference: Levels) -> "Gauge":
        """The gauge for a reference picture (H, W, 3); pixels that are nearly black or white are left out."""
        pixels = reference.reshape(-1, 3)
        low, high = _GAUGE_LEVELS
        usable = np.flatnonzero((pixels.mean(axis=1) > low) & (pixels.max(axis=1) < high))
        # At random: a regular step could hit the same few columns in every row.
        drawn = np.random.default_rng(0).permutation(usable)[:_GAUGE_PIXELS]
        places = np.sort(drawn).astype(np.int32)
        return Gauge(places, np.ascontiguousarray(pixels[places]))

    def gains(self, image_bgr: Bytes, limit: float = FLICKER_LIMIT) -> Levels:
        """(3,) gains of an image's channels relative to the reference: exposure, white balance.

        The exposure is within 1 ± limit. Medians are right while more than half of the picture shows the lit
        background; ratios far from the exposure do not count for a channel.
        """
        gains: Levels = np.ones(3, np.float32)
        if self.places.size == 0:
            return gains
        pixels = np.ascontiguousarray(image_bgr).reshape(-1, 3)
        exposure = _median_ratio(pixels, 0, 2, self.places, self.reference, 1.0, limit)
        for c in range(3):
            gain = exposure
            for reach in _CAST_REACHES:
                gain = _median_ratio(pixels, c, c, self.places, self.reference, gain, reach)
            gains[c] = gain
        return gains

    def evened(self, image_bgr: Bytes, limit: float = FLICKER_LIMIT) -> Bytes:
        """A copy of an image (H, W, 3) in the reference's exposure and white balance."""
        factors = 1 / self.gains(image_bgr, limit)
        return np.asarray(np.rint(image_bgr * factors).clip(0, 255).astype(np.uint8))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _median_ratio(
    pixels: Bytes, first: int, last: int, places: Ints, reference: Levels, middle: float, reach: float
) -> float:
    """Median over places (n,) of the sum of channels first to last of pixels (N, 3) over that of a reference.

    reference (n, 3): at these places. Only ratios within middle ± reach count. The median is found to 1/2048
    of that range; it is the middle if no ratio counts.
    """
    counts = np.zeros(_RATIO_BINS, np.int32)
    scale, n = _RATIO_BINS / (2 * reach), 0
    for i in range(places.size):
        seen, known = 0.0, 1e-9
        for c in range(first, last + 1):
            seen += float(pixels[places[i], c])
            known += float(reference[i, c])
        place = (seen / known - (middle - reach)) * scale
        if 0 <= place < _RATIO_BINS:
            counts[int(place)] += 1
            n += 1
    below, step = 0, 0
    while n > 0 and below <= n // 2:
        below += int(counts[step])
        step += 1
    return middle - reach + (step - 0.5) / scale if n > 0 else middle
