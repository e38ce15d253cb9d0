"""Compiled search for the outline: the edges between a front and a back face, seen from every camera at once.

What is front is decided by the snapped corners on the screen. For nearly every face the side on which the
camera's centre lies of its plane decides it as well, without projecting anything: eight multiplications an
edge, on sixteen edges at a time. Only where that is too close to call are corners projected and snapped.
"""

from math import sqrt
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from services.mocap.energy.mesh import SMALL_PERIMETER_M, FlatMesh, Indices
from services.mocap.energy.snapping import LIMIT_STEPS, NEAR_M, SUBPIXEL, project_vertex
from services.mocap.types import Bytes, Floats, Ints

_BLOCK = 256  # edges whose planes stay in the nearest cache while all cameras look at them
_HIDDEN, _NEAR, _SEEN = 0, 1, 2
_SNAP_ERROR_PX = 0.501 / SUBPIXEL  # half a step, and a little for the rounding of floats before it
_FLOAT32_ERROR = 2.0**-20  # of a sum of four products of rounded factors, against the sum of their sizes


class Outline(NamedTuple):
    """Scratch: the outline edges of one pose in all cameras, and what they were found with."""

    M_px_segment: Floats
    """(C, S, 3, 4) projections of metres in each segment's frame to pixels."""
    edges: Indices
    """(C, E): twice the edge's index, plus one where it runs backwards with the front face on its left."""
    end: Ints
    """(C, S + 1): where in edges the outline of segment s ends, and that of segment s + 1 begins."""
    eyes: NDArray[np.float32]
    """(C, 5): homogeneous camera centre and guard of the segment in hand."""
    codes: Bytes
    """(_BLOCK,) see _code_block; also seen as whole words."""
    code_words: NDArray[np.uint64]
    front: Bytes
    """(F,) which faces of a segment near a camera face it."""

    @classmethod
    def room_for(cls, mesh: FlatMesh, n_cameras: int) -> "Outline":
        """Scratch for a mesh and a number of cameras."""
        n_segments, n_edges = len(mesh.spheres_m), len(mesh.edges)
        codes: Bytes = np.zeros(_BLOCK, np.uint8)
        return cls(
            M_px_segment=np.zeros((n_cameras, n_segments, 3, 4)),
            edges=np.zeros((n_cameras, n_edges), np.uint32),
            end=np.zeros((n_cameras, n_segments + 1), np.int64),
            eyes=np.zeros((n_cameras, 5), np.float32),
            codes=codes,
            code_words=codes.view(np.uint64),
            front=np.zeros(len(mesh.faces), np.uint8),
        )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def find_outline(
    T_world_segment: Floats,
    segments: Ints,
    P_px_world: Floats,
    width_px: int,
    height_px: int,
    mesh: FlatMesh,
    out: Outline,
) -> None:
    """Find the outline edges of segments in one pose, T_world_segment (S, 4, 4), by cameras (C, 3, 4).

    What projects wholly outside a picture of width_px x height_px may be left out.
    """
    out.end[:, 0] = 0
    for k in range(len(segments)):
        s = segments[k]
        for c in range(len(P_px_world)):
            out.end[c, k + 1] = out.end[c, k]
            M = out.M_px_segment[c, s]
            _compose(P_px_world[c], T_world_segment[s], M)
            view = _look(M, mesh.spheres_m[s], width_px, height_px, out.eyes[c])
            if view == _NEAR:
                out.end[c, k + 1] = _find_all(mesh, s, M, out.front, out.edges[c], out.end[c, k])
            if view != _SEEN:
                out.eyes[c, 4] = -1.0
        for first in range(mesh.edge_start[s], mesh.edge_start[s + 1], _BLOCK):
            size = min(_BLOCK, mesh.edge_start[s + 1] - first)
            for c in range(len(P_px_world)):
                if out.eyes[c, 4] >= 0.0:
                    _code_block(mesh.planes, first, size, out.eyes[c], out.codes)
                    out.end[c, k + 1] = _gather(
                        mesh, first, size, out.M_px_segment[c, s], out.codes, out.code_words, out.edges[c],
                        out.end[c, k + 1],
                    )  # fmt: skip


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _compose(P: Floats, T: Floats, M: Floats) -> None:
    """Write the product of P (3, 4) and T (4, 4) into M (3, 4)."""
    for i in range(3):
        for j in range(4):
            M[i, j] = P[i, 0] * T[0, j] + P[i, 1] * T[1, j] + P[i, 2] * T[2, j] + P[i, 3] * T[3, j]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _look(M: Floats, sphere_m: Floats, width_px: int, height_px: int, eye: NDArray[np.float32]) -> int:
    """Say whether a segment is hidden, near or seen; for one seen set eye (5,): centre and guard.

    With H the homogeneous pixels of a face's corners, z their depths and C = det(M) times the camera's
    centre, det(H) = z1 z2 z3 times the face's doubled area on the screen; and -det(H) = n · C - d det(M), n
    and d being the face's plane with its doubled area as the normal's length. So the plane tells the sign of
    the true area. The sign of the snapped one is the same if |det(H)| is beyond what snapping can change:
    moving every corner by up to e in x and y changes the doubled area by at most e times the sum over the
    edges of |dx| + |dy|, and 6 e² for the products of two moves. An edge of length L m is |dx| = |(m1 - u m3)
    · L| / z long, u being the one end's x and z the other's depth: at most L times reach_x / z_min, reach_x
    being the largest |m1 - u m3| for any u in the sphere. Divided by (perimeter + p), as the planes are, the
    bound loses the face: z_max³ times the larger of e (reach_x + reach_y) / z_min and 6 e² / p.
    """
    hx, hy, hz = _apply(M, 0, sphere_m), _apply(M, 1, sphere_m), _apply(M, 2, sphere_m)
    radius, steepness = sphere_m[3], _norm(M, 2, 0.0)
    z_min, z_max = hz - radius * steepness, hz + radius * steepness
    if not z_min > NEAR_M:
        return _NEAR
    if _beyond(M, 0, hx, hz, radius, width_px) or _beyond(M, 1, hy, hz, radius, height_px):
        return _HIDDEN
    u, v, widening = hx / hz, hy / hz, 1.0 + radius * steepness / z_min
    reach_x, reach_y = _norm(M, 0, u), _norm(M, 1, v)
    farthest_px = max(abs(u) + reach_x * radius / z_min, abs(v) + reach_y * radius / z_min)
    if not farthest_px * SUBPIXEL < 0.5 * LIMIT_STEPS:  # snapping stops at the limit: no bound on its error
        return _NEAR
    _centre(M, hx, hy, hz, eye)
    slope = (reach_x + reach_y) * widening / z_min
    guard = z_max**3 * max(_SNAP_ERROR_PX * slope, 6.0 * _SNAP_ERROR_PX**2 / SMALL_PERIMETER_M)
    # In single precision: a normal is at most perimeter / 10 <= 0.6 radius long, its offset radius times that.
    sizes = sqrt(eye[0] ** 2 + eye[1] ** 2 + eye[2] ** 2) + radius * abs(eye[3])
    eye[4] = 1.001 * (guard + _FLOAT32_ERROR * radius * sizes)
    return _SEEN


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _apply(M: Floats, row: int, point_m: Floats) -> float:
    """One homogeneous coordinate of a point."""
    return M[row, 0] * point_m[0] + M[row, 1] * point_m[1] + M[row, 2] * point_m[2] + M[row, 3]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _norm(M: Floats, row: int, px: float) -> float:
    """Length of the gradient of (row - px * depth row), in pixels."""
    x, y, z = M[row, 0] - px * M[2, 0], M[row, 1] - px * M[2, 1], M[row, 2] - px * M[2, 2]
    if row == 2:
        x, y, z = M[2, 0], M[2, 1], M[2, 2]
    return sqrt(x * x + y * y + z * z)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _beyond(M: Floats, row: int, h: float, hz: float, radius: float, size_px: int) -> bool:
    """Whether a sphere before the camera lies wholly more than a pixel left of (above) or past a picture.

    A closed outline beyond crosses no row of the picture, or crosses each as often up as down left of it, or
    right of it, and so covers nothing.
    """
    low, high = -2.0, size_px + 1.0
    return low * hz - h > radius * _norm(M, row, low) or h - high * hz > radius * _norm(M, row, high)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _centre(M: Floats, hx: float, hy: float, hz: float, eye: NDArray[np.float32]) -> None:
    """Set eye to det(M) times the camera's centre, seen from the point that projects to h, and det(M)."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        yz = M[1, j] * M[2, k] - M[1, k] * M[2, j]
        zx = M[2, j] * M[0, k] - M[2, k] * M[0, j]
        xy = M[0, j] * M[1, k] - M[0, k] * M[1, j]
        eye[i] = -(yz * hx + zx * hy + xy * hz)
        if i == 0:
            eye[3] = 0.0
        eye[3] += M[0, i] * yz


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _code_block(
    planes: NDArray[np.float32], first: int, size: int, eye: NDArray[np.float32], codes: Bytes
) -> None:
    """Code each edge: bit 0 may be outline along it, bit 1 against it, bit 2 too close to call; 0 is no outline.

    Fused multiplication is allowed here, as the guard leaves room for other rounding.
    """
    x, y, z, w, guard = eye[0], eye[1], eye[2], eye[3], eye[4]
    for i in range(size):
        e = first + i
        along = planes[0, e] * x + planes[1, e] * y + planes[2, e] * z - planes[3, e] * w
        against = planes[4, e] * x + planes[5, e] * y + planes[6, e] * z - planes[7, e] * w
        along_front, along_back = along > -guard, along < guard
        against_front, against_back = against > -guard, against < guard
        close = (along_front & along_back) | (against_front & against_back)
        codes[i] = (
            np.uint8(along_front & against_back)
            | np.uint8(against_front & along_back) << np.uint8(1)
            | np.uint8(close) << np.uint8(2)
        )
    codes[size : (size + 7) // 8 * 8] = 0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _gather(
    mesh: FlatMesh,
    first: int,
    size: int,
    M: Floats,
    codes: Bytes,
    code_words: NDArray[np.uint64],
    edges: Indices,
    n: int,
) -> int:
    """Append a block's outline edges to edges, which holds n; returns how many it holds then."""
    for word in range((size + 7) // 8):
        if code_words[word] == 0:
            continue
        for i in range(8 * word, 8 * word + 8):
            code = codes[i]
            if code > 2:
                code = _exact_code(mesh, first + i, M)
            edges[n] = 2 * (first + i) + (code >> 1)
            n += code != 0
    return n


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _exact_code(mesh: FlatMesh, edge: int, M: Floats) -> int:
    """1 where an edge before the camera is outline along it, 2 against it, 0 where it is none."""
    along = _is_front(mesh, mesh.edges[edge, 2], M)
    against = _is_front(mesh, mesh.edges[edge, 3], M)
    return 0 if along == against else (1 if along else 2)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _is_front(mesh: FlatMesh, face: int, M: Floats) -> bool:
    """Whether a face's snapped corners run counter-clockwise on the screen, where y points down.

    A face with a corner behind the near plane is no front face.
    """
    ax, ay, az = project_vertex(mesh.xyz_m, mesh.faces[face, 0], M)
    bx, by, bz = project_vertex(mesh.xyz_m, mesh.faces[face, 1], M)
    cx, cy, cz = project_vertex(mesh.xyz_m, mesh.faces[face, 2], M)
    counter_clockwise = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay) < 0
    return counter_clockwise and min(az, bz, cz) >= NEAR_M


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _find_all(mesh: FlatMesh, s: int, M: Floats, front: Bytes, edges: Indices, n: int) -> int:
    """The slow way, for a segment about the near plane: project every face; else as _gather."""
    for face in range(mesh.face_start[s], mesh.face_start[s + 1]):
        front[face] = _is_front(mesh, face, M)
    for e in range(mesh.edge_start[s], mesh.edge_start[s + 1]):
        along, against = front[mesh.edges[e, 2]], front[mesh.edges[e, 3]]
        edges[n] = 2 * e + against
        n += along != against
    return n
