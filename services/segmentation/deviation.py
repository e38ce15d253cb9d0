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
    deviation2: Levels, products: Levels,
) -> None:  # fmt: skip
    """Compare a picture (3, H, W) with its plate under a light field (H, W) at gains (3,).

    Writes the colours that the plate should have (3, H, W), in steps; squared deviations (H, W) from these;
    and products (N_PRODUCTS, H, W).
    """
    for y in range(channels.shape[1]):
        for c in range(3):
            _expect(mean[c, y], gains[c], field[y], expected[c, y])
        _deviate(channels, expected, whitening, y, deviation2[y])
        _multiply(channels, expected, y, products[0, y], products[1, y], products[2, y])


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
def _multiply(channels: Bytes, expected: Steps, y: int, seen: Levels, both: Levels, known: Levels) -> None:
    """Write a row (W,) of each of the products."""
    scale = np.float32(1 / MEAN_STEPS)
    blue, green, red = channels[0, y], channels[1, y], channels[2, y]
    plate_b, plate_g, plate_r = expected[0, y], expected[1, y], expected[2, y]
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
    change: Levels,
    least: float,
    products: Levels,
    around: Levels,
    turn_noise: Levels,
    ratio: Levels,
    state: Bytes,
) -> None:
    """Write what each pixel shows (H, W), and the brightness (H, W) of the square about it over the expected.

    change (H, W): more than `least` is a change. products (N_PRODUCTS, H, W) of pixels, and around them on
    average. In shadow the background keeps its colour and its texture: little is left once it is darkened.
    """
    for y in range(state.shape[0]):
        for x in range(state.shape[1]):
            noise2 = turn_noise[y, x] * turn_noise[y, x]
            share = around[1, y, x] / around[2, y, x]
            left = (around[0, y, x] - share * around[1, y, x]) / np.float32(3)
            own = products[1, y, x] / products[2, y, x]
            own_left = products[0, y, x] - own * products[1, y, x]
            is_shadow = (share > LEAST_RATIO) & (share < MOST_RATIO) & (left < _MOST_MISFIT * noise2)
            is_edge = (own > LEAST_RATIO) & (own < np.float32(1.02)) & (own_left < _MOST_OWN_MISFIT * noise2)
            changed = change[y, x] > least
            dark = PERHAPS_SHADOW if is_shadow else (PERHAPS_EDGE if is_edge else CHANGED)
            ratio[y, x] = share
            state[y, x] = dark if changed else UNCHANGED
