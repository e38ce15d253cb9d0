"""Compiled bound of how far any point of one triangle mesh lies from another.

Pieces of triangles are cut until each is known to lie near enough: at the sides of the triangle below them,
so that it is a matter of one triangle, else in half.

Sampled distances (scipy's cKDTree) prove such a bound only with samples no farther apart than its slack: 2 %
of the smallest error that thinning.py allows is 0.03 mm, or about two thousand million samples on 2 m² of
skin.
"""

from math import sqrt

import numba
import numpy as np

from services.mocap.energy.detail.distance import DEPTH, Tree, closest, nearest
from services.mocap.types import Floats, Ints

_WAITING = 128  # pieces at once: each cut leaves one or two behind
_SLACK = 1.02  # of the bound over the greatest distance seen
_FINEST = 1.0 / 64.0  # of the enough distance: pieces smaller than that are not cut further
_OVERHANG = 0.3  # of what a flat piece may reach over a triangle's side: it is cut there
_THIN = 0.05  # parts of a side: nothing thinner is cut off


@numba.njit(cache=True, nogil=True, error_model="numpy")
def farthest_bound(corners_m: Floats, tree: Tree, enough_m: float, limit_m: float) -> float:
    """An upper bound of how far any point of triangles (F, 3, 3) lies from a tree's surface.

    About 2 % above the true maximum at most, or enough_m if that is more: what cannot be farther is not
    looked into. Infinity as soon as a point is seen farther than limit_m.

    Why it is a bound: the distance to one triangle is convex, so over a piece it is nowhere more than at the
    piece's corners; and the distance to the surface grows by no more than one walks. So the smaller of both
    holds, and a piece for which it is too large is cut.
    """
    bound, seen_m = 0.0, enough_m / _SLACK
    pieces, hints = np.empty((_WAITING, 3, 3)), np.zeros(_WAITING, np.int32)
    hint, stack = 0, np.empty(DEPTH, np.int32)
    for f in range(len(corners_m)):
        pieces[0], hints[0], waiting = corners_m[f], hint, 1
        while waiting:
            piece, hint = pieces[waiting - 1], hints[waiting - 1]
            within = _within(piece, tree[0][hint])
            if within > _SLACK * seen_m:
                hint, centre_m, radius_m = _centre_distance(piece, tree, hint, stack)
                if centre_m > limit_m:
                    return np.inf
                seen_m = max(seen_m, centre_m)
                within = min(within, _within(piece, tree[0][hint]), centre_m + radius_m)
                if within > _SLACK * seen_m and radius_m > _FINEST * enough_m and waiting < _WAITING - 1:
                    overhang_m = _OVERHANG * sqrt(max(seen_m**2 - centre_m**2, 0.0))
                    n = _cut(pieces, waiting, tree[0][hint], overhang_m)
                    hints[waiting - 1 : waiting + n] = hint
                    waiting += n
                    continue
            bound = max(bound, within)
            waiting -= 1
    return bound


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _within(piece: Floats, triangle: Floats) -> float:
    """How far a triangle (3, 3) reaches from another one at most."""
    farthest_sq = 0.0
    for i in range(3):
        farthest_sq = max(farthest_sq, closest(piece[i, 0], piece[i, 1], piece[i, 2], triangle)[2])
    return float(sqrt(farthest_sq))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _centre_distance(piece: Floats, tree: Tree, hint: int, stack: Ints) -> tuple[int, float, float]:
    """The triangle nearest to a piece's centre, its distance, and the piece's radius about the centre."""
    x, y, z = (
        (piece[0, 0] + piece[1, 0] + piece[2, 0]) / 3.0,
        (piece[0, 1] + piece[1, 1] + piece[2, 1]) / 3.0,
        (piece[0, 2] + piece[1, 2] + piece[2, 2]) / 3.0,
    )
    radius_sq = 0.0
    for i in range(3):
        dx, dy, dz = piece[i, 0] - x, piece[i, 1] - y, piece[i, 2] - z
        radius_sq = max(radius_sq, dx * dx + dy * dy + dz * dz)
    found, distance_sq = nearest(x, y, z, tree, hint, stack)
    return found, sqrt(distance_sq), sqrt(radius_sq)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _cut(pieces: Floats, n: int, triangle: Floats, overhang_m: float) -> int:
    """Cut the last of n pieces in two or three, appended; returns by how many there are more.

    If it hangs over one side of the triangle, by more than overhang_m, then there; else across its middle.
    """
    piece, lone, share_1, share_2 = pieces[n - 1], -1, 0.0, 0.0
    farthest = overhang_m
    for side in range(3):
        s0, s1, s2 = _beyond_side(piece, triangle, side)
        highest = max(s0, s1, s2)
        if not highest > farthest:
            continue
        candidate, first, second = _lone_corner(s0 - overhang_m, s1 - overhang_m, s2 - overhang_m)
        if candidate >= 0 and min(first, second) > _THIN and min(first, second) < 1.0 - _THIN:
            farthest, lone, share_1, share_2 = highest, candidate, first, second
    if lone < 0:
        _halve(pieces, n)
        return 1
    pieces[n], pieces[n + 1] = piece, piece
    i, j = (lone + 1) % 3, (lone + 2) % 3
    for k in range(3):
        at_1 = piece[lone, k] + share_1 * (piece[i, k] - piece[lone, k])
        at_2 = piece[lone, k] + share_2 * (piece[j, k] - piece[lone, k])
        pieces[n, lone, k] = at_1  # at_1, 1, 2
        pieces[n + 1, lone, k], pieces[n + 1, i, k] = at_2, at_1  # at_2, at_1, 2
        piece[i, k], piece[j, k] = at_1, at_2  # the lone corner, at_1, at_2
    return 2


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _beyond_side(piece: Floats, t: Floats, side: int) -> tuple[float, float, float]:
    """How far a piece's corners reach over a side of a triangle, along the triangle's plane."""
    i, j = (side + 1) % 3, (side + 2) % 3
    ex, ey, ez = t[i, 0] - t[side, 0], t[i, 1] - t[side, 1], t[i, 2] - t[side, 2]
    fx, fy, fz = t[side, 0] - t[j, 0], t[side, 1] - t[j, 1], t[side, 2] - t[j, 2]
    along = (ex * fx + ey * fy + ez * fz) / max(ex * ex + ey * ey + ez * ez, 1e-30)
    nx, ny, nz = fx - along * ex, fy - along * ey, fz - along * ez
    scale = 1.0 / max(sqrt(nx * nx + ny * ny + nz * nz), 1e-15)
    nx, ny, nz = nx * scale, ny * scale, nz * scale
    d = nx * t[side, 0] + ny * t[side, 1] + nz * t[side, 2]
    return (
        nx * piece[0, 0] + ny * piece[0, 1] + nz * piece[0, 2] - d,
        nx * piece[1, 0] + ny * piece[1, 1] + nz * piece[1, 2] - d,
        nx * piece[2, 0] + ny * piece[2, 1] + nz * piece[2, 2] - d,
    )


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _lone_corner(s0: float, s1: float, s2: float) -> tuple[int, float, float]:
    """The corner that zero separates from both others, -1 for none, and where on the ways to the next one
    and the one after that."""
    if (s0 > 0.0) == (s1 > 0.0):
        return (2, s2 / (s2 - s0), s2 / (s2 - s1)) if (s2 > 0.0) != (s0 > 0.0) else (-1, 0.0, 0.0)
    if (s0 > 0.0) == (s2 > 0.0):
        return 1, s1 / (s1 - s2), s1 / (s1 - s0)
    return 0, s0 / (s0 - s1), s0 / (s0 - s2)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _halve(pieces: Floats, n: int) -> None:
    """Cut the last of n pieces across the middle of its longest side; the second half becomes piece n."""
    piece, longest_sq, start = pieces[n - 1], -1.0, 0
    for i in range(3):
        j = (i + 1) % 3
        dx, dy, dz = piece[i, 0] - piece[j, 0], piece[i, 1] - piece[j, 1], piece[i, 2] - piece[j, 2]
        length_sq = dx * dx + dy * dy + dz * dz
        if length_sq > longest_sq:
            longest_sq, start = length_sq, i
    end = (start + 1) % 3
    pieces[n] = piece
    for k in range(3):
        middle = (piece[start, k] + piece[end, k]) / 2.0
        piece[end, k], pieces[n, start, k] = middle, middle
