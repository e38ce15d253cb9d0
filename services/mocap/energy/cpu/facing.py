"""Compiled search for the edges that may be outline: with the camera before one of their two faces only.

What counts as front is decided by the snapped corners on the screen. For nearly every face the side of its
plane on which the camera's centre lies decides it as well, without projecting anything; and one look at the
planes of a block of edges that face the same way mostly tells that there is no outline among them. Only what
is too close to call is left to whoever looks at the corners.
"""

from functools import lru_cache
from math import sqrt

import numba
import numpy as np

from services.mocap.camera.rig import Rig
from services.mocap.energy.cpu.mesh import BLOCK
from services.mocap.energy.picture import Region
from services.mocap.energy.snapping import LIMIT_STEPS, NEAR_M, SUBPIXEL
from services.mocap.types import Bytes, Floats, Indices, Singles

HIDDEN, NEAR, SEEN = 0, 1, 2
"""How a camera sees a segment: not at all; as one that may reach behind the near plane; wholly before it."""
M11, M22, M33, M12, M13, M23, STEEPNESS, LEFT, RIGHT, TOP, BOTTOM, DETERMINANT, CENTRE_X = range(13)
"""Columns of a lens, as lenses_of makes it; the centre's y and z follow its x."""
LENS_SIZE = CENTRE_X + 3
X, Y, Z, W, GUARD, ROUNDING, PX_PER_M = range(7)
"""Places in an eye, as look sets it."""
EYE_SIZE = PX_PER_M + 1
_MARGIN_PX = 2.0
"""How far outside of a picture's edges its four planes lie, from the pixel centres at the edge: a pixel and a
half of margin is more than what snapping moves."""
_SNAP_ERROR_PX = 0.501 / SUBPIXEL
"""Half a step, and a little for the rounding of floats before it."""
_SINGLE_ERROR = 2.0**-19
"""Of a plane at a point in single precision, against the sum of the sizes of its terms: twice what can be."""


@lru_cache(maxsize=32)  # recognised by identity; do not write into what it returns
def cameras_of(rig: Rig, region: Region) -> tuple[Floats, Floats]:
    """Projections (C, 3, 4) to a region's pixels, and lenses."""
    P_px_world = region.projections(rig)
    return P_px_world, lenses_of(P_px_world, region.width_px, region.height_px)


def lenses_of(P_px_world: Floats, width_px: int, height_px: int) -> Floats:
    """What stays the same of cameras (C, 3, 4) however a segment is turned: (C, LENS_SIZE).

    Products of the rows m1, m2, m3 of a projection's left (3, 3); lengths of m3 (STEEPNESS) and of the
    normals of four planes through the camera's centre, just outside of the picture's edges; the determinant;
    the camera's centre in the world.
    """
    rows = P_px_world[:, :, :3]
    gram = rows @ rows.transpose(0, 2, 1)
    sides = [
        rows[:, k] - edge * rows[:, 2]
        for k, size in ((0, width_px), (1, height_px))
        for edge in (-_MARGIN_PX, size - 1.0 + _MARGIN_PX)
    ]
    lengths = np.linalg.norm([rows[:, 2], *sides], axis=2).T
    centres_m = -np.linalg.solve(rows, P_px_world[:, :, 3:])[:, :, 0]
    products = gram[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return np.column_stack([products, lengths, np.linalg.det(rows), centres_m])


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def look(
    T_world_segment: Floats,
    M: Floats,
    lens: Floats,
    sphere_m: Floats,
    width_px: int,
    height_px: int,
    eye: Singles,
) -> int:
    """Say how a camera with M (3, 4), segment to homogeneous pixels, sees a segment; if SEEN set eye.

    lens: of the camera, from lenses_of. T_world_segment (4, 4) is a turn and a shift, so that M's rows have
    the lens's lengths. eye gets the homogeneous centre (X, Y, Z, W) of the camera, seen from the sphere's
    centre and times det(M), the GUARD, the ROUNDING that may come on top, and how many pixels a metre of the
    segment takes at most. A plane of FlatMesh.planes that is farther than guard plus rounding from zero at
    (C, w) has the sign that the face's doubled area on the screen has after snapping.

    Why. Let e be half a snapping step, a the doubled area of a face on the screen, and L its longest side
    there. Where snapping changes the sign of a, the corners, none of which moves by more than e in x or y,
    lie on one line on the way. So the face fits between two lines with unit normal n, and

        |a| <= 2 e (|nx| + |ny|) |L| <= 2 sqrt(2) e |L|.

    With the rows m of M, one end (u, v) of a side l on the screen, and the depth z of its other end,

        L = (m1 - u m3, m2 - v m3) · l / z,    |L| <= stretch |l| / z,

    where stretch is the largest singular value of the two rows in brackets. With the corners' depths z1, z2,
    z3 and the face's plane n · x - d, its doubled area as n's length,

        n · C - d w = -z1 z2 z3 a.

    Planes are divided by the longest side |l|. So their value is at most z_max² 2 sqrt(2) e stretch in size
    where the sign may change; beyond that it can be trusted.
    """
    hx, hy, hz = _homogeneous(M, 0, sphere_m), _homogeneous(M, 1, sphere_m), _homogeneous(M, 2, sphere_m)
    radius, steepness = sphere_m[3], lens[STEEPNESS]
    z_min, z_max = hz - radius * steepness, hz + radius * steepness
    if not z_min > 1.000001 * NEAR_M:
        return NEAR
    # A closed outline beyond an edge of the picture crosses no row of it, or each as often up as down in the
    # same place, and so covers nothing.
    right, bottom = width_px - 1.0 + _MARGIN_PX, height_px - 1.0 + _MARGIN_PX
    if -_MARGIN_PX * hz - hx > radius * lens[LEFT] or hx - right * hz > radius * lens[RIGHT]:
        return HIDDEN
    if -_MARGIN_PX * hz - hy > radius * lens[TOP] or hy - bottom * hz > radius * lens[BOTTOM]:
        return HIDDEN
    u, v = hx / hz, hy / hz
    stretch = _stretch(lens, u, v)
    spread_px = stretch * radius / z_min  # how far from (u, v) the sphere reaches
    if not (abs(u) + abs(v) + spread_px) * SUBPIXEL < 0.5 * LIMIT_STEPS:
        return NEAR  # snapping stops at the limit, and so may err by more than half a step
    stretch += spread_px * steepness  # now for every point of the sphere as (u, v)
    determinant = lens[DETERMINANT]
    terms = radius * abs(determinant)
    for i in range(3):
        from_centre = -sphere_m[i]
        for k in range(3):
            from_centre += T_world_segment[k, i] * (lens[CENTRE_X + k] - T_world_segment[k, 3])
        eye[i] = determinant * from_centre
        terms += abs(eye[i])
    eye[W] = determinant
    eye[GUARD] = 1.001 * (z_max**2 * 2.0 * sqrt(2.0) * _SNAP_ERROR_PX * stretch)
    # No normal is longer than 1, or twice the radius if that is more; no offset than the radius times that.
    eye[ROUNDING] = _SINGLE_ERROR * max(2.0 * radius, 1.0) * terms
    eye[PX_PER_M] = stretch / z_min
    return SEEN


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _homogeneous(M: Floats, row: int, point_m: Floats) -> float:
    return float(M[row, 0] * point_m[0] + M[row, 1] * point_m[1] + M[row, 2] * point_m[2] + M[row, 3])


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _stretch(lens: Floats, u: float, v: float) -> float:
    """The largest singular value of the rows m1 - u m3 and m2 - v m3, from their products."""
    m11, m22, m33, m12, m13, m23 = lens[M11], lens[M22], lens[M33], lens[M12], lens[M13], lens[M23]
    xx, yy = m11 - 2.0 * u * m13 + u * u * m33, m22 - 2.0 * v * m23 + v * v * m33
    xy = m12 - v * m13 - u * m23 + u * v * m33
    return sqrt((xx + yy) / 2.0 + sqrt((xx - yy) ** 2 / 4.0 + xy * xy))


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def find_candidates(
    planes: Singles, block_planes: Singles, first: int, last: int, eye: Singles, flags: Bytes, found: Indices
) -> int:
    """Write the indices of the edges in blocks first to last that may be outline to found; returns how many.

    planes and block_planes as in FlatMesh; eye as look has set it; flags (BLOCK + B,) is scratch.
    """
    edge_flags, block_flags = flags[:BLOCK], flags[BLOCK:]
    _test_blocks(block_planes, first, last, eye, block_flags)
    n = 0
    for block in range(first, last):
        if block_flags[block]:
            _test_edges(planes, np.uint32(block), eye, edge_flags)
            for i in range(BLOCK):  # every edge is written, and only those that stay move on
                found[np.uint32(n)] = BLOCK * block + i
                n += edge_flags[i]
    return n


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _test_blocks(bounds: Singles, first: int, last: int, eye: Singles, flags: Bytes) -> None:
    """Flag the blocks among whose planes the camera may be on different sides.

    Fused multiplication is allowed here, as the rounding is allowed for.
    """
    x, y, z, w, guard, rounding = eye[X], eye[Y], eye[Z], eye[W], eye[GUARD], eye[ROUNDING]
    for block in range(first, last):
        b = np.uint32(block)
        middle = bounds[0, b] * x + bounds[1, b] * y + bounds[2, b] * z - bounds[3, b] * w
        off = bounds[4, b] * abs(x) + bounds[5, b] * abs(y) + bounds[6, b] * abs(z) + bounds[7, b] * abs(w)
        flags[b] = abs(middle) <= off + bounds[8, b] * guard + rounding


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _test_edges(planes: Singles, b: np.uint32, eye: Singles, flags: Bytes) -> None:
    """Flag the edges of block b that may be outline; fused multiplication as in _test_blocks."""
    x, y, z, w, guard = eye[X], eye[Y], eye[Z], eye[W], eye[GUARD] + eye[ROUNDING]
    for i in range(BLOCK):
        along = planes[b, 0, i] * x + planes[b, 1, i] * y + planes[b, 2, i] * z - planes[b, 3, i] * w
        against = planes[b, 4, i] * x + planes[b, 5, i] * y + planes[b, 6, i] * z - planes[b, 7, i] * w
        flags[i] = (min(along, against) <= guard) & (max(along, against) >= -guard)
