"""Projection to snapped pixel coordinates: the one place that rounds, shared by every CPU rasteriser."""

import numba
import numpy as np

from services.mocap.types import Floats, Ints

SUBPIXEL_BITS = 8
SUBPIXEL = 1 << SUBPIXEL_BITS
"""Steps a pixel, as on GPUs. Behind it all arithmetic is whole numbers and so the same everywhere."""
NEAR_M = 0.05
"""A triangle with a vertex nearer to the camera than this is not drawn."""
LIMIT_STEPS = float(1 << 28)
"""Coordinates stop here, so that products of two stay within 64 bits."""


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def snap(homogeneous: float, inverse_depth: float) -> int:
    """A homogeneous pixel coordinate over its depth, in whole steps of 1/256 pixel."""
    step = homogeneous * inverse_depth * SUBPIXEL
    return np.int64(np.rint(min(max(step, -LIMIT_STEPS), LIMIT_STEPS)))


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def project_vertex(xyz_m: Floats, vertex: int, M: Floats) -> tuple[int, int, float]:
    """Project one vertex of xyz_m (V, 3) by M (3, 4): its coordinates in 1/256 pixel and its depth in metres.

    Behind the near plane the coordinates are those at the near plane.
    """
    x, y, z = xyz_m[vertex, 0], xyz_m[vertex, 1], xyz_m[vertex, 2]
    depth_m = M[2, 0] * x + M[2, 1] * y + M[2, 2] * z + M[2, 3]
    inverse = 1.0 / max(depth_m, NEAR_M)
    u = snap(M[0, 0] * x + M[0, 1] * y + M[0, 2] * z + M[0, 3], inverse)
    v = snap(M[1, 0] * x + M[1, 1] * y + M[1, 2] * z + M[1, 3], inverse)
    return u, v, depth_m


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _project_all(points_m: Floats, M: Floats, uv: Ints, depth_m: Floats) -> None:
    for vertex in range(len(points_m)):
        uv[vertex, 0], uv[vertex, 1], depth_m[vertex] = project_vertex(points_m, vertex, M)


def project_snapped(points_world_m: Floats, P_px_world: Floats) -> tuple[Ints, Floats]:
    """Project (V, 3) points by (3, 4); returns uv (V, 2) in 1/256 pixel, depth_m (V,)."""
    n = len(points_world_m)
    uv, depth_m = np.empty((n, 2), np.int32), np.empty(n)
    _project_all(np.ascontiguousarray(points_world_m), np.ascontiguousarray(P_px_world), uv, depth_m)
    return uv, depth_m
