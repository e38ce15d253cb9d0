"""Compiled matching of a model's rim with the input's contours, one camera after the other."""

from math import sqrt
from typing import TypeAlias

import numba
import numpy as np

from services.mocap.body.kinematics import SURFACE_FRAMES
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import count_by_camera
from services.mocap.energy.cpu.outline import compose
from services.mocap.energy.picture import Picture, Region
from services.mocap.njit import njit_without_refcounts
from services.mocap.search.alignment.contour import distance_to_contour, meets_unsure
from services.mocap.search.alignment.twists import TWIST_SIZE
from services.mocap.types import Bytes, Floats, Indices, Ints, Singles

RimArrays: TypeAlias = tuple[Singles, Floats, Floats, Floats, Ints]
"""Every segment's E edges, the candidates for the rim, concatenated, in the segment's frame: normal and
offset (n, d) of the faces on both sides (8, E), where n . x > d in front of a face; the middles (3, E) in
metres; from there to an end (3, E); the sum of both faces' unit normals (3, E); and where each segment's
edges begin, and their number (segments + 1,)."""
Views: TypeAlias = tuple[Floats, Floats, Floats, Ints]
"""Projections (C, 3, 4), centres in the world (C, 3), weights (C,) and the pictures' sizes (C, 2)."""
Input: TypeAlias = tuple[Bytes, Bytes, Ints]
"""Bit-planes (P, H, W) of the input's silhouettes and of its unsure pixels, and whether a camera has any of
these (C,)."""
Matches: TypeAlias = tuple[Ints, Ints, Floats, Floats, Floats]
"""Room for one camera's matches: per match the edge and the frame (E,), the residual and the length of
outline in pixels (E,), and the row of the Jacobian by the frame's twist (E, 6)."""
RimScratch: TypeAlias = tuple[Bytes, Indices, Floats, Singles]
"""(E,) flags, (E + 1,) edges found, a projection (3, 4) and where the camera is (3,)."""
SHARES = 3
"""Columns of what is said of a segment's rim: KNOWN, ON, UNSURE."""
KNOWN, ON, UNSURE = range(SHARES)
"""Its length where the input's contour may be known, what of that lies near a contour; and the length where
unsure pixels hide it."""

_NEAREST_M = 0.1
"""Rim points nearer to a camera's plane are left out."""
_OFF_PX = 1.0
"""At this distance from the surface, an outline point of the whole silhouette is outside the model."""
OWN_REACH_PX = 2
"""A rim point without a contour of the drawn model this near is not on the outline of the whole
silhouette."""
_BORDER_PX = 2.0
"""This near to a picture's border, an outline may be the end of the picture."""


def views_of(rig: Rig, region: Region, weights: Floats) -> Views:
    """The cameras as match_view takes them, of which each counts by its weight (C,)."""
    P_px_world = region.projections(rig)
    centres_world_m = -np.linalg.solve(P_px_world[:, :, :3], P_px_world[:, :, 3:])[:, :, 0]
    window = np.array([region.width_px, region.height_px])
    sizes_px: Ints = np.minimum(rig.sizes_px - region.origin_px, window).astype(np.int32)
    return P_px_world, np.ascontiguousarray(centres_world_m), weights, sizes_px


def input_of(picture: Picture) -> Input:
    """What is seen, as match_view takes it."""
    unsure = np.zeros_like(picture.silhouettes) if picture.unsure is None else np.array(picture.unsure)
    is_unsure = count_by_camera(unsure, len(picture.region.origin_px))
    return np.array(picture.silhouettes), unsure, is_unsure  # for Numba a read-only array has another type


def room_for(rim: RimArrays) -> tuple[RimScratch, Matches]:
    """What matching a rim needs room for."""
    n_edges = rim[0].shape[1]
    scratch = (np.zeros(n_edges, np.uint8), np.zeros(n_edges + 1, np.uint32), np.zeros((3, 4)))
    edges, frames = np.zeros(n_edges, np.int32), np.zeros(n_edges, np.int32)
    matches = (edges, frames, np.zeros(n_edges), np.zeros(n_edges), np.zeros((n_edges, TWIST_SIZE)))
    return (*scratch, np.zeros(3, np.float32)), matches


@njit_without_refcounts
def match_view(
    c: int,
    rim: RimArrays,
    surfaces: Ints,
    T_world_frame: Floats,
    views: Views,
    seen: Input,
    model_planes: Bytes,
    reach_px: int,
    near_px: float,
    scratch: RimScratch,
    matches: Matches,
    shares_px: Floats,
) -> int:
    """Write the matches of camera c and return how many there are; add to shares_px (S + 5, SHARES).

    surfaces: whose rim counts. near_px: a rim point lies on the contour if the model's contour is less than
    this far from the input's. seen and model_planes (P, H, W): the input and the whole model in the same
    region. A rim point that comes to unsure pixels before it comes to the input's contour has no match. A
    residual r is the distance of the model's contour beyond the input's, both measured in pixels, so that it
    is zero where the model covers exactly the input's pixels. Lengths are weighted by the camera.
    """
    P_px_world, centres_world_m, weights, sizes_px = views
    input_planes, unsure, is_unsure = seen
    edges, frames, residuals_px, lengths_px, rows = matches
    found, M = scratch[1], scratch[2]
    width, height = sizes_px[c, 0] - 1 - _BORDER_PX, sizes_px[c, 1] - 1 - _BORDER_PX
    n = 0
    for s in surfaces:
        frame = SURFACE_FRAMES[s]
        T = T_world_frame[frame]
        compose(P_px_world[c], T, M)
        for k in range(_find_rim(rim, s, T, centres_world_m[c], scratch)):
            e = found[k]
            is_inside, u, v, nx, ny, depth_m, outline_px = _project(rim, e, M, width, height)
            if not is_inside:
                continue
            column, row = int(u + _OFF_PX * nx + 0.5), int(v + _OFF_PX * ny + 0.5)
            if (model_planes[c >> 3, row, column] >> (c & 7)) & 1:
                continue
            own_px = distance_to_contour(model_planes, c, u, v, nx, ny, OWN_REACH_PX)
            if own_px != own_px:
                continue
            length_px = outline_px * weights[c]
            input_px = distance_to_contour(input_planes, c, u, v, nx, ny, reach_px)
            if is_unsure[c] and meets_unsure(unsure, c, u, v, nx, ny, input_px, reach_px):
                shares_px[s, UNSURE] += length_px
                continue
            shares_px[s, KNOWN] += length_px
            r = own_px - input_px
            if r != r:
                continue
            shares_px[s, ON] += length_px * (abs(r) < near_px)
            edges[n], frames[n], residuals_px[n], lengths_px[n] = e, frame, r, length_px
            _write_row(rim, e, T, P_px_world[c], u, v, nx, ny, depth_m, rows[n])
            n += 1
    return n


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _find_rim(rim: RimArrays, s: int, T: Floats, centre_world_m: Floats, scratch: RimScratch) -> int:
    """Find the edges of segment s that separate a front face from a back face."""
    planes, starts = rim[0], rim[4]
    flags, found, eye = scratch[0], scratch[1], scratch[3]
    x, y, z = 0.0, 0.0, 0.0
    for i in range(3):
        off_m = centre_world_m[i] - T[i, 3]
        x, y, z = x + T[i, 0] * off_m, y + T[i, 1] * off_m, z + T[i, 2] * off_m
    eye[0], eye[1], eye[2] = x, y, z
    _flag(planes, starts[s], starts[s + 1], eye, flags)
    n = 0
    for e in range(starts[s], starts[s + 1]):
        found[n] = e
        n += flags[e]
    return n


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _flag(planes: Singles, first: int, last: int, eye: Singles, flags: Bytes) -> None:
    x, y, z = eye
    for i in range(first, last):
        e = np.uint32(i)
        along = planes[0, e] * x + planes[1, e] * y + planes[2, e] * z > planes[3, e]
        against = planes[4, e] * x + planes[5, e] * y + planes[6, e] * z > planes[7, e]
        flags[e] = along != against


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _project(
    rim: RimArrays, e: int, M: Floats, width: float, height: float
) -> tuple[bool, float, float, float, float, float, float]:
    """Whether an edge is well within the picture; then u, v, the normal (x, y) that points off the model,
    depth and length of outline."""
    middles_m, halves_m, outward = rim[1], rim[2], rim[3]
    outside = (False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    x, y, z = middles_m[0, e], middles_m[1, e], middles_m[2, e]
    depth_m = M[2, 0] * x + M[2, 1] * y + M[2, 2] * z + M[2, 3]
    if depth_m < _NEAREST_M:
        return outside
    u = (M[0, 0] * x + M[0, 1] * y + M[0, 2] * z + M[0, 3]) / depth_m
    v = (M[1, 0] * x + M[1, 1] * y + M[1, 2] * z + M[1, 3]) / depth_m
    if u < _BORDER_PX or v < _BORDER_PX or u > width or v > height:
        return outside
    nx, ny = _direction(M, u, v, outward[0, e], outward[1, e], outward[2, e])
    length = sqrt(nx * nx + ny * ny)
    if length < 1e-9:
        return outside
    nx, ny = nx / length, ny / length
    du, dv = _direction(M, u, v, halves_m[0, e], halves_m[1, e], halves_m[2, e])
    # Edges zigzag around the outline: only their component along it counts.
    return True, u, v, nx, ny, depth_m, 2.0 * abs(du * ny - dv * nx) / depth_m


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _direction(M: Floats, u: float, v: float, x: float, y: float, z: float) -> tuple[float, float]:
    """The image of a direction (x, y, z) of the segment at (u, v), times the depth there."""
    along = M[2, 0] * x + M[2, 1] * y + M[2, 2] * z
    return (
        M[0, 0] * x + M[0, 1] * y + M[0, 2] * z - u * along,
        M[1, 0] * x + M[1, 1] * y + M[1, 2] * z - v * along,
    )


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _write_row(
    rim: RimArrays,
    e: int,
    T: Floats,
    P: Floats,
    u: float,
    v: float,
    nx: float,
    ny: float,
    depth_m: float,
    row: Floats,
) -> None:
    """Write how the residual of an edge's middle X grows with a twist of it in the world.

        row = (X x f, f),    f = (nx (p1 - u p3) + ny (p2 - v p3)) / depth

    with the rows p1, p2, p3 of P's left (3, 3).
    """
    middles_m = rim[1]
    x, y, z = middles_m[0, e], middles_m[1, e], middles_m[2, e]
    for i in range(3):
        row[3 + i] = (nx * (P[0, i] - u * P[2, i]) + ny * (P[1, i] - v * P[2, i])) / depth_m
    X = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
    Y = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
    Z = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
    row[0] = Y * row[5] - Z * row[4]
    row[1] = Z * row[3] - X * row[5]
    row[2] = X * row[4] - Y * row[3]
