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
def _snap(homogeneous: float, steps_per_depth: float) -> np.int32:
    """A homogeneous pixel coordinate over its depth, in whole steps of 1/256 pixel."""
    step = homogeneous * steps_per_depth
    return np.int32(np.rint(min(max(step, -LIMIT_STEPS), LIMIT_STEPS)))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def project_range(xyz_m: Floats, start: int, end: int, M: Floats, uv: Ints) -> None:
    """Project vertices start to end of xyz_m (3, V) by M (3, 4) into uv (2, V), in 1/256 pixel.

    Vertices behind the near plane get the coordinates that they would have at its depth.
    """
    # Named, so that nothing stands against vector code.
    m00, m01, m02, m03 = M[0, 0], M[0, 1], M[0, 2], M[0, 3]
    m10, m11, m12, m13 = M[1, 0], M[1, 1], M[1, 2], M[1, 3]
    m20, m21, m22, m23 = M[2, 0], M[2, 1], M[2, 2], M[2, 3]
    for vertex in range(start, end):
        v = np.uint32(vertex)
        x, y, z = xyz_m[0, v], xyz_m[1, v], xyz_m[2, v]
        steps_per_depth = SUBPIXEL / max(m20 * x + m21 * y + m22 * z + m23, NEAR_M)
        uv[0, v] = _snap(m00 * x + m01 * y + m02 * z + m03, steps_per_depth)
        uv[1, v] = _snap(m10 * x + m11 * y + m12 * z + m13, steps_per_depth)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def depth_range(xyz_m: Floats, start: int, end: int, M: Floats, depth_m: Floats) -> None:
    """Write the depths of vertices start to end of xyz_m (3, V) before M (3, 4) into depth_m (V,)."""
    for v in range(start, end):
        depth_m[v] = M[2, 0] * xyz_m[0, v] + M[2, 1] * xyz_m[1, v] + M[2, 2] * xyz_m[2, v] + M[2, 3]


def project_snapped(points_world_m: Floats, P_px_world: Floats) -> tuple[Ints, Floats]:
    """Project (V, 3) points by (3, 4); returns uv (V, 2) in 1/256 pixel, depth_m (V,)."""
    n = len(points_world_m)
    uv, depth_m = np.empty((2, n), np.int32), np.empty(n)
    xyz_m, M = np.ascontiguousarray(points_world_m.T), np.ascontiguousarray(P_px_world)
    project_range(xyz_m, 0, n, M, uv)
    depth_range(xyz_m, 0, n, M, depth_m)
    return uv.T, depth_m
