"""Compiled sums of what the contours pull at: from a pose to the normal equations of moving it."""

from math import sqrt
from typing import TypeAlias

import numba
import numpy as np

from services.mocap.body.kinematics import N_DOF, N_JOINTS, PARENT, SEGMENT_JOINTS
from services.mocap.energy.cpu.arrays import Indices, Singles
from services.mocap.energy.cpu.njit_without_refcounts import njit_without_refcounts
from services.mocap.energy.cpu.outline import compose
from services.mocap.search.alignment.contour import distance_to_contour, meets_unsure
from services.mocap.search.alignment.twists import DOF_JOINT, TWIST_SIZE, moved_by
from services.mocap.types import Bytes, Floats, Ints

RimArrays: TypeAlias = tuple[Singles, Floats, Floats, Floats, Ints]
"""A RimMesh as a plain tuple."""
Views: TypeAlias = tuple[Floats, Floats, Floats, Ints]
"""Projections (C, 3, 4), centres in the world (C, 3), weights (C,) and the pictures' sizes (C, 2)."""
Input: TypeAlias = tuple[Bytes, Bytes, Ints]
"""Bit-planes (P, H, W) of the input's silhouettes and of its unsure pixels, and whether a camera has any of
these (C,)."""
PullScratch: TypeAlias = tuple[Bytes, Indices, Floats, Floats, Floats, Singles]
"""Room for sum_pulls: (E,) flags, (E + 1,) edges found, a projection (3, 4), a rim point (8,), its row of the
Jacobian (6,) and where the camera is (3,)."""
SHARES = 4
"""Columns of what is said of a segment's rim: its length where the input's contour may be known, what of that
lies near a contour, what found none; and the length where unsure pixels hide it."""

_NEAREST_M = 0.1
"""Rim points nearer to a camera's plane are left out."""
_OFF_PX = 1.0
"""This far off the surface, an outline point of the whole silhouette is off the model."""
OWN_REACH_PX = 2
"""A rim point with no contour of the drawn model this near is not on the whole silhouette's outline."""
_BORDER_PX = 2.0
"""This near to a picture's border, an outline may be the picture's end."""
_NEAR_PX = 2.0
"""A rim point lies on the contour if the model's is no farther from the input's there."""
_MOVED_BY = moved_by()


@njit_without_refcounts
def sum_pulls(
    rim: RimArrays,
    segments: Ints,
    T_world_joint: Floats,
    views: Views,
    seen: Input,
    model_planes: Bytes,
    reach_px: int,
    cap_px: float,
    scratch: PullScratch,
    wrenches: Floats,
    pulls: Floats,
    shares_px: Floats,
) -> None:
    """Sum over all rim points what moving them would gain.

    segments: whose rim counts. seen and planes (P, H, W): the input and the whole model in the same region. A
    rim point that comes to unsure pixels before it comes to the input's contour pulls nothing. A residual
    r is how far the model's contour lies beyond the input's, both as their pixels show them: what pixels do
    to a contour is done to both, so that nothing pulls where the model covers just what is seen. It counts by
    a weight of 1 / (1 + (r / cap_px)^2) times its length of outline. Sets wrenches (J, 6, 6) and pulls
    (J, 6): per joint that carries segments the sums of weight w w^T (its lower half) and of weight r w over
    its rim points, w being the row of the Jacobian by the joint's twist; and shares_px (S, SHARES).
    """
    P_px_world, centres_world_m, weights, sizes_px = views
    wrenches[:], pulls[:], shares_px[:] = 0.0, 0.0, 0.0
    flags, found, M, point, w, eye = scratch
    input_planes, unsure, is_unsure = seen
    for c in range(len(P_px_world)):
        if weights[c] == 0.0:
            continue
        width, height = sizes_px[c, 0] - 1 - _BORDER_PX, sizes_px[c, 1] - 1 - _BORDER_PX
        for s in segments:
            T = T_world_joint[SEGMENT_JOINTS[s]]
            compose(P_px_world[c], T, M)
            for k in range(_find_rim(rim, s, T, centres_world_m[c], eye, flags, found)):
                e = found[k]
                if not _project(rim, e, M, width, height, point):
                    continue
                u, v, nx, ny = point[0], point[1], point[2], point[3]
                column, row = int(u + _OFF_PX * nx + 0.5), int(v + _OFF_PX * ny + 0.5)
                if (model_planes[c >> 3, row, column] >> (c & 7)) & 1:
                    continue
                own_px = distance_to_contour(model_planes, c, u, v, nx, ny, OWN_REACH_PX)
                if own_px != own_px:
                    continue
                along_px = point[5] * weights[c]
                input_px = distance_to_contour(input_planes, c, u, v, nx, ny, reach_px)
                if is_unsure[c] and meets_unsure(unsure, c, u, v, nx, ny, input_px, reach_px):
                    shares_px[s, 3] += along_px
                    continue
                shares_px[s, 0] += along_px
                r = own_px - input_px
                if r != r:
                    shares_px[s, 2] += along_px
                    continue
                shares_px[s, 1] += along_px * (abs(r) < _NEAR_PX)
                squares = (r / cap_px) ** 2
                _write_row(rim, e, T, P_px_world[c], point, w)
                joint = SEGMENT_JOINTS[s]
                _add(along_px / (1.0 + squares), r, w, wrenches[joint], pulls[joint])


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _find_rim(
    rim: RimArrays, s: int, T: Floats, centre_world_m: Floats, eye: Singles, flags: Bytes, found: Indices
) -> int:
    """Write the edges of segment s to found that have the camera before one of their two faces only.

    eye (3,) and flags (E,) are scratch.
    """
    planes, starts = rim[0], rim[4]
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
def _project(rim: RimArrays, e: int, M: Floats, width: float, height: float, point: Floats) -> bool:
    """Set point: u, v, the normal that points off the model, depth, and the length of outline.

    False for one that is not well within the picture.
    """
    middles_m, halves_m, outward = rim[1], rim[2], rim[3]
    x, y, z = middles_m[0, e], middles_m[1, e], middles_m[2, e]
    depth = M[2, 0] * x + M[2, 1] * y + M[2, 2] * z + M[2, 3]
    if depth < _NEAREST_M:
        return False
    u = (M[0, 0] * x + M[0, 1] * y + M[0, 2] * z + M[0, 3]) / depth
    v = (M[1, 0] * x + M[1, 1] * y + M[1, 2] * z + M[1, 3]) / depth
    if u < _BORDER_PX or v < _BORDER_PX or u > width or v > height:
        return False
    nx, ny = _direction(M, u, v, outward[0, e], outward[1, e], outward[2, e])
    length = sqrt(nx * nx + ny * ny)
    if length < 1e-9:
        return False
    nx, ny = nx / length, ny / length
    du, dv = _direction(M, u, v, halves_m[0, e], halves_m[1, e], halves_m[2, e])
    # Edges zigzag about the outline: what counts is their way along it.
    point[0], point[1], point[2], point[3], point[4] = u, v, nx, ny, depth
    point[5] = 2.0 * abs(du * ny - dv * nx) / depth
    return True


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _direction(M: Floats, u: float, v: float, x: float, y: float, z: float) -> tuple[float, float]:
    """Where a direction (x, y, z) of the segment leads in the picture at (u, v), times the depth there."""
    along = M[2, 0] * x + M[2, 1] * y + M[2, 2] * z
    return (
        M[0, 0] * x + M[0, 1] * y + M[0, 2] * z - u * along,
        M[1, 0] * x + M[1, 1] * y + M[1, 2] * z - v * along,
    )


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _write_row(rim: RimArrays, e: int, T: Floats, P: Floats, point: Floats, w: Floats) -> None:
    """How the residual of an edge grows with a twist: the moment and the force of its normal in the world."""
    middles_m = rim[1]
    u, v, nx, ny, depth = point[0], point[1], point[2], point[3], point[4]
    x, y, z = middles_m[0, e], middles_m[1, e], middles_m[2, e]
    for i in range(3):
        w[3 + i] = (nx * (P[0, i] - u * P[2, i]) + ny * (P[1, i] - v * P[2, i])) / depth
        point[5 + i] = T[i, 0] * x + T[i, 1] * y + T[i, 2] * z + T[i, 3]
    w[0] = point[6] * w[5] - point[7] * w[4]
    w[1] = point[7] * w[3] - point[5] * w[5]
    w[2] = point[5] * w[4] - point[6] * w[3]


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _add(weight: float, residual: float, w: Floats, wrench: Floats, pull: Floats) -> None:
    for i in range(TWIST_SIZE):
        weighted = weight * w[i]
        pull[i] += weighted * residual
        for k in range(i + 1):
            wrench[i, k] += weighted * w[k]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def normal_equations(twists: Floats, wrenches: Floats, pulls: Floats, hessian: Floats, slope: Floats) -> None:
    """Write the normal matrix (D, D) and the gradient (D,) of all parameters.

    wrenches and pulls as sum_pulls leaves them; what joints carry is summed down the tree in them (as in the
    composite rigid body algorithm: Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 6).
    """
    for j in range(N_JOINTS):
        for i in range(TWIST_SIZE):
            for k in range(i):
                wrenches[j, k, i] = wrenches[j, i, k]
    for j in range(N_JOINTS - 1, 0, -1):
        wrenches[PARENT[j]] += wrenches[j]
        pulls[PARENT[j]] += pulls[j]
    moved = np.empty(TWIST_SIZE)
    for d in range(N_DOF):
        joint = DOF_JOINT[d]
        for i in range(TWIST_SIZE):
            moved[i] = 0.0
            for k in range(TWIST_SIZE):
                moved[i] += wrenches[joint, i, k] * twists[d, k]
        slope[d] = _dot(twists[d], pulls[joint])
        for e in range(d + 1):
            value = _dot(twists[e], moved) if _MOVED_BY[DOF_JOINT[e], joint] else 0.0
            hessian[d, e] = hessian[e, d] = value


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _dot(a: Floats, b: Floats) -> float:
    total = 0.0
    for i in range(TWIST_SIZE):
        total += a[i] * b[i]
    return total


def pull_scratch(rim: RimArrays) -> PullScratch:
    """Room for what sum_pulls finds on a rim."""
    n_edges = rim[0].shape[1]
    flags, found = np.zeros(n_edges, np.uint8), np.zeros(n_edges + 1, np.uint32)
    return flags, found, np.zeros((3, 4)), np.zeros(8), np.zeros(TWIST_SIZE), np.zeros(3, np.float32)
