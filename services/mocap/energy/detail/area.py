"""Compiled area of a closed mesh, and giving it back to one that thinning has shrunk."""

from math import sqrt

import numba
import numpy as np

from services.mocap.types import Floats, Ints


@numba.njit(cache=True, nogil=True, error_model="numpy")
def keep_area(vertices_m: Floats, faces: Ints, area_m2: float, most_m: float) -> None:
    """Move vertices along their normals, all by the same and no more than most_m, until the area is right.

    For a convex body the mean area of its silhouettes is a quarter of its surface's (Cauchy). Thinning
    shrinks it by up to some percent; with its area back, silhouettes are as large as before on average.
    """
    shifted_m, step_m = 0.0, 1e-3 * most_m
    for _ in range(3):
        normals, before_m2 = normals_and_area(vertices_m, faces)
        gain_m = (normals_and_area(vertices_m + step_m * normals, faces)[1] - before_m2) / step_m
        if not gain_m > 0.0:
            return
        shift_m = min(max((area_m2 - before_m2) / gain_m, -most_m - shifted_m), most_m - shifted_m)
        vertices_m += shift_m * normals
        shifted_m += shift_m


@numba.njit(cache=True, nogil=True, error_model="numpy")
def normals_and_area(vertices_m: Floats, faces: Ints) -> tuple[Floats, float]:
    """Unit normals (V, 3) of vertices, and the surface's area."""
    normals, doubled_m2 = np.zeros(vertices_m.shape), 0.0
    for f in range(len(faces)):
        a, b, c = vertices_m[faces[f, 0]], vertices_m[faces[f, 1]], vertices_m[faces[f, 2]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        doubled_m2 += sqrt(nx * nx + ny * ny + nz * nz)
        for i in range(3):
            normal = normals[faces[f, i]]
            normal[0] += nx
            normal[1] += ny
            normal[2] += nz
    for v in range(len(normals)):
        x, y, z = normals[v]
        normals[v] /= max(sqrt(x * x + y * y + z * z), 1e-30)
    return normals, doubled_m2 / 2.0
