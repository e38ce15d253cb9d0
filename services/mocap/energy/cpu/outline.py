"""Compiled scan conversion by outlines: which pixels a posed body covers, without filling a triangle.

The front faces of a closed mesh cover a pixel as often as the outline of those faces winds around it. So
only the edges between a front and a back face matter, a few hundred in twenty thousand: each puts +1 or -1
where it crosses a pixel row, and a running sum along the row is above zero exactly where a front face lies.
With snapped vertices all of this is whole-number arithmetic, and equal bit for bit to filling every triangle
by the top-left rule.
"""

from typing import TypeAlias

import numba
import numpy as np

from services.mocap.energy.cpu.arrays import Indices, Shorts, Singles
from services.mocap.energy.cpu.collecting import collect_bits, collect_gain
from services.mocap.energy.cpu.crossing import find_crossings, find_near_crossings, wind
from services.mocap.energy.cpu.facing import HIDDEN, NEAR, find_candidates, look
from services.mocap.energy.cpu.mesh import BLOCK, FlatMesh
from services.mocap.energy.snapping import depth_range, project_range
from services.mocap.types import Bytes, Floats, Ints

MeshArrays: TypeAlias = tuple[Floats, Indices, Singles, Singles, Ints, Floats]
"""A FlatMesh as a plain tuple: numba's cache on disk cannot be read once a named one has been renamed."""
Scratch: TypeAlias = tuple[Bytes, Indices, Ints, Floats, Ints]
"""(BLOCK + B,) flags; (E + 1,) edges found; (2, V) snapped vertices; (V,) depths; (E + 1, 7) crossings."""


def scratch_for(mesh: FlatMesh) -> Scratch:
    """What drawing a mesh needs room for."""
    n_vertices, n_edges = mesh.xyz_m.shape[1], len(mesh.edges)
    return (
        np.zeros(BLOCK + len(mesh.planes), np.uint8),
        np.zeros(n_edges + 1, np.uint32),
        np.zeros((2, n_vertices), np.int32),
        np.zeros(n_vertices),
        np.zeros((n_edges + 1, 7), np.int32),
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def outline_energy(
    T_world_segment: Floats,
    segments: Ints,
    P_px_world: Floats,
    mesh: MeshArrays,
    scratch: Scratch,
    gain_sums: Shorts,
    width_px: int,
    winding: Shorts,
    energies: Floats,
) -> None:
    """Add, for each of N poses, the gain of every pixel that the body covers.

    T_world_segment (N, S, 4, 4); segments: indices of those drawn; P_px_world (C, 3, 4); gain_sums (C, H,
    columns) as summed_gain makes it for pictures of width_px; winding from empty_winding; energies (N,).
    """
    extent = np.empty(4, np.int32)
    for n in range(len(T_world_segment)):
        total = 0
        for c in range(len(P_px_world)):
            _draw(T_world_segment[n], segments, P_px_world[c], mesh, scratch, width_px, winding, extent)
            total += collect_gain(winding, extent, gain_sums[c])
        energies[n] += total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def outline_coverage(
    T_world_segment: Floats,
    segments: Ints,
    P_px_world: Floats,
    mesh: MeshArrays,
    scratch: Scratch,
    winding: Shorts,
    covered: Bytes,
) -> None:
    """Set the bits of every pixel that the body covers in covered (N, P, H, W); else as outline_energy."""
    extent, width_px = np.empty(4, np.int32), covered.shape[3]
    for n in range(len(T_world_segment)):
        for c in range(len(P_px_world)):
            _draw(T_world_segment[n], segments, P_px_world[c], mesh, scratch, width_px, winding, extent)
            collect_bits(winding, extent, covered[n, c // 8], np.uint8(1 << c % 8))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _draw(
    T_world_segment: Floats,
    segments: Ints,
    P_px_world: Floats,
    mesh: MeshArrays,
    scratch: Scratch,
    width_px: int,
    winding: Shorts,
    extent: Ints,
) -> None:
    """Put one camera's outlines of the segments into winding; extent as in wind."""
    xyz_m, edges, planes, block_planes, starts, spheres_m = mesh
    flags, found, uv, depth_m, crossings = scratch
    height_px = winding.shape[0]
    M, eye = np.empty((3, 4)), np.empty(6, np.float32)
    extent[0], extent[1], extent[2], extent[3] = height_px, 0, width_px + 1, 0
    for s in segments:
        vertex, vertex_end, block, block_end = starts[0, s], starts[0, s + 1], starts[1, s], starts[1, s + 1]
        _compose(P_px_world, T_world_segment[s], M)
        view = look(M, spheres_m[s], width_px, height_px, eye)
        if view == HIDDEN:
            continue
        project_range(xyz_m, vertex, vertex_end, M, uv)
        if view == NEAR:
            depth_range(xyz_m, vertex, vertex_end, M, depth_m)
            n = find_near_crossings(
                BLOCK * block, BLOCK * block_end, edges, uv, depth_m, height_px, crossings
            )
        else:
            n = find_candidates(planes, block_planes, block, block_end, eye, flags, found)
            n = find_crossings(found, n, edges, uv, height_px, crossings)
        wind(crossings, n, width_px, winding, extent)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _compose(P: Floats, T: Floats, M: Floats) -> None:
    """Write the product of P (3, 4) and T (4, 4) into M (3, 4)."""
    for i in range(3):
        for j in range(4):
            M[i, j] = P[i, 0] * T[0, j] + P[i, 1] * T[1, j] + P[i, 2] * T[2, j] + P[i, 3] * T[3, j]
