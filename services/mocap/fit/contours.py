"""Outlines of silhouettes: points between pixels, each with the direction that leads off the actor."""

from dataclasses import dataclass
from math import ceil

import cv2
import numba
import numpy as np

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, camera_bit
from services.mocap.sampling import evenly
from services.mocap.types import Floats, Ints, Longs, Mask, Singles

BORDER_PX = 2.0
"""This near to a picture's border, in pixels of the camera, an outline may be the picture's end."""
_NORMAL_REACH_PX = 1.5
"""Silhouettes are blurred by this standard deviation to locate their outline and its normal."""
_UNSURE_PX = 2.0
"""This near to unsure pixels, in working pixels, an outline may be their end."""
_FARTHEST_PX = 1.0
"""Smoothing moves a point of an outline at most this far."""
_LEAST_STEEP = 0.02
"""Smaller gradients of the blurred silhouette, per pixel, do not locate its 0.5 level; edges have 0.27."""
_ROOM_PX = 8
"""Margin around the actor when a picture is cropped: more than normals reach."""
TURN_PX = 12.0
"""How many working pixels a small turn, by a radian, counts for when the nearest point of an outline is
looked for."""


@dataclass(frozen=True, eq=False)
class Contour:
    """One camera's outline of the actor in one frame."""

    points_px: Floats
    """(N, 2) one for each pixel on the actor and neighbour off it, smoothed."""
    normals: Floats
    """(N, 2) unit vectors that point off the actor."""
    chosen: Ints
    """Indices of the points that are matched with the model, evenly spread."""
    length_px: float
    """Length of the outline in working pixels."""
    scale: float
    """Pixels of the camera per working pixel."""
    near_unsure: Mask | None = None
    """(H, W) unsure pixels and those about them, where no outline is known; None: there are none."""

    @classmethod
    def of(cls, silhouette: Mask, scale: float, n_chosen: int, unsure: Mask | None = None) -> "Contour":
        """The outline in a picture (H, W), without unsure pixels; scale: see above."""
        points_px, normals = outline_of(silhouette)
        near_unsure = None
        if unsure is not None and unsure.any():
            # Near unsure pixels an outline is smoothed with them or borders on them.
            size = 1 + 2 * ceil(max(_UNSURE_PX * scale, 2 * _NORMAL_REACH_PX))
            kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
            near_unsure = np.asarray(cv2.dilate(unsure.astype(np.uint8), kernel) > 0)
            known = ~look_up(near_unsure, points_px)
            points_px, normals = points_px[known], normals[known]
        chosen = evenly(len(points_px), n_chosen)
        length_px = outline_length_px(len(points_px), scale)
        return cls(points_px, normals, chosen, length_px, scale, near_unsure)


def look_up(mask: Mask, points_px: Floats) -> Mask:
    """Which points (…, 2) lie on a mask (H, W); beyond the picture it is as at its edge."""
    height, width = mask.shape
    pixels = np.rint(points_px).astype(np.int64)
    on_mask: Mask = mask[pixels[..., 1].clip(0, height - 1), pixels[..., 0].clip(0, width - 1)]
    return on_mask


def outline_length_px(n_points: int, scale: float) -> float:
    """The length of an outline of so many points, in working pixels."""
    # Slanted lines separate more neighbours: on average 4 / π per pixel of length.
    return n_points * float(np.pi) / 4 / scale


def nearest_facing(
    points_px: Floats, normals: Floats, others_px: Floats, facing: Floats, turn_px: float, reach_px: float
) -> Longs:
    """(N,) which of M other points (M, 2) is nearest to each of some points (N, 2); -1 if none is in reach.

    Both have unit vectors. The distance is sqrt(|p - q|^2 + turn_px^2 |n - m|^2) of points p, q with unit
    vectors n, m; reach_px limits it.
    """
    if len(others_px) == 0:
        return np.full(len(points_px), -1)
    first_row, starts, order, others = _in_rows(others_px, facing, turn_px)
    return _nearest(points_px, normals, first_row, starts, order, others, turn_px, reach_px)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _in_rows(points_px: Floats, normals: Floats, turn_px: float) -> tuple[int, Longs, Longs, Floats]:
    """Points (M, 2) by rows of pixels: the first row, where each row starts (rows + 1,), the points' indices
    (M,), and points with their normals times turn_px (M, 4)."""
    first_row = int(np.floor(points_px[:, 1].min()))
    starts = np.zeros(int(np.floor(points_px[:, 1].max())) - first_row + 2, np.int64)
    for m in range(len(points_px)):
        starts[int(np.floor(points_px[m, 1])) - first_row + 1] += 1
    starts = np.cumsum(starts)
    order, sorted_px, ends = np.empty(len(points_px), np.int64), np.empty((len(points_px), 4)), starts.copy()
    for m in range(len(points_px)):
        row = int(np.floor(points_px[m, 1])) - first_row
        k = ends[row]
        order[k], sorted_px[k, 0], sorted_px[k, 1] = m, points_px[m, 0], points_px[m, 1]
        sorted_px[k, 2], sorted_px[k, 3] = turn_px * normals[m, 0], turn_px * normals[m, 1]
        ends[row] += 1
    return first_row, starts, order, sorted_px


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _nearest(
    points_px: Floats,
    normals: Floats,
    first_row: int,
    starts: Longs,
    order: Longs,
    others: Floats,
    turn_px: float,
    reach_px: float,
) -> Longs:
    """nearest_facing among points in rows: people are upright, so few points are in one row."""
    nearest, n_rows = np.full(len(points_px), -1), len(starts) - 1
    for n in range(len(points_px)):
        x, y, u, v = points_px[n, 0], points_px[n, 1], turn_px * normals[n, 0], turn_px * normals[n, 1]
        row, best = int(np.floor(y)) - first_row, reach_px * reach_px
        for away in range(max(row, n_rows - 1 - row) + 1):
            if away > 1 and (away - 1.0) ** 2 >= best:
                break
            for side in range(1 + (away > 0)):
                other_row = row + away if side else row - away
                if not 0 <= other_row < n_rows:
                    continue
                for k in range(starts[other_row], starts[other_row + 1]):
                    dx, dy, du, dv = others[k, 0] - x, others[k, 1] - y, others[k, 2] - u, others[k, 3] - v
                    square = dx * dx + dy * dy + du * du + dv * dv
                    if square < best:
                        best, nearest[n] = square, order[k]
    return nearest


def contours_of(rig: Rig, seen: TriPlanes, n_chosen: int) -> list[list[Contour]]:
    """Per frame and camera the contour of what is seen (F, P, H, W)."""
    scales = rig.scales

    def contour(planes: TriPlanes, c: int) -> Contour:
        width, height = rig.sizes_px[c]
        actor, unsure = (camera_bit(p, c)[:height, :width] for p in (planes.silhouettes, planes.unsure))
        return Contour.of(actor, float(scales[c]), n_chosen, unsure)

    return [[contour(seen[f], c) for c in range(rig.n_cameras)] for f in range(len(seen))]


def outline_of(silhouette: Mask) -> tuple[Floats, Floats]:
    """(N, 2) points, one for each pixel on the actor and neighbour off it, and unit normals (N, 2).

    Points lie where the blurred silhouette is one half. Without that, outlines a tenth of a pixel apart would
    be equal except for single pixels, and nearest points would hardly show the difference.
    """
    # Only about the actor: pictures are large.
    left, top, width, height = cv2.boundingRect(silhouette.view(np.uint8))
    if width == 0:
        return np.zeros((0, 2)), np.zeros((0, 2))
    low = np.maximum([left - _ROOM_PX, top - _ROOM_PX], 0)
    part = silhouette[low[1] : top + height + _ROOM_PX, low[0] : left + width + _ROOM_PX]
    blurred = cv2.GaussianBlur(part.astype(np.float32), (0, 0), _NORMAL_REACH_PX)
    first_px = np.maximum(BORDER_PX - low, 0.0)
    last_px = np.array(silhouette.shape[::-1]) - 1 - BORDER_PX - low
    points_px, normals = _outline(part, np.asarray(blurred, np.float32), first_px, last_px)
    return points_px + low, normals


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _outline(part: Mask, blurred: Singles, first_px: Floats, last_px: Floats) -> tuple[Floats, Floats]:
    """The outline in a part of a picture (h, w) within a range of columns and rows: outline_of.

    First the points between columns, row by row, then those between rows. With v the blurred value at a point
    and g its gradient (Sobel's), both the means of its two pixels, the point moves by (v - 0.5) / |g| along
    the normal -g / |g|.
    """
    height, width = part.shape
    points_px, normals = np.empty((2 * height * width, 2)), np.empty((2 * height * width, 2))
    count = 0
    for down in range(2):
        for y in range(height - down):
            for x in range(width - 1 + down):
                if part[y, x] == part[y + down, x + 1 - down]:
                    continue
                u, v = x + 0.5 * (1 - down), y + 0.5 * down
                if u < first_px[0] or v < first_px[1] or u > last_px[0] or v > last_px[1]:
                    continue
                value = gx = gy = 0.0
                for row, column in ((y, x), (y + down, x + 1 - down)):
                    value += blurred[row, column] / 2.0
                    for k in range(-1, 2):
                        weight = (2 - abs(k)) / 16.0
                        gx += weight * (blurred[row + k, column + 1] - blurred[row + k, column - 1])
                        gy += weight * (blurred[row + 1, column + k] - blurred[row - 1, column + k])
                steepness = np.sqrt(gx * gx + gy * gy)
                shift_px = (value - 0.5) / max(steepness, _LEAST_STEEP)
                shift_px = min(max(shift_px, -_FARTHEST_PX), _FARTHEST_PX)
                normals[count, 0] = -gx / max(steepness, 1e-9)
                normals[count, 1] = -gy / max(steepness, 1e-9)
                points_px[count, 0] = u + shift_px * normals[count, 0]
                points_px[count, 1] = v + shift_px * normals[count, 1]
                count += 1
    return points_px[:count].copy(), normals[:count].copy()
