"""Compiled walk along an outline: from edges that may be outline to where they cross pixel rows."""

import numba
import numpy as np

from services.mocap.energy.arrays import Indices, Shorts
from services.mocap.energy.snapping import NEAR_M, SUBPIXEL, SUBPIXEL_BITS
from services.mocap.types import Floats, Ints

X, Y, DX, DY, FIRST, LAST, SIGN = range(7)
"""Columns of crossings: an edge's upper end and the way to its lower end, in 1/256 pixel; first row and last
row + 1 whose centres it crosses; +1 where it runs down with the front face on its left, -1 where up."""


@numba.njit(cache=True, nogil=True, error_model="numpy")
def find_crossings(
    found: Indices, n_found: int, edges: Indices, uv: Ints, height_px: int, crossings: Ints
) -> int:
    """Keep those of the found edges that are outline and cross a pixel row; returns how many.

    uv (2, V): snapped vertices. A face is front when its corners run counter-clockwise on the screen, where y
    points down. Every edge writes to the next free row of crossings (E + 1, 7); only those kept move on.
    """
    n = 0
    for i in range(n_found):
        a, b, c, d = edges[found[i], 0], edges[found[i], 1], edges[found[i], 2], edges[found[i], 3]
        ax, ay = np.int64(uv[0, a]), np.int64(uv[1, a])
        bx, by = np.int64(uv[0, b]), np.int64(uv[1, b])
        along = (bx - ax) * (uv[1, c] - ay) < (uv[0, c] - ax) * (by - ay)
        against = (bx - ax) * (uv[1, d] - ay) > (uv[0, d] - ax) * (by - ay)
        n += _put(ax, ay, bx, by, along, height_px, crossings, n) & (along != against)
    return n


@numba.njit(cache=True, nogil=True, error_model="numpy")
def find_near_crossings(
    first: int, last: int, edges: Indices, uv: Ints, depth_m: Floats, height_px: int, crossings: Ints
) -> int:
    """The same for edges first to last where faces may lie about the near plane, with depth_m (V,)."""
    n = 0
    for edge in range(first, last):
        a, b, c, d = edges[edge, 0], edges[edge, 1], edges[edge, 2], edges[edge, 3]
        before = min(depth_m[a], depth_m[b]) >= NEAR_M
        ax, ay = np.int64(uv[0, a]), np.int64(uv[1, a])
        bx, by = np.int64(uv[0, b]), np.int64(uv[1, b])
        along = (bx - ax) * (uv[1, c] - ay) < (uv[0, c] - ax) * (by - ay) and before and depth_m[c] >= NEAR_M
        against = (
            (bx - ax) * (uv[1, d] - ay) > (uv[0, d] - ax) * (by - ay) and before and depth_m[d] >= NEAR_M
        )
        n += _put(ax, ay, bx, by, along, height_px, crossings, n) & (along != against)
    return n


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _put(
    ax: np.int64,
    ay: np.int64,
    bx: np.int64,
    by: np.int64,
    along: bool,
    height_px: int,
    crossings: Ints,
    n: int,
) -> bool:
    """Write an edge to a row of crossings; returns whether it crosses a pixel row."""
    down = ay < by
    top, bottom = min(ay, by), max(ay, by)
    first = max((top + SUBPIXEL - 1) >> SUBPIXEL_BITS, 0)
    last = min((bottom + SUBPIXEL - 1) >> SUBPIXEL_BITS, height_px)
    crossings[n, X], crossings[n, Y] = ax if down else bx, top
    crossings[n, DX], crossings[n, DY] = (bx - ax) if down else (ax - bx), bottom - top
    crossings[n, FIRST], crossings[n, LAST] = first, last
    crossings[n, SIGN] = 1 if down == along else -1
    return first < last


@numba.njit(cache=True, nogil=True, error_model="numpy")
def wind(crossings: Ints, n: int, width_px: int, winding: Shorts, extent: Ints) -> None:
    """Add the signs of n crossings to winding where they cross a row, and widen the extent.

    A crossing counts from the first pixel whose centre is not left of it, so that a centre on a left or top
    edge is inside and one on a right or bottom edge outside; at width_px, if it is right of the picture. extent: first row, last row + 1, first column,
    last column + 1 of what has been touched.
    """
    for i in range(n):
        x, y = np.int64(crossings[i, X]), np.int64(crossings[i, Y])
        dx, dy = np.int64(crossings[i, DX]), np.int64(crossings[i, DY])
        first, last, sign = crossings[i, FIRST], crossings[i, LAST], crossings[i, SIGN]
        extent[0], extent[1] = min(extent[0], first), max(extent[1], last)
        divisor = np.uint64(dy << SUBPIXEL_BITS)
        for row in range(first, last):
            crossing = x * dy + ((row << SUBPIXEL_BITS) - y) * dx
            column = np.int64((np.uint64(max(crossing, 0)) + divisor - np.uint64(1)) // divisor)
            column = min(column, width_px)
            extent[2], extent[3] = min(extent[2], column), max(extent[3], column + 1)
            winding[np.uint32(row), np.uint32(column)] += sign
