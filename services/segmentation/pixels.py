"""Compiled passes over every pixel: exposure, the statistical test, the shadow test, and sums for the plate.

Statistics stand as whole numbers, in planes of their own: half the bytes of single precision, and bytes are
what the test of a picture spends its time on.
"""

from typing import TypeAlias

import numba
import numpy as np
from numpy.typing import NDArray

from services.mocap.types import Bytes, Ints

Levels: TypeAlias = NDArray[np.float32]
"""Pixel values from 0 to 255 and what is computed from them; single precision, for speed."""
Steps: TypeAlias = NDArray[np.int16]
"""Fixed-point numbers."""

MEAN_STEPS = 128
"""Steps of a plate's mean per level."""
WHITENING_STEPS = 16384
"""Steps of a plate's whitening matrix per one."""
_BINS = 2048
_SHADOW_SIGMAS = np.float32(3)  # noise that may add to a shadow's turn of colour


@numba.njit(cache=True, nogil=True, error_model="numpy")
def median_ratio(
    pixels: Bytes, first: int, last: int, places: Ints, reference: Levels, middle: float, reach: float
) -> float:
    """Median over places (n,) of the sum of channels first to last of pixels (N, 3) over that of a reference.

    reference (n, 3): at these places. Only ratios within middle ± reach count; the median is found to a
    2048th of that range, and is the middle where none does.
    """
    counts = np.zeros(_BINS, np.int32)
    scale, n = _BINS / (2 * reach), 0
    for i in range(places.size):
        seen, known = 0.0, 1e-9
        for c in range(first, last + 1):
            seen += float(pixels[places[i], c])
            known += float(reference[i, c])
        place = (seen / known - (middle - reach)) * scale
        if 0 <= place < _BINS:
            counts[int(place)] += 1
            n += 1
    below, step = 0, 0
    while n > 0 and below <= n // 2:
        below += int(counts[step])
        step += 1
    return middle - reach + (step - 0.5) / scale if n > 0 else middle


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def add_products(frame: Bytes, scales: Levels, first: Levels, total: Levels, products: Levels) -> None:
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
        products[0, i] += blue * blue
        products[1, i] += green * blue
        products[2, i] += green * green
        products[3, i] += red * blue
        products[4, i] += red * green
        products[5, i] += red * red


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def mark_differences(
    channels: Bytes, gains: Levels, mean: Steps, whitening: Steps, sigmas: float, mask: Bytes
) -> None:
    """Set a mask (H, W or more) to 1 where channels (3, H, W) differ too much for noise from gains * mean.

    gains (3,), mean (3, H, W), whitening (6, H, W): see CleanPlate. The inner loop has no branch, so that it
    runs on many pixels at a time.
    """
    blue, green, red = gains / np.float32(MEAN_STEPS)
    top = np.float32(255)
    limit = np.float32((sigmas * WHITENING_STEPS) ** 2)
    for y in range(channels.shape[1]):
        for x in range(channels.shape[2]):
            m0, m1, m2 = blue * mean[0, y, x], green * mean[1, y, x], red * mean[2, y, x]
            d0 = np.float32(channels[0, y, x]) - (m0 if m0 < top else top)
            d1 = np.float32(channels[1, y, x]) - (m1 if m1 < top else top)
            d2 = np.float32(channels[2, y, x]) - (m2 if m2 < top else top)
            e0 = whitening[0, y, x] * d0
            e1 = whitening[1, y, x] * d0 + whitening[2, y, x] * d1
            e2 = whitening[3, y, x] * d0 + whitening[4, y, x] * d1 + whitening[5, y, x] * d2
            mask[y, x] = e0 * e0 + e1 * e1 + e2 * e2 > limit


@numba.njit(cache=True, nogil=True, error_model="numpy")
def drop_shadow(
    mask: Bytes, words: NDArray[np.uint64], channels: Bytes, gains: Levels, mean: Steps,
    turn_noise: Levels, ratio_min: float, tangent: float,
) -> Ints:  # fmt: skip
    """Clear what is background in shadow in a mask (H, W or more): darker, not too dark, of its colour.

    words: the mask's memory, eight pixels each; channels (3, H, W): the picture, gains (3,) brighter than the
    mean (3, H, W). Returns (H, 2): from
    where and up to where each row has to be looked at for what is left.

    The turn of colour is the angle between the BGR vectors. Hue itself is undefined on grey walls and
    noisy near them, while a grey wall's vector is as well defined as any: navy before grey turns it by
    tens of degrees, shadow by hardly any. Noise turns dark colours further than bright ones, so its
    share is granted in levels, not in degrees.
    """
    levels = gains / np.float32(MEAN_STEPS)
    darkest, turn = np.float32(ratio_min), np.float32(tangent)
    spans = np.zeros((len(mask), 2), np.int32)
    for y in range(words.shape[0]):
        first, last = 0, words.shape[1]
        while first < last and words[y, first] == 0:
            first += 1
        while last > first and words[y, last - 1] == 0:
            last -= 1
        if first < last:
            spans[y, 0], spans[y, 1] = 8 * first, min(8 * last, channels.shape[2])
            _drop_in_row(mask, channels, mean, turn_noise, y, spans[y], levels, darkest, turn)
    return spans


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _drop_in_row(
    mask: Bytes, channels: Bytes, mean: Steps, turn_noise: Levels, y: int, span: Ints, levels: Levels,
    ratio_min: np.float32, tangent: np.float32,
) -> None:  # fmt: skip
    """Clear what is shadow in a span of a row; without a branch, so that many pixels go at a time."""
    begin, end, white = span[0], span[1], np.float32(255)
    blue, green, red = channels[0, y, begin:end], channels[1, y, begin:end], channels[2, y, begin:end]
    mean_b, mean_g, mean_r = mean[0, y, begin:end], mean[1, y, begin:end], mean[2, y, begin:end]
    noise, marked = turn_noise[y, begin:end], mask[y, begin:end]
    for x in range(marked.size):
        b, g, r = np.float32(blue[x]), np.float32(green[x]), np.float32(red[x])
        mb, mg, mr = levels[0] * mean_b[x], levels[1] * mean_g[x], levels[2] * mean_r[x]
        along = b * mb + g * mg + r * mr
        expected = min(mb, white) * mb + min(mg, white) * mg + min(mr, white) * mr
        length2 = max(mb * mb + mg * mg + mr * mr, np.float32(1))
        along_levels = along / np.sqrt(length2)
        across2 = b * b + g * g + r * r - along_levels * along_levels
        allowed = along_levels * tangent + _SHADOW_SIGMAS * noise[x]
        is_shadow = (along < expected) & (along >= ratio_min * expected) & (across2 <= allowed * allowed)
        marked[x] &= not is_shadow
