"""Compiled search in silhouettes for the contour that a point of the rim belongs to."""

from math import ceil, floor, nan

import numba

from services.mocap.types import Bytes

_FINE_PX = 0.5
"""Steps along the normal in which the interpolated silhouette is sampled about a contour."""


@numba.njit(cache=True, nogil=True, error_model="numpy")
def distance_to_contour(
    silhouettes: Bytes, camera: int, x: float, y: float, nx: float, ny: float, reach_px: int
) -> float:
    """Distance along a normal to the contour that faces the same way; negative: in the opposite direction.

    silhouettes: bit-planes (P, H, W). (x, y) in pixels; (nx, ny) a unit vector that points off the model.
    The nearest point where the silhouette ends in the normal's direction, up to reach_px in both directions;
    NaN if there is none. The contour is the 0.5 level of the bilinearly interpolated silhouette.
    """
    plane, bit = camera >> 3, camera & 7
    before = _is_set(silhouettes, plane, bit, x, y)
    ahead, behind = before, before
    for step in range(1, reach_px + 1):
        onward = _is_set(silhouettes, plane, bit, x + step * nx, y + step * ny)
        if ahead and not onward:
            return _refined(silhouettes, plane, bit, x, y, nx, ny, step - 1.0)
        ahead = onward
        back = _is_set(silhouettes, plane, bit, x - step * nx, y - step * ny)
        if back and not behind:
            return _refined(silhouettes, plane, bit, x, y, nx, ny, -step * 1.0)
        behind = back
    return nan


@numba.njit(cache=True, nogil=True, error_model="numpy")
def meets_unsure(
    unsure: Bytes, camera: int, x: float, y: float, nx: float, ny: float, contour_px: float, reach_px: int
) -> bool:
    """Whether an unsure pixel lies on the way to the contour, so that the true contour may be nearer.

    unsure: bit-planes (P, H, W); the others and contour_px as distance_to_contour takes and gives them. If
    there is a contour, the way extends one pixel beyond it, because interpolation uses these pixels.
    """
    plane, bit = camera >> 3, camera & 7
    steps = reach_px if contour_px != contour_px else ceil(abs(contour_px)) + 1
    for step in range(steps + 1):
        if _is_set(unsure, plane, bit, x + step * nx, y + step * ny):
            return True
        if _is_set(unsure, plane, bit, x - step * nx, y - step * ny):
            return True
    return False


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _is_set(planes: Bytes, plane: int, bit: int, x: float, y: float) -> bool:
    """The pixel at (x, y); outside the picture the nearest edge pixel."""
    column = min(max(int(x + 0.5), 0), planes.shape[2] - 1)
    row = min(max(int(y + 0.5), 0), planes.shape[1] - 1)
    return bool((planes[plane, row, column] >> bit) & 1)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _refined(
    planes: Bytes, plane: int, bit: int, x: float, y: float, nx: float, ny: float, low: float
) -> float:
    """Where between low - 1/2 and low + 3/2 the interpolated silhouette falls through a half."""
    t, before = low - _FINE_PX, 1.0
    value = _interpolated(planes, plane, bit, x + t * nx, y + t * ny)
    if value < 0.5:
        return t
    for _ in range(4):
        before, t = value, t + _FINE_PX
        value = _interpolated(planes, plane, bit, x + t * nx, y + t * ny)
        if value < 0.5:
            return t - _FINE_PX * (0.5 - value) / (before - value)
    return t


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _interpolated(planes: Bytes, plane: int, bit: int, x: float, y: float) -> float:
    left, top = floor(x), floor(y)
    right_share, low_share = x - left, y - top
    column = min(max(int(left), 0), planes.shape[2] - 2)
    row = min(max(int(top), 0), planes.shape[1] - 2)
    a, b = (planes[plane, row, column] >> bit) & 1, (planes[plane, row, column + 1] >> bit) & 1
    c, d = (planes[plane, row + 1, column] >> bit) & 1, (planes[plane, row + 1, column + 1] >> bit) & 1
    upper = (1.0 - right_share) * a + right_share * b
    lower = (1.0 - right_share) * c + right_share * d
    return float((1.0 - low_share) * upper + low_share * lower)
