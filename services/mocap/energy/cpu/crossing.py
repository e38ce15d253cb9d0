"""Compiled walk along an outline: from edges that may be outline to where they cross pixel rows."""

import numba
import numpy as np

from services.mocap.energy.cpu.collecting import BITS, LOG2_BITS, Canvas
from services.mocap.energy.snapping import NEAR_M, SUBPIXEL, SUBPIXEL_BITS
from services.mocap.types import Floats, Indices, Ints

X, Y, DX, DY, FIRST, LAST, SIGN = range(7)
"""Columns of crossings: an edge's upper end and the way to its lower end, in 1/256 pixel; first row and last
row + 1 whose centres it crosses; +1 where it runs down with the front face on its left, -1 where up."""


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
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
        along, against = _sides(uv, a, b, c, d)
        n += _put(uv, a, b, along, height_px, crossings, n) & (along != against)
    return n


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def find_near_crossings(
    first: int, last: int, edges: Indices, uv: Ints, depth_m: Floats, height_px: int, crossings: Ints
) -> int:
    """The same for edges first to last where faces may lie about the near plane, with depth_m (V,)."""
    n = 0
    for edge in range(first, last):
        a, b, c, d = edges[edge, 0], edges[edge, 1], edges[edge, 2], edges[edge, 3]
        along, against = _sides(uv, a, b, c, d)
        before = min(depth_m[a], depth_m[b]) >= NEAR_M
        along, against = (
            along and before and depth_m[c] >= NEAR_M,
            against and before and depth_m[d] >= NEAR_M,
        )
        n += _put(uv, a, b, along, height_px, crossings, n) & (along != against)
    return n


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _sides(uv: Ints, a: int, b: int, c: int, d: int) -> tuple[bool, bool]:
    """Whether the faces (a, b, c) and (b, a, d) are front."""
    ax, ay = np.int64(uv[0, a]), np.int64(uv[1, a])
    abx, aby = uv[0, b] - ax, uv[1, b] - ay
    return abx * (uv[1, c] - ay) < (uv[0, c] - ax) * aby, abx * (uv[1, d] - ay) > (uv[0, d] - ax) * aby


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _put(uv: Ints, a: int, b: int, along: bool, height_px: int, crossings: Ints, n: int) -> bool:
    """Write the edge from a to b to row n of crossings; returns whether it crosses a pixel row."""
    ax, ay, bx, by = uv[0, a], uv[1, a], uv[0, b], uv[1, b]
    down = ay < by
    top, bottom = (ay, by) if down else (by, ay)
    first = max((top + SUBPIXEL - 1) >> SUBPIXEL_BITS, 0)
    last = min((bottom + SUBPIXEL - 1) >> SUBPIXEL_BITS, height_px)
    crossings[n, X], crossings[n, Y] = ax if down else bx, top
    crossings[n, DX], crossings[n, DY] = (bx - ax) if down else (ax - bx), bottom - top
    crossings[n, FIRST], crossings[n, LAST] = first, last
    crossings[n, SIGN] = 1 if down == along else -1
    return bool(first < last)


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def wind(crossings: Ints, n: int, canvas: Canvas) -> None:
    """Add the signs of n crossings to a canvas where they cross a row, and widen its extent.

    A crossing counts from the first pixel whose centre is not left of it, so that a centre on a left or top
    edge is inside and one on a right or bottom edge outside; right of the picture it leaves nothing.

    A column is a quotient of whole numbers, rounded up, and doubles get it right: a divisor has at most 37
    bits, so that below 65536 columns a quotient that is not whole is farther off a whole number than it is
    rounded; and a numerator too long to be exact stands for a column beyond any picture.
    """
    winding, crossed, extent, _ = canvas
    width_px = winding.shape[1]
    top, bottom = extent[0], extent[1]
    for i in range(n):
        x, y = np.int64(crossings[i, X]), np.int64(crossings[i, Y])
        dx, dy = np.int64(crossings[i, DX]), np.int64(crossings[i, DY])
        first, last, sign = crossings[i, FIRST], crossings[i, LAST], crossings[i, SIGN]
        top, bottom = min(top, first), max(bottom, last)
        divisor = dy << SUBPIXEL_BITS
        crossing, step = x * dy + ((first << SUBPIXEL_BITS) - y) * dx, dx << SUBPIXEL_BITS
        for row in range(first, last):
            column = np.int64(min(max(np.ceil(crossing / divisor), 0.0), float(width_px)))
            crossing += step
            if column < width_px:
                r, c = np.uint32(row), np.uint32(column)
                winding[r, c] += sign
                crossed[r, c >> np.uint32(LOG2_BITS)] |= np.uint64(1) << np.uint64(c & np.uint32(BITS - 1))
    extent[0], extent[1] = top, bottom
