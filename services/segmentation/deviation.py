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
    and
    products (N_PRODUCTS, H, W).
    """
    levels = gains / np.float32(MEAN_STEPS)
    top, steps = np.float32(255), np.float32(MEAN_STEPS)
    scale = np.float32(1) / np.float32(WHITENING_STEPS)
    for y in range(channels.shape[1]):
        for x in range(channels.shape[2]):
            light = field[y, x]
            b, g, r = (
                np.float32(channels[0, y, x]),
                np.float32(channels[1, y, x]),
                np.float32(channels[2, y, x]),
            )
            m0 = levels[0] * light * mean[0, y, x]
            m0 = m0 if m0 < top else top
            m1 = levels[1] * light * mean[1, y, x]
            m1 = m1 if m1 < top else top
            m2 = levels[2] * light * mean[2, y, x]
            m2 = m2 if m2 < top else top
            expected[0, y, x] = np.int16(m0 * steps)
            expected[1, y, x] = np.int16(m1 * steps)
            expected[2, y, x] = np.int16(m2 * steps)
            products[0, y, x] = b * b + g * g + r * r
            products[1, y, x] = b * m0 + g * m1 + r * m2
            products[2, y, x] = m0 * m0 + m1 * m1 + m2 * m2 + np.float32(1)
            e0 = scale * whitening[0, y, x] * (b - m0)
            e1 = scale * (whitening[1, y, x] * (b - m0) + whitening[2, y, x] * (g - m1))
            e2 = scale * (whitening[3, y, x] * (b - m0) + whitening[4, y, x] * (g - m1))
            e2 += scale * whitening[5, y, x] * (r - m2)
            deviation2[y, x] = e0 * e0 + e1 * e1 + e2 * e2


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
