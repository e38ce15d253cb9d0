"""Compiled: each pixel's evidence weighed with its neighbours', by messages along rows and columns.

Min-sum belief propagation on a grid of two labels with a price w for neighbours of unlike labels. With
energies' differences between the labels as messages, one is clamp(h, -w, w), h being what its sender believes
without the receiver (Pearl, Probabilistic Reasoning in Intelligent Systems, 1988; Felzenszwalb, Huttenlocher,
Efficient Belief Propagation for Early Vision, IJCV 70, 2006). Sweeps carry a message through a row at a time,
so a few rounds do.
"""

import numba
import numpy as np

from services.mocap.types import Bytes
from services.segmentation.pixels import MEAN_STEPS, Levels, Steps

_PRICE = 3.0
"""For two neighbours of unlike labels where the picture shows no edge."""
_LEAST_SHARE = 0.15
"""Of that price, where it shows one."""
_EDGE_SIGMAS2 = 8.0


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def prices(
    channels: Bytes, expected: Steps, noise2: float, corner_px: tuple[int, int], across: Levels, down: Levels
) -> None:
    """Write the price (h, w) between each pixel and the next in its row, and the next in its column.

    An edge is where the difference from the plate jumps: outlines of the stage itself are none.
    """
    height, width = across.shape
    top, left = corner_px
    rate = np.float32(1.0 / (_EDGE_SIGMAS2 * noise2))
    scale = np.float32(1 / MEAN_STEPS)
    across[:], down[:] = 0, 0
    here, above = np.empty(width, np.float32), np.empty(width, np.float32)
    for c in range(3):
        for i in range(height):
            _difference(channels[c, top + i], expected[c, top + i], left, scale, here)
            for k in range(width - 1):
                across[i, k] += (here[k + 1] - here[k]) ** 2
            if i > 0:
                for k in range(width):
                    down[i - 1, k] += (here[k] - above[k]) ** 2
            above[:] = here
    one = np.float32(1)
    floor, price = np.float32(_LEAST_SHARE * _PRICE), np.float32((1 - _LEAST_SHARE) * _PRICE)
    for i in range(height):
        for k in range(width):
            across[i, k] = floor + price / (one + rate * across[i, k])
            down[i, k] = floor + price / (one + rate * down[i, k])


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _difference(channel: Bytes, expected: Steps, left: int, scale: np.float32, into: Levels) -> None:
    """Write how far a part of a row (w,) is off the plate, from a column on."""
    for k in range(into.size):
        into[k] = np.float32(channel[left + k]) - scale * np.float32(expected[left + k])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def beliefs(evidence: Levels, across: Levels, down: Levels, rounds: int) -> Levels:
    """What each pixel believes (h, w) after some rounds: positive for the actor, the surer the larger.

    evidence (h, w); prices across and down as `prices` writes them.
    """
    height, width = evidence.shape
    from_left, from_right = np.zeros_like(evidence), np.zeros_like(evidence)
    from_above, from_below = np.zeros_like(evidence), np.zeros_like(evidence)
    held = np.empty(width, np.float32)
    for _ in range(rounds):
        for y in range(height):
            for x in range(width):
                held[x] = evidence[y, x] + from_above[y, x] + from_below[y, x]
            # Both ways in one loop: each step waits for the one before it, but not for the other way's.
            to_right = to_left = np.float32(0)
            for x in range(width - 1):
                back = width - 1 - x
                to_right = _clamped(held[x] + to_right, across[y, x])
                to_left = _clamped(held[back] + to_left, across[y, back - 1])
                from_left[y, x + 1], from_right[y, back - 1] = to_right, to_left
        for y in range(height - 1):
            for x in range(width):
                believed = evidence[y, x] + from_left[y, x] + from_right[y, x] + from_above[y, x]
                from_above[y + 1, x] = _clamped(believed, down[y, x])
        for y in range(height - 1, 0, -1):
            for x in range(width):
                believed = evidence[y, x] + from_left[y, x] + from_right[y, x] + from_below[y, x]
                from_below[y - 1, x] = _clamped(believed, down[y - 1, x])
    return evidence + from_left + from_right + from_above + from_below


@numba.njit(cache=True, nogil=True, inline="always")
def _clamped(value: np.float32, most: np.float32) -> np.float32:
    low = value if value > -most else -most
    return low if low < most else most
