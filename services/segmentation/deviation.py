"""Compiled passes that compare a picture with its plate: what has changed, and whether shadow explains it."""

import numba
import numpy as np

from services.mocap.types import Bytes
from services.segmentation.pixels import MEAN_STEPS, WHITENING_STEPS, Levels, Steps

LEAST_RATIO, MOST_RATIO = np.float32(0.35), np.float32(0.97)
"""Brightness in shadow over that in light."""
UNSEEN, UNCHANGED, CHANGED, PERHAPS_EDGE, PERHAPS_SHADOW = range(5)
"""What a pixel shows: nothing that was looked at; the stage in light; something else, which may be a shadow's
edge, or shadow."""
_SLOPE, _EVEN_DEVIATION2 = np.float32(0.25), np.float32(8.0)
"""Evidence for a change per squared deviation, and the deviation that tells nothing (three channels)."""
_LEAST, _MOST = np.float32(-1.5), np.float32(4.0)
"""Of evidence for a change in one pixel."""
_MOST_MISFIT = np.float32(8.0 / 3.0)
"""Times the noise, squared, on average over three channels: more is no shadow."""
_MOST_OWN_MISFIT = np.float32(16.0)
"""The same of one pixel, summed over three channels."""

N_PRODUCTS = 3
SEEN, BOTH, KNOWN = range(N_PRODUCTS)
"""Planes of a pixel's products, summed over channels: of its colour with itself and with what is expected
there, and of the latter with itself."""


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def compare(
    channels: Bytes, mean: Steps, whitening: Steps, gains: Levels, field: Levels, expected: Steps,
    deviation2: Levels, change: Levels,
) -> None:  # fmt: skip
    """Compare a picture (3, H, W) with its plate under a light field (H, W) at gains (3,).

    Writes the colours that the plate should have (3, H, W), in steps; squared deviations (H, W) from these;
    and each pixel's evidence for a change (H, W).
    """
    for y in range(channels.shape[1]):
        for c in range(3):
            _expect(mean[c, y], gains[c], field[y], expected[c, y])
        _deviate(channels, expected, whitening, y, deviation2[y])
        for x in range(deviation2.shape[1]):
            evidence = _SLOPE * (deviation2[y, x] - _EVEN_DEVIATION2)
            evidence = evidence if evidence > _LEAST else _LEAST
            change[y, x] = evidence if evidence < _MOST else _MOST


# A loop for each result over rows that lie in one piece: so the compiler takes many pixels at a time.


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _expect(mean: Steps, gain: np.float32, field: Levels, expected: Steps) -> None:
    """Write a row (W,) of one channel that the plate should have."""
    top = np.float32(255 * MEAN_STEPS)
    for x in range(field.size):
        level = gain * field[x] * np.float32(mean[x])
        expected[x] = np.int16(level if level < top else top)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _deviate(channels: Bytes, expected: Steps, whitening: Steps, y: int, deviation2: Levels) -> None:
    """Write a row (W,) of squared deviations."""
    scale, whiten = np.float32(1 / MEAN_STEPS), np.float32(1 / WHITENING_STEPS)
    blue, green, red = channels[0, y], channels[1, y], channels[2, y]
    plate_b, plate_g, plate_r = expected[0, y], expected[1, y], expected[2, y]
    bb, gb, gg = whitening[0, y], whitening[1, y], whitening[2, y]
    rb, rg, rr = whitening[3, y], whitening[4, y], whitening[5, y]
    for x in range(deviation2.size):
        d0 = whiten * (np.float32(blue[x]) - scale * np.float32(plate_b[x]))
        d1 = whiten * (np.float32(green[x]) - scale * np.float32(plate_g[x]))
        d2 = whiten * (np.float32(red[x]) - scale * np.float32(plate_r[x]))
        e0 = np.float32(bb[x]) * d0
        e1 = np.float32(gb[x]) * d0 + np.float32(gg[x]) * d1
        e2 = np.float32(rb[x]) * d0 + np.float32(rg[x]) * d1 + np.float32(rr[x]) * d2
        deviation2[x] = e0 * e0 + e1 * e1 + e2 * e2


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def multiply(channels: Bytes, expected: Steps, corner_px: tuple[int, int], products: Levels) -> None:
    """Write the products (N_PRODUCTS, h, w) of a picture's part; corner_px: its first row and column."""
    top, left = corner_px
    for i in range(products.shape[1]):
        seen, both, known = products[0, i], products[1, i], products[2, i]
        _multiply(channels, expected, top + i, left, seen, both, known)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _multiply(
    channels: Bytes, expected: Steps, y: int, left: int, seen: Levels, both: Levels, known: Levels
) -> None:
    """Write a part of a row (w,) of each of the products."""
    scale, columns = np.float32(1 / MEAN_STEPS), slice(left, left + seen.size)
    blue, green, red = channels[0, y, columns], channels[1, y, columns], channels[2, y, columns]
    plate_b, plate_g, plate_r = expected[0, y, columns], expected[1, y, columns], expected[2, y, columns]
    for x in range(seen.size):
        b, g, r = np.float32(blue[x]), np.float32(green[x]), np.float32(red[x])
        m0 = scale * np.float32(plate_b[x])
        m1 = scale * np.float32(plate_g[x])
        m2 = scale * np.float32(plate_r[x])
        seen[x] = b * b + g * g + r * r
        both[x] = b * m0 + g * m1 + r * m2
        known[x] = m0 * m0 + m1 * m1 + m2 * m2 + np.float32(1)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def judge(
    change: Levels, least: float, products: Levels, around: Levels, turn_noise: Levels,
    corner_px: tuple[int, int], ratio: Levels, state: Bytes,
) -> None:  # fmt: skip
    """Write what pixels show (H, W), and the brightness (H, W) of the square about each over the expected.

    change (H, W): more than `least` is a change. products (N_PRODUCTS, h, w) of the pixels in a part of the
    picture, and around them on average; corner_px: its first row and column. In shadow the background keeps
    its colour and its texture: little is left once it is darkened.
    """
    for i in range(products.shape[1]):
        for k in range(products.shape[2]):
            y, x = corner_px[0] + i, corner_px[1] + k
            noise2 = turn_noise[y, x] * turn_noise[y, x]
            share = around[1, i, k] / around[2, i, k]
            left = (around[0, i, k] - share * around[1, i, k]) / np.float32(3)
            own = products[1, i, k] / products[2, i, k]
            own_left = products[0, i, k] - own * products[1, i, k]
            is_shadow = (share > LEAST_RATIO) & (share < MOST_RATIO) & (left < _MOST_MISFIT * noise2)
            is_edge = (own > LEAST_RATIO) & (own < np.float32(1.02)) & (own_left < _MOST_OWN_MISFIT * noise2)
            changed = change[y, x] > least
            dark = PERHAPS_SHADOW if is_shadow else (PERHAPS_EDGE if is_edge else CHANGED)
            ratio[y, x] = share
            state[y, x] = dark if changed else UNCHANGED
