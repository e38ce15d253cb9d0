"""Compiled search for connected patches in masks, row by row: specks go, holes are filled.

A mask is a handful of runs per row, and joining runs takes a tenth of the time of labelling pixels.
"""

from typing import TypeAlias

import cv2
import numba
import numpy as np

from services.mocap.types import Bytes, Ints, Mask

_ROW, _BEGIN, _END, _PARENT, _AREA, _AT_BORDER = range(6)


Part: TypeAlias = tuple[slice, slice]
"""Rows and columns of a picture."""


def box_of(mask: Mask | Bytes, margin_px: int) -> Part | None:
    """Rows and columns that hold all that is set in a mask (H, W), and a margin; None where nothing is."""
    left, top, across, down = cv2.boundingRect(mask.view(np.uint8))
    if across == 0:
        return None
    height, width = mask.shape
    return (
        slice(max(top - margin_px, 0), min(top + down + margin_px, height)),
        slice(max(left - margin_px, 0), min(left + across + margin_px, width)),
    )


@numba.njit(cache=True, nogil=True)
def drop_specks(mask: Bytes, least_px: float) -> None:
    """Clear the 8-connected patches of a mask (H, W) below an area."""
    runs = _joined_runs(mask, 1, 1)
    for i in range(len(runs)):
        if runs[_root(runs, i), _AREA] < least_px:
            mask[runs[i, _ROW], runs[i, _BEGIN] : runs[i, _END]] = 0


@numba.njit(cache=True, nogil=True)
def drop_unconfirmed(mask: Bytes, seeds: Bytes, least_px: float) -> None:
    """Clear the 8-connected patches of a mask (H, W) in which fewer pixels of another one (H, W) are set."""
    runs = _joined_runs(mask, 1, 1)
    confirmed = np.zeros(len(runs), np.int64)
    for i in range(len(runs)):
        confirmed[_root(runs, i)] += seeds[runs[i, _ROW], runs[i, _BEGIN] : runs[i, _END]].sum()
    for i in range(len(runs)):
        if confirmed[_root(runs, i)] < least_px:
            mask[runs[i, _ROW], runs[i, _BEGIN] : runs[i, _END]] = 0


@numba.njit(cache=True, nogil=True)
def fill_holes(mask: Bytes, least_px: float) -> None:
    """Set the holes of a mask (H, W) below an area: 4-connected, and off its border.

    Four-connected outside goes with eight-connected inside: a diagonal line of actor closes a hole.
    """
    runs = _joined_runs(mask, 0, 0)
    for i in range(len(runs)):
        root = _root(runs, i)
        if runs[root, _AREA] < least_px and not runs[root, _AT_BORDER]:
            mask[runs[i, _ROW], runs[i, _BEGIN] : runs[i, _END]] = 1


@numba.njit(cache=True, nogil=True)
def _joined_runs(mask: Bytes, value: int, reach: int) -> Ints:
    """The runs (N, 6) of a value in a mask; those at the root of a patch know all of its area and border.

    reach: 1 joins runs that touch at a corner, 0 does not.
    """
    height, width = mask.shape
    # As many as could be: memory that is not written costs nothing, and counting costs as much as finding.
    runs = np.empty((height * (width // 2 + 1), 6), np.int32)
    before, row_start, n = 0, 0, 0
    for y in range(height):
        before, row_start = row_start, n
        x = 0
        while x < width:
            if mask[y, x] != value:
                x += 1
                continue
            begin = x
            while x < width and mask[y, x] == value:
                x += 1
            at_border = y == 0 or y == height - 1 or begin == 0 or x == width
            runs[n, _ROW], runs[n, _BEGIN], runs[n, _END] = y, begin, x
            runs[n, _PARENT], runs[n, _AREA], runs[n, _AT_BORDER] = n, x - begin, at_border
            n += 1
        _join_rows(runs, before, row_start, n, reach)
    return runs[:n]


@numba.njit(cache=True, nogil=True)
def _join_rows(runs: Ints, first: int, second: int, end: int, reach: int) -> None:
    """Join the runs first to second of a row with those of the next row, second to end."""
    above, below = first, second
    while above < second and below < end:
        begins_in_time = runs[above, _BEGIN] < runs[below, _END] + reach
        if begins_in_time and runs[below, _BEGIN] < runs[above, _END] + reach:
            _join(runs, above, below)
        if runs[above, _END] < runs[below, _END]:
            above += 1
        else:
            below += 1


@numba.njit(cache=True, nogil=True)
def _join(runs: Ints, one: int, other: int) -> None:
    low, high = _root(runs, one), _root(runs, other)
    if low == high:
        return
    low, high = min(low, high), max(low, high)
    runs[high, _PARENT] = low
    runs[low, _AREA] += runs[high, _AREA]
    runs[low, _AT_BORDER] |= runs[high, _AT_BORDER]


@numba.njit(cache=True, nogil=True)
def _root(runs: Ints, run: int) -> int:
    while runs[run, _PARENT] != run:
        runs[run, _PARENT] = runs[runs[run, _PARENT], _PARENT]
        run = runs[run, _PARENT]
    return run
