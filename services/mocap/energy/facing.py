"""Compiled search for the edges that may be outline: those with the camera in front of one of their two faces only.

What counts as front is decided by the snapped corners on the screen. For nearly every face the side of its
plane on which the camera's centre lies decides it as well, without projecting anything; and one look at the
planes of a block of edges that face the same way mostly tells that there is no outline among them. Only what
is too close to call is left to whoever projects the corners.
"""

from math import sqrt
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from services.mocap.energy.mesh import BLOCK, SMALL_PERIMETER_M, FlatMesh, Indices, Singles
from services.mocap.energy.snapping import LIMIT_STEPS, NEAR_M, SUBPIXEL
from services.mocap.types import Bytes, Floats, Ints

ALONG, AGAINST, UNDECIDED = 1, 2, 3
"""How an edge is outline: with the front face on its left, on its right, or perhaps not at all."""
_HIDDEN, _NEAR, _SEEN = 0, 1, 2
_SNAP_ERROR_PX = 0.501 / SUBPIXEL  # half a step, and a little for the rounding of floats before it
_FLOAT32_ERROR = (
    2.0**-19
)  # of a plane at a point, against the sum of the sizes of its terms; twice what can be


class Candidates(NamedTuple):
    """Scratch: the edges of one pose that may be outline, in all cameras. Compiled code takes the fields."""

    M_px_segment: Floats
    """(C, S, 3, 4) projections of metres in each segment's frame to pixels."""
    found: Indices
    """(C, E + 1): four times an edge's index, plus ALONG, AGAINST or UNDECIDED."""
    ends: NDArray[np.int64]
    """(C, S + 1): where in found the k-th drawn segment begins and the one before it ends."""
    blocks: Bytes
    """(B,) whether a block may hold outline in the camera in hand."""

    @classmethod
    def room_for(cls, mesh: FlatMesh, n_cameras: int) -> "Candidates":
        """Scratch for a mesh and a number of cameras."""
        n_segments, n_edges = len(mesh.spheres_m), len(mesh.edges)
        return cls(
            M_px_segment=np.zeros((n_cameras, n_segments, 3, 4)),
            found=np.zeros((n_cameras, n_edges + 1), np.uint32),
            ends=np.zeros((n_cameras, n_segments + 1), np.int64),
            blocks=np.zeros(len(mesh.planes), np.uint8),
        )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def find_candidates(
    T_world_segment: Floats,
    segments: Ints,
    P_px_world: Floats,
    width_px: int,
    height_px: int,
    planes: Singles,
    block_planes: Singles,
    block_start: Ints,
    spheres_m: Floats,
    M_px_segment: Floats,
    found: Indices,
    ends: Ints,
    blocks: Bytes,
) -> None:
    """Find what may be outline of segments in one pose, T_world_segment (S, 4, 4), by cameras (C, 3, 4).

    Segments that project wholly outside a picture of width_px x height_px may be left out. The mesh is given
    as in FlatMesh; the rest is filled as in Candidates.
    """
    eye, codes = np.empty(6, np.float32), np.empty(BLOCK, np.uint8)
    ends[:, 0] = 0
    for k in range(len(segments)):
        s = segments[k]
        first, last = block_start[s], block_start[s + 1]
        for c in range(len(P_px_world)):
            M, n = M_px_segment[c, s], ends[c, k]
            _compose(P_px_world[c], T_world_segment[s], M)
            view = _look(M, spheres_m[s], width_px, height_px, eye)
            if view == _NEAR:
                n = _add_all(first, last, found[c], n)
            elif view == _SEEN:
                _test_blocks(block_planes, first, last, eye, blocks)
                for block in range(first, last):
                    if blocks[block]:
                        _test_edges(planes, block, eye, codes)
                        n = _add(block, codes, found[c], n)
            ends[c, k + 1] = n


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _compose(P: Floats, T: Floats, M: Floats) -> None:
    """Write the product of P (3, 4) and T (4, 4) into M (3, 4)."""
    for i in range(3):
        for j in range(4):
            M[i, j] = P[i, 0] * T[0, j] + P[i, 1] * T[1, j] + P[i, 2] * T[2, j] + P[i, 3] * T[3, j]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _look(M: Floats, sphere_m: Floats, width_px: int, height_px: int, eye: Singles) -> int:
    """Say whether a segment is hidden, near or seen; for one seen set eye (6,).

    eye gets the homogeneous centre (C, w) of the camera, seen from the sphere's centre and times det(M); the
    length of C; and the guard: a plane that is farther than that from zero at (C, w) has the sign of the
    face's doubled area on the screen after snapping.

    With H the homogeneous pixels of a face's corners and z their depths, det(H) is z1 z2 z3 times the face's
    doubled area on the screen, and n · C - d w = -det(H) for the face's plane with its doubled area as n's
    length. Moving every corner by up to e in x and y changes the doubled area by at most e times the sum over
    the edges of |dx| + |dy|, and 6 e² for the products of two moves. An edge L has dx = (m1 - u m3) · L / z, m
    being the rows of M, u the x of its one end and z the depth of the other; likewise dy. So |dx| + |dy| is at
    most |L| / z_min times the reach: the length of (m1 - u m3) ± (m2 - v m3), the larger of the two. With the
    planes divided by perimeter + p the bound loses the face: z_max³ times the larger of e reach / z_min and
    6 e² / p.
    """
    hx, hy, hz = _homogeneous(M, 0, sphere_m), _homogeneous(M, 1, sphere_m), _homogeneous(M, 2, sphere_m)
    radius, steepness = sphere_m[3], _length(M, 0.0, 0.0, 1.0)
    z_min, z_max = hz - radius * steepness, hz + radius * steepness
    if not z_min > NEAR_M:
        return _NEAR
    if _beyond(M, 0, hx, hz, radius, width_px) or _beyond(M, 1, hy, hz, radius, height_px):
        return _HIDDEN
    u, v = hx / hz, hy / hz
    reach = max(_length(M, 1.0, 1.0, -u - v), _length(M, 1.0, -1.0, v - u))
    off_px = (
        reach * radius / z_min
    )  # how far from (u, v) anything in the sphere projects, in x and y together
    if not (abs(u) + abs(v) + off_px) * SUBPIXEL < 0.5 * LIMIT_STEPS:  # snapping stops there: no bound known
        return _NEAR
    reach += 2.0 * off_px * steepness
    _set_centre(M, hx, hy, hz, eye)
    guard = z_max**3 * max(_SNAP_ERROR_PX * reach / z_min, 6.0 * _SNAP_ERROR_PX**2 / SMALL_PERIMETER_M)
    # In single precision: no n is longer than perimeter / 10 or the radius, no d larger than the radius times n.
    rounding = _FLOAT32_ERROR * radius * (eye[4] + radius * abs(eye[3]))
    eye[5] = 1.001 * (guard + rounding)
    return _SEEN


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _homogeneous(M: Floats, row: int, point_m: Floats) -> float:
    return M[row, 0] * point_m[0] + M[row, 1] * point_m[1] + M[row, 2] * point_m[2] + M[row, 3]


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _length(M: Floats, x: float, y: float, z: float) -> float:
    """Length of x, y and z times the rows of M (3, 4), its last column left out."""
    square = 0.0
    for j in range(3):
        square += (x * M[0, j] + y * M[1, j] + z * M[2, j]) ** 2
    return sqrt(square)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _beyond(M: Floats, row: int, h: float, hz: float, radius: float, size_px: int) -> bool:
    """Whether a sphere before the camera lies wholly left of (above) a picture or right of (below) it.

    A closed outline there crosses no row of the picture, or crosses each as often up as down in the same
    place, and so covers nothing. A pixel of margin is more than what snapping moves.
    """
    x, y, low, high = 1.0 - row, float(row), -2.0, size_px + 1.0
    return low * hz - h > radius * _length(M, x, y, -low) or h - high * hz > radius * _length(M, x, y, -high)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _set_centre(M: Floats, hx: float, hy: float, hz: float, eye: Singles) -> None:
    """Set eye[:5] from M and the homogeneous pixels h of the sphere's centre."""
    determinant, square = 0.0, 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        yz = M[1, j] * M[2, k] - M[1, k] * M[2, j]
        zx = M[2, j] * M[0, k] - M[2, k] * M[0, j]
        xy = M[0, j] * M[1, k] - M[0, k] * M[1, j]
        centre = -(yz * hx + zx * hy + xy * hz)
        determinant += M[0, i] * yz
        square += centre * centre
        eye[i] = centre
    eye[3], eye[4] = determinant, sqrt(square)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _test_blocks(block_planes: Singles, first: int, last: int, eye: Singles, blocks: Bytes) -> None:
    """Mark the blocks some plane of which may have the camera on another side than some other.

    Fused multiplication is allowed here, as the guard leaves room for other rounding.
    """
    x, y, z, w, distance, guard = eye[0], eye[1], eye[2], eye[3], eye[4], eye[5]
    for i in range(first, last):
        b = np.uint32(i)
        middle = (
            block_planes[0, b] * x + block_planes[1, b] * y + block_planes[2, b] * z - block_planes[3, b] * w
        )
        off = block_planes[4, b] * distance + block_planes[5, b] * abs(w)
        blocks[b] = abs(middle) <= off + guard


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _test_edges(planes: Singles, block: int, eye: Singles, codes: Bytes) -> None:
    """Code the edges of a block: 0, ALONG, AGAINST or UNDECIDED; fused multiplication as in _test_blocks."""
    x, y, z, w, guard = eye[0], eye[1], eye[2], eye[3], eye[5]
    for i in range(BLOCK):
        along = (
            planes[block, 0, i] * x
            + planes[block, 1, i] * y
            + planes[block, 2, i] * z
            - planes[block, 3, i] * w
        )
        against = (
            planes[block, 4, i] * x
            + planes[block, 5, i] * y
            + planes[block, 6, i] * z
            - planes[block, 7, i] * w
        )
        low, high = min(along, against), max(along, against)
        near_both = (low <= guard) & (high >= -guard)
        sure = (low < -guard) & (high > guard)
        codes[i] = near_both * (np.uint8(3) - sure * (np.uint8(2) - (against > along)))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add(block: int, codes: Bytes, found: Indices, n: int) -> int:
    """Append what a block's codes tell to found, which holds n; returns how many it holds then."""
    for i in range(BLOCK):
        found[np.uint32(n)] = 4 * (BLOCK * block + i) + codes[i]
        n += codes[i] != 0
    return n


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add_all(first: int, last: int, found: Indices, n: int) -> int:
    """Append every edge of blocks as undecided: for segments about the near plane; else as _add."""
    for edge in range(BLOCK * first, BLOCK * last):
        found[n] = 4 * edge + UNDECIDED
        n += 1
    return n
