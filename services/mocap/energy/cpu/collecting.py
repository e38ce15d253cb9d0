"""Compiled sums along pixel rows: from where outlines cross them to which pixels are covered."""

import numba
import numpy as np

from services.mocap.energy.cost import Counts
from services.mocap.energy.cpu.arrays import Shorts
from services.mocap.types import Bytes, Ints

_COLUMNS_PER_WORD = 4


def empty_winding(height_px: int, width_px: int) -> Shorts:
    """Scratch (H, W + 1 or a little more) int16, all zero: a row of crossings for every row of a picture.

    Column W holds what crosses right of the picture; rows end on whole words, so that empty stretches can be
    passed over four columns at a time.
    """
    words = width_px // _COLUMNS_PER_WORD + 1
    return np.zeros((height_px, words * _COLUMNS_PER_WORD), np.int16)


def summed_gain(gain: Counts) -> Counts:
    """What the pixels left of each column gain in all (C, H, columns of empty_winding), of gain (C, H, W)."""
    n_cameras, height_px, width_px = gain.shape
    sums = np.zeros((n_cameras, *empty_winding(height_px, width_px).shape), np.int32)
    np.cumsum(gain, axis=2, out=sums[:, :, 1 : width_px + 1])
    return sums


@numba.njit(cache=True, nogil=True, error_model="numpy")
def collect_gain(winding: Shorts, extent: Ints, gain_sums: Counts) -> int:
    """Sum the gain of covered pixels and set winding back to zero.

    extent: first row, last row + 1, first column, last column + 1 of what is not zero. gain_sums (H,
    columns): one camera's summed_gain.
    """
    words = winding.view(np.uint64)
    total = 0
    for r in range(extent[0], extent[1]):
        row, depth = np.uint32(r), 0
        for w in range(extent[2] // _COLUMNS_PER_WORD, -(-extent[3] // _COLUMNS_PER_WORD)):
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


@numba.njit(cache=True, nogil=True, error_model="numpy")
def collect_bits(winding: Shorts, extent: Ints, plane: Bytes, bit: np.uint8) -> None:
    """Set the bit of covered pixels in plane (H, W), and winding back to zero; extent as in collect_gain."""
    width_px = plane.shape[1]
    for row in range(extent[0], extent[1]):
        depth = 0
        for x in range(extent[2], min(extent[3], width_px)):
            depth += winding[row, x]
            if depth > 0:
                plane[row, x] |= bit
        winding[row, extent[2] : extent[3]] = 0
