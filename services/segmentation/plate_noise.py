"""Mean and noise of the pixels of an empty stage, from frames of one size, and what noise a take adds."""

from collections.abc import Iterable

import cv2
import numba
import numpy as np

from services.mocap.errors import UserError
from services.mocap.types import Bytes, Mask
from services.segmentation.exposure import Gauge
from services.segmentation.pixels import BB, GB, GG, MAD_SIGMA, RB, RG, RR, Levels

_NOISE_FLOOR_LEVELS = 1.5
"""Deviation per channel that a plate does not show: rounding, a codec's still scene. Its errors where
something moves are measured in the take (codec_errors)."""
_CLIPPED = (1, 254)
"""Levels from which on noise is cut off."""
_LEAST_WHOLE = 0.2
"""Share of the picture; if fewer pixels of a stage are not clipped, the actor's are most of them."""
_ASSUMED_NOISE_LEVELS = 2.5
"""Deviation per channel, assumed where the plate is a single picture."""
_PRIOR_FRAMES = 10.0
"""A pixel's own covariance counts as much as the picture's mean one after so many."""
PAIRS = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))
"""Channels whose products make up the planes BB to RR."""


def statistics_of(frames: Iterable[Bytes]) -> tuple[Levels, Levels]:
    """Mean (3, H, W), and the lower triangle (6, H, W) of a new picture's covariance about it.

    With S a pixel's scatter matrix over n frames, C the picture's mean covariance and k _PRIOR_FRAMES, the
    covariance is (1 + 1/n) (S + k C) / (n - 1 + k) + f^2 with the noise floor f.
    """
    count = 0
    for frame in frames:  # only sums are kept, so that long plates of large pictures fit into memory
        if count == 0:
            first = frame.astype(np.float32)
            gauge = Gauge.on(first)
            total = np.zeros((3, frame[..., 0].size), np.float32)
            products = np.zeros((6, frame[..., 0].size), np.float32)
        check_size(frame, first.shape, f"clean plate, frame {count}", "its first frame")
        # Differences from the first frame are small, which keeps sums in single precision exact enough.
        scales = np.float32(1) / gauge.gains(frame)
        pixels = np.ascontiguousarray(frame).reshape(-1, 3)
        _add_products(pixels, scales, first.reshape(-1, 3), total, products)
        count += 1
    if count == 0:
        raise UserError("clean plate: no frames: expected one picture or more of the empty scene")
    shift, extra = total / count, count - 1
    scatter = products - count * np.stack([shift[i] * shift[j] for i, j in PAIRS])
    one = np.array([float(i == j) for i, j in PAIRS], np.float32)[:, None]
    common = one * _ASSUMED_NOISE_LEVELS**2
    if extra:  # the mean of all pixels but those that are clipped, and those where something moved
        spread = np.maximum(scatter[BB] + scatter[GG] + scatter[RR], 0)  # rounding can make it negative
        is_whole = _is_whole(first).ravel()
        counted = is_whole if is_whole.any() else np.ones_like(is_whole)
        counted = counted & (spread <= 4 * np.median(spread[counted]))
        common = scatter[:, counted].mean(axis=1, keepdims=True) / extra
    covariance = (scatter + _PRIOR_FRAMES * common) / (extra + _PRIOR_FRAMES)
    covariance *= 1 + 1 / count  # the mean's own noise adds to the new picture's
    covariance += one * _NOISE_FLOOR_LEVELS**2
    height, width = first.shape[:2]
    mean = np.moveaxis(first, 2, 0) + shift.reshape(3, height, width)
    return mean.astype(np.float32), covariance.reshape(6, height, width).astype(np.float32)


def _is_whole(picture: Bytes | Levels) -> Mask:
    """Where no channel of a picture (H, W, 3) is clipped: (H, W)."""
    return np.asarray(((picture > _CLIPPED[0]) & (picture < _CLIPPED[1])).all(axis=2))


def add_lacking_noise(picture: Bytes, mean: Levels, covariance: Levels) -> None:
    """Add to a covariance (6, H, W) about a mean (3, H, W) the noise that a picture (H, W, 3) has beyond it.

    Noise is told by how far most pixels are off the plate, beside their neighbours: light and an actor in the
    picture hardly change that.
    """
    expected = np.moveaxis(mean, 0, 2)
    expected = expected * Gauge.on(expected).gains(picture)
    off = picture - expected
    off -= cv2.blur(off, (3, 3))  # which leaves 8/9 of the noise's variance
    is_whole = _is_whole(picture) & _is_whole(np.moveaxis(mean, 0, 2))
    if is_whole.mean() < _LEAST_WHOLE:
        return
    noise2 = 9 / 8 * (MAD_SIGMA * np.median(np.abs(off[is_whole]), axis=0)) ** 2
    for diagonal, seen in zip((BB, GG, RR), noise2, strict=True):
        covariance[diagonal] += max(float(seen - np.median(covariance[diagonal])), 0.0)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _add_products(frame: Bytes, scales: Levels, first: Levels, total: Levels, products: Levels) -> None:
    """Add the difference of a frame (N, 3), its channels scaled (3,), from the first (N, 3) to running sums.

    total (3, N): of the difference; products (6, N): of the lower triangle of its outer product.
    """
    for i in range(frame.shape[0]):
        blue = np.float32(frame[i, 0]) * scales[0] - first[i, 0]
        green = np.float32(frame[i, 1]) * scales[1] - first[i, 1]
        red = np.float32(frame[i, 2]) * scales[2] - first[i, 2]
        total[0, i] += blue
        total[1, i] += green
        total[2, i] += red
        products[BB, i] += blue * blue
        products[GB, i] += green * blue
        products[GG, i] += green * green
        products[RB, i] += red * blue
        products[RG, i] += red * green
        products[RR, i] += red * red


def check_size(image: Bytes, shape: tuple[int, ...], what: str, like: str) -> None:
    """Raise UserError where an image is not as high and wide as `like`, whose shape is given."""
    if image.shape[:2] != shape[:2]:
        raise UserError(
            f"{what}: expected {shape[1]}x{shape[0]} pixels, the size of {like}, found "
            f"{image.shape[1]}x{image.shape[0]}: record clean plate and take at the same size"
        )
