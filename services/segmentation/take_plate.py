"""A clean plate made of the take itself, for takes without one: what most of the pictures show.

Where the actor stands in most of them, nothing tells what is behind; how much of the picture that may be is
part of the answer.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from services.mocap.types import Bytes, Ints, Mask
from services.segmentation.pixels import Levels
from services.segmentation.plate import Gauge

SAMPLES = 48
"""Pictures that a plate is made of, at most."""
_FLICKER_LIMIT = 0.25
_LEAST_TOLERANCE = 8.0
"""Levels; pictures that differ by less show the same."""
_SIGMAS = 4.0
_MAD_SIGMA = 1.4826
"""Deviation of normal noise over the median of its size."""
_STILL = 0.9
"""Of the samples, that have to agree where nothing moves."""
_ROWS_AT_ONCE = 64


@dataclass(frozen=True, eq=False)
class TakePlate:
    """What the empty scene of one camera probably looks like."""

    frames: Bytes
    """(N, H, W, 3) the samples at one exposure; where the actor was, an earlier look at the background."""
    support: Levels
    """(H, W) the share of the samples, 0 to 1, that show the same at a pixel."""

    @property
    def unsure_share(self) -> float:
        """Of the pixels at which anything moves, the share that fewer than half of the samples show empty."""
        return float((self.support < 0.5).sum() / max(int((self.support < _STILL).sum()), 1))


def plate_of_samples(samples: Bytes) -> TakePlate:
    """The plate of pictures (N, H, W, 3) of a camera that stands still, over which the actor moves.

    A pixel's background is the median of its samples where half of them agree with it, else the colour that
    most of them share.
    """
    evened = _evened(samples)
    background = median_picture(evened)
    tolerance = _tolerance(evened, background)
    agree = agreeing(evened, background, tolerance)
    doubtful = agree.mean(axis=0) < 0.5
    if doubtful.any():
        background[doubtful] = _most_shared(evened[:, doubtful], tolerance)
        agree[:, doubtful] = agreeing(evened[:, doubtful], background[doubtful], tolerance)
    support = agree.mean(axis=0).astype(np.float32)
    before = background
    for sample, is_background in zip(evened, agree, strict=True):
        sample[~is_background] = before[~is_background]
        before = sample
    return TakePlate(evened, support)


def _evened(samples: Bytes) -> Bytes:
    """Copies of the samples at the exposure of their median."""
    gauge = Gauge.on(median_picture(samples).astype(np.float32))
    return np.array([gauge.evened(sample, _FLICKER_LIMIT) for sample in samples])


def median_picture(samples: Bytes) -> Bytes:
    """The lower median (H, W, 3) over samples (N, H, W, 3), some rows at a time, to spare memory."""
    middle = (len(samples) - 1) // 2
    rows = range(0, samples.shape[1], _ROWS_AT_ONCE)
    parts = [np.partition(samples[:, y : y + _ROWS_AT_ONCE], middle, axis=0)[middle] for y in rows]
    return np.concatenate(parts)


def _tolerance(samples: Bytes, background: Bytes) -> float:
    """Levels by which two looks at the same background may differ, by the samples' noise."""
    sizes = [float(np.median(cv2.absdiff(sample, background))) for sample in samples]
    return max(_LEAST_TOLERANCE, _SIGMAS * _MAD_SIGMA * float(np.median(sizes)))


def agreeing(samples: Bytes, background: Bytes, tolerance: float) -> Mask:
    """Which samples (N, …, 3) show a background (…, 3): (N, …)."""
    agree: Mask = np.empty(samples.shape[:-1], np.bool_)
    for n, sample in enumerate(samples):
        difference = cv2.absdiff(sample.reshape(-1, 3), background.reshape(-1, 3)) <= tolerance
        blue, green, red = difference.T
        agree[n] = (blue & green & red).reshape(background.shape[:-1])
    return agree


def _most_shared(samples: Bytes, tolerance: float) -> Bytes:
    """The sample (P, 3) of each pixel that most other samples (N, P, 3) agree with."""
    counts: Ints = np.array([agreeing(samples, s, tolerance).sum(axis=0) for s in samples], np.int32)
    best = counts.argmax(axis=0)
    chosen: Bytes = samples[best, np.arange(samples.shape[1])]
    return chosen
