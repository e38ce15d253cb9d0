"""Compiled sums along pixel rows: from where outlines cross them to which pixels are covered."""

from collections.abc import Callable
from typing import Any, TypeAlias, cast

import numba
import numpy as np
from llvmlite import ir
from numba.extending import intrinsic

from services.mocap.types import Bytes, Ints, Shorts, Words

Canvas: TypeAlias = tuple[Shorts, Words, Ints, Ints]
"""winding (H, W): signed outline crossings at the left edge of each pixel; a pixel is covered where the
running sum of its row is positive. crossed (H, words): a bit for every column of a row that is crossed.
extent (2,): the first row and the last row + 1 of those that may be crossed. spans (w // 2 + 1, 2): room for
those of a row. Crossings right of the picture leave nothing."""
BITS, LOG2_BITS = 64, 6
"""Of a word."""


def _lowest_bit(_context: Any, _word: Any) -> Any:
    def generate(_: Any, builder: ir.IRBuilder, __: Any, arguments: Any) -> Any:
        zero_is_undefined = ir.Constant(ir.IntType(1), 1)
        return builder.cttz(arguments[0], zero_is_undefined)

    return numba.uint64(numba.uint64), generate


lowest_bit = cast(Callable[[np.uint64], np.uint64], intrinsic(_lowest_bit))
"""The number of the lowest bit that is set; one has to be. For compiled code only."""


def empty_canvas(height_px: int, width_px: int) -> Canvas:
    """Room for what outlines leave behind in a picture: nothing yet."""
    crossed = np.zeros((height_px, -(-width_px // BITS)), np.uint64)
    extent, spans = np.array([height_px, 0], np.int32), np.zeros((width_px // 2 + 1, 2), np.int32)
    return np.zeros((height_px, width_px), np.int16), crossed, extent, spans


def summed_gain(gain: Ints) -> Ints:
    """Row prefix sums (C, H, W + 1) of gain (C, H, W): sums[c, y, x] = gain[c, y, :x].sum()."""
    n_cameras, height_px, width_px = gain.shape
    sums = np.zeros((n_cameras, height_px, width_px + 1), np.int32)
    np.cumsum(gain, axis=2, out=sums[:, :, 1:])
    return sums


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def collect_gain(canvas: Canvas, gain_sums: Ints) -> int:
    """Sum the gain of covered pixels and empty the canvas; gain_sums (H, W + 1): one camera's summed_gain."""
    winding, crossed, extent, _ = canvas
    total = 0
    for r in range(extent[0], extent[1]):
        row, depth = np.uint32(r), 0
        for w in range(crossed.shape[1]):
            word = np.uint32(w)
            bits = crossed[row, word]
            crossed[row, word] = 0
            while bits:
                column = np.uint32(BITS * word + lowest_bit(bits))
                bits &= bits - np.uint64(1)
                was_covered = depth > 0
                depth += winding[row, column]
                winding[row, column] = 0
                total += (int(was_covered) - int(depth > 0)) * gain_sums[row, column]
        if depth > 0:  # up to the picture's end
            total += gain_sums[row, winding.shape[1]]
    extent[0], extent[1] = winding.shape[0], 0
    return total


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def row_spans(canvas: Canvas, row: int) -> int:
    """Write from and to where pixels of a row are covered into the canvas's spans, empty the row, and return
    how many spans there are."""
    winding, crossed, _, spans = canvas
    depth, n = 0, 0
    for word in range(crossed.shape[1]):
        bits = crossed[row, word]
        crossed[row, word] = 0
        while bits:
            column = int(BITS * word + lowest_bit(bits))
            bits &= bits - np.uint64(1)
            was_covered = depth > 0
            depth += winding[row, column]
            winding[row, column] = 0
            if was_covered and not depth > 0:
                spans[n, 1] = column
                n += 1
            elif depth > 0 and not was_covered:
                spans[n, 0] = column
    if depth > 0:
        spans[n, 1] = winding.shape[1]
        n += 1
    return n


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def collect_bits(canvas: Canvas, plane: Bytes, bit: np.uint8) -> None:
    """Set the bit of covered pixels in plane (H, W), and empty the canvas."""
    extent, spans = canvas[2], canvas[3]
    for row in range(extent[0], extent[1]):
        for k in range(row_spans(canvas, row)):
            for x in range(spans[k, 0], spans[k, 1]):
                plane[row, x] |= bit
    extent[0], extent[1] = plane.shape[0], 0
