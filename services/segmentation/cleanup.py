"""Turns a raw foreground mask into a silhouette by removing specks and small holes.

Areas are relative to the picture, so that one set of values serves 320x240 and 1920x1080. Connected patches
are found row by row: a mask is a handful of runs per row, and joining runs takes a tenth of the time of
labelling pixels.
"""

from typing import TypeAlias

import cv2
import numba
import numpy as np

from services.mocap.types import Bytes, Ints, Mask

_ROW, _BEGIN, _END, _PARENT, _AREA, _AT_BORDER = range(6)
"""Columns of a table of runs."""

SPECK_AREA_PPM, HOLE_AREA_PPM = 200.0, 100.0
"""Millionths of the picture's area (15 and 7 px of 320x240): smaller patches of foreground go, and smaller
holes are filled."""

Part: TypeAlias = tuple[slice, slice]
"""Rows and columns of a picture."""


def cleanup(mask: Mask, speck_ppm: float = SPECK_AREA_PPM, hole_ppm: float = HOLE_AREA_PPM) -> Mask:
    """A silhouette (H, W) without specks and small holes; the mask (H, W) itself stays as it is.

    Nothing is eroded or dilated: thin limbs keep their width, and a gap between arm and body or between
    the legs stays open unless it is smaller than hole_ppm and off the picture's border. Cleaning
    twice changes nothing more, and a larger mask never gives a smaller silhouette.
    """
    clean = mask.astype(np.uint8)
    cleanup_in_place(clean, mask.size, speck_ppm, hole_ppm)
    return clean.view(np.bool_)


def cleanup_in_place(
    part: Bytes, picture_px: int, speck_ppm: float = SPECK_AREA_PPM, hole_ppm: float = HOLE_AREA_PPM
) -> None:
    """Clean a mask (h, w) of zeros and ones: a whole picture of picture_px pixels, or the part of it that is
    set."""
    drop_specks(part, speck_ppm * 1e-6 * picture_px)
    _fill_holes(part, hole_ppm * 1e-6 * picture_px)


def box_of(mask: Mask | Bytes, margin_px: int) -> Part | None:
    """Bounding rows and columns of a mask (H, W), with a margin; None if it is empty."""
    left, top, across, down = cv2.boundingRect(mask.view(np.uint8))
    if across == 0:
        return None
    height, width = mask.shape
    return (
        slice(max(top - margin_px, 0), min(top + down + margin_px, height)),
        slice(max(left - margin_px, 0), min(left + across + margin_px, width)),
    )


def opened(mask: Mask | Bytes, size_px: int) -> Bytes:
    """A mask (H, W) without what squares of a size do not fit into, as zeros and ones."""
    square = np.ones((size_px, size_px), np.uint8)
    return np.asarray(cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_OPEN, square), np.uint8)


def drop_specks(mask: Bytes, least_px: float) -> None:
    """Clear the 8-connected patches of a mask (H, W) below an area."""
    drop_unconfirmed(mask, mask, least_px)


@numba.njit(cache=True, nogil=True)
def drop_unconfirmed(mask: Bytes, seeds: Bytes, least_px: float) -> None:
    """Clear the 8-connected patches of a mask (H, W) in which fewer pixels of another one (H, W) are set."""
    runs = _joined_runs(mask, 1)
    confirmed = np.zeros(len(runs), np.int64)
    for i in range(len(runs)):
        confirmed[_root(runs, i)] += seeds[runs[i, _ROW], runs[i, _BEGIN] : runs[i, _END]].sum()
    for i in range(len(runs)):
        if confirmed[_root(runs, i)] < least_px:
            mask[runs[i, _ROW], runs[i, _BEGIN] : runs[i, _END]] = 0


@numba.njit(cache=True, nogil=True)
def _fill_holes(mask: Bytes, least_px: float) -> None:
    """Set the holes of a mask (H, W) below an area: 4-connected, and off its border."""
    runs = _joined_runs(mask, 0)
    for i in range(len(runs)):
        root = _root(runs, i)
        if runs[root, _AREA] < least_px and not runs[root, _AT_BORDER]:
            mask[runs[i, _ROW], runs[i, _BEGIN] : runs[i, _END]] = 1


@numba.njit(cache=True, nogil=True)
def _joined_runs(mask: Bytes, value: int) -> Ints:
    """The runs (N, 6) of a value in a mask; the root run of a patch has its total area and border.

    Runs of 1 that touch at a corner are one patch, runs of 0 are not: a diagonal line of actor closes a hole.
    """
    height, width = mask.shape
    # The largest possible number: unused memory costs nothing, and counting takes as long as finding.
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
        _join_rows(runs, before, row_start, n, value)
    return runs[:n]


@numba.njit(cache=True, nogil=True)
def _join_rows(runs: Ints, first: int, second: int, end: int, reach: int) -> None:
    """Join the runs first to second of a row with those of the next row, second to end, that touch them.

    reach: 1 joins runs that touch at a corner, 0 does not.
    """
    above, below = first, second
    while above < second and below < end:
        begins_in_time = runs[above, _BEGIN] < runs[below, _END] + reach
        if begins_in_time and runs[below, _BEGIN] < runs[above, _END] + reach:
            one, other = _root(runs, above), _root(runs, below)
            if one != other:
                low, high = min(one, other), max(one, other)
                runs[high, _PARENT] = low
                runs[low, _AREA] += runs[high, _AREA]
                runs[low, _AT_BORDER] |= runs[high, _AT_BORDER]
        if runs[above, _END] < runs[below, _END]:
            above += 1
        else:
            below += 1


@numba.njit(cache=True, nogil=True)
def _root(runs: Ints, run: int) -> int:
    while runs[run, _PARENT] != run:
        runs[run, _PARENT] = runs[runs[run, _PARENT], _PARENT]
        run = runs[run, _PARENT]
    return run
