"""Compiled sums along pixel rows: from where outlines cross them to which pixels are covered."""

from typing import TypeAlias

import numba
import numpy as np

from services.mocap.energy.cost import Counts
from services.mocap.energy.cpu.arrays import Shorts
from services.mocap.types import Bytes, Ints

Canvas: TypeAlias = tuple[Shorts, Ints]
"""Winding (H, W + 1 or a little more): what crosses each row of a picture from one column to the next, by its
sign; and the spans (H, 3) of the rows."""
COUNT, LEFT, RIGHT = range(3)
"""Columns of spans: how many crossings a row has, and the first and the last column that has one."""
NO_SPAN: Ints = np.array([0, 1 << 16, 0], np.int32)

_COLUMNS_PER_WORD = 4


def empty_canvas(height_px: int, width_px: int) -> Canvas:
    """Room for what outlines leave behind in a picture: nothing yet.

    Column W of the winding holds what crosses right of the picture; rows end on whole words, so that empty
    stretches can be passed over four columns at a time.
    """
    words = width_px // _COLUMNS_PER_WORD + 1
    return np.zeros((height_px, words * _COLUMNS_PER_WORD), np.int16), np.tile(NO_SPAN, (height_px, 1))


def summed_gain(gain: Counts) -> Counts:
    """What the pixels left of each column gain in all (C, H, columns of empty_canvas), of gain (C, H, W)."""
    n_cameras, height_px, width_px = gain.shape
    sums = np.zeros((n_cameras, *empty_canvas(height_px, width_px)[0].shape), np.int32)
    np.cumsum(gain, axis=2, out=sums[:, :, 1 : width_px + 1])
    return sums


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def collect_gain(canvas: Canvas, extent: Ints, gain_sums: Counts) -> int:
    """Sum the gain of covered pixels and empty the canvas.

    extent: first row and last row + 1 of what is not empty. gain_sums (H, columns): one camera's summed_gain.
    """
    winding, spans = canvas
    words = winding.view(np.uint64)
    total = 0
    for r in range(extent[0], extent[1]):
        row, depth = np.uint32(r), 0
        count, left, right = spans[row, COUNT], np.uint32(spans[row, LEFT]), np.uint32(spans[row, RIGHT])
        spans[row, COUNT], spans[row, LEFT], spans[row, RIGHT] = NO_SPAN[0], NO_SPAN[1], NO_SPAN[2]
        if count == 2:  # in and out again, as in most rows of most segments
            total += gain_sums[row, right] - gain_sums[row, left]
            winding[row, left] = winding[row, right] = 0
        elif count:
            for w in range(left // _COLUMNS_PER_WORD, right // _COLUMNS_PER_WORD + 1):
                word = np.uint32(w)
                if words[row, word] == 0:
                    continue
                for k in range(_COLUMNS_PER_WORD):
                    x = np.uint32(_COLUMNS_PER_WORD * w + k)
                    was_covered = depth > 0
                    depth += winding[row, x]
                    total += (int(was_covered) - int(depth > 0)) * gain_sums[row, x]
                words[row, word] = 0
    return total


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def collect_bits(canvas: Canvas, extent: Ints, plane: Bytes, bit: np.uint8) -> None:
    """Set the bit of covered pixels in plane (H, W), and empty the canvas; extent as in collect_gain."""
    winding, spans = canvas
    for row in range(extent[0], extent[1]):
        depth, left, right = 0, spans[row, LEFT], spans[row, RIGHT]
        for x in range(left, right):
            depth += winding[row, x]
            if depth > 0:
                plane[row, x] |= bit
        winding[row, left : right + 1] = 0
        spans[row] = NO_SPAN
