"""Compiled drawing without triangles: a body covers a pixel where the outlines of its parts wind around it.

The front faces of a closed mesh cover a point as often as their common boundary winds around it, so only the
edges between a front and a back face matter. Those are few: about a hundredth of all pixels that triangles
touch. Batches are evaluated in one call: from parameter values to energies, or to covered pixels.
"""

from functools import lru_cache
from typing import TypeAlias

import numba
import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import SURFACE_FRAMES, place_frames
from services.mocap.energy.cpu.collecting import Canvas, collect_bits, collect_gain
from services.mocap.energy.cpu.crossing import find_crossings, find_near_crossings, wind
from services.mocap.energy.cpu.facing import EYE_SIZE, HIDDEN, NEAR, PX_PER_M, find_candidates, look
from services.mocap.energy.cpu.mesh import BLOCK, FlatMesh
from services.mocap.energy.detail.cache import levels_of
from services.mocap.energy.snapping import depth_range, project_range
from services.mocap.njit import njit_without_refcounts
from services.mocap.types import Bytes, Floats, Indices, Ints, Singles

MeshArrays: TypeAlias = tuple[Floats, Indices, Singles, Singles, Ints, Floats, Floats]
"""A FlatMesh as a plain tuple: numba's cache on disk cannot be read once a named one has been renamed."""
Scratch: TypeAlias = tuple[Bytes, Indices, Ints, Floats, Ints, Floats, Singles]
"""flags (BLOCK + B,); edges found (E + 1,); snapped vertices uv (2, V); depth_m (V,); crossings (E + 1, 7);
the M (3, 4) and eye (EYE_SIZE,) of look."""


def prepared(body: Body, is_detailed: bool, n: int = 1) -> tuple[MeshArrays, list[Scratch]]:
    """A body's mesh, with its thinned levels if it is detailed, and room to draw it n times at once."""
    mesh = mesh_of(body, is_detailed)
    return (*mesh,), [scratch_for(mesh) for _ in range(n)]


@lru_cache(maxsize=4)
def mesh_of(body: Body, is_detailed: bool) -> FlatMesh:
    """A body's mesh, with its thinned levels if it is detailed; everything that draws the body shares it."""
    return FlatMesh.of(body, levels_of(body) if is_detailed else ())


def scratch_for(mesh: FlatMesh) -> Scratch:
    """What drawing a mesh needs room for."""
    n_vertices, n_edges = mesh.xyz_m.shape[1], len(mesh.edges)
    return (
        np.zeros(BLOCK + len(mesh.block_planes[0]), np.uint8),
        np.zeros(n_edges + 1, np.uint32),
        np.zeros((2, n_vertices), np.int32),
        np.zeros(n_vertices),
        np.zeros((n_edges + 1, 7), np.int32),
        np.zeros((3, 4)),
        np.zeros(EYE_SIZE, np.float32),
    )


@njit_without_refcounts
def draw(
    T_world_frame: Floats,
    surfaces: Ints,
    P_px_world: Floats,
    lens: Floats,
    detail_px: float,
    mesh: MeshArrays,
    scratch: Scratch,
    canvas: Canvas,
) -> None:
    """Put one camera's outlines of some surfaces on an empty canvas.

    T_world_frame (J + 5, 4, 4); P_px_world (3, 4) and lens (LENS_SIZE,): the camera; detail_px: thinned
    levels may be off by this much.
    """
    xyz_m, edges, planes, block_planes, starts, spheres_m, errors_m = mesh
    flags, found, uv, depth_m, crossings, M, eye = scratch
    height_px, width_px = canvas[0].shape
    for s in surfaces:
        T_world_surface = T_world_frame[SURFACE_FRAMES[s]]
        compose(P_px_world, T_world_surface, M)
        seen_as = look(T_world_surface, M, lens, spheres_m[s], width_px, height_px, eye)
        if seen_as == HIDDEN:
            continue
        level = 0 if seen_as == NEAR else _coarsest(errors_m, s, detail_px / eye[PX_PER_M])
        part = level * errors_m.shape[1] + s
        block, block_end = starts[1, part], starts[1, part + 1]
        project_range(xyz_m, starts[0, part], starts[0, part + 1], M, uv)
        if seen_as == NEAR:
            depth_range(xyz_m, starts[0, part], starts[0, part + 1], M, depth_m)
            n = find_near_crossings(
                BLOCK * block, BLOCK * block_end, edges, uv, depth_m, height_px, crossings
            )
        else:
            n_found = find_candidates(planes, block_planes, block, block_end, eye, flags, found)
            n = find_crossings(found, n_found, edges, uv, height_px, crossings)
        wind(crossings, n, canvas)


@njit_without_refcounts
def evaluate(
    values: Floats,
    plan: tuple[Ints, Ints, Ints],
    pose: Floats,
    T_world_frame: Floats,
    offsets_m: Floats,
    cameras: tuple[Floats, Floats],
    detail_px: float,
    mesh: MeshArrays,
    scratch: Scratch,
    gain_sums: Ints,
    costs: Floats,
    canvas: Canvas,
    energies: Floats,
) -> None:
    """Write the energies (N,) of values (N, d).

    plan: the parameters that vary (d,), the frames that they move, the surfaces that are drawn. pose (D,)
    and T_world_frame (J + 5, 4, 4): a base pose and its transforms, of which only what the plan names
    changes. gain_sums (C, H, W + 1) as summed_gain makes it; costs (2, C): blank and weights of the
    Tally; canvas from empty_canvas.
    """
    dofs, frames, surfaces = plan
    P_px_world, lenses = cameras
    for n in range(len(values)):
        for k in range(len(dofs)):
            pose[dofs[k]] = values[n, k]
        place_frames(pose, offsets_m, frames, T_world_frame)
        energy = 0.0
        for c in range(len(P_px_world)):
            draw(T_world_frame, surfaces, P_px_world[c], lenses[c], detail_px, mesh, scratch, canvas)
            energy += costs[1, c] * (costs[0, c] + collect_gain(canvas, gain_sums[c]))
        energies[n] = energy


@njit_without_refcounts
def cover(
    T_world_frame: Floats,
    surfaces: Ints,
    cameras: tuple[Floats, Floats],
    detail_px: float,
    mesh: MeshArrays,
    scratch: Scratch,
    canvas: Canvas,
    covered: Bytes,
) -> None:
    """Set the bits of pixels that bodies cover in covered (N, P, H, W); T_world_frame (N, J + 5, 4, 4)."""
    P_px_world, lenses = cameras
    for n in range(len(T_world_frame)):
        for c in range(len(P_px_world)):
            draw(T_world_frame[n], surfaces, P_px_world[c], lenses[c], detail_px, mesh, scratch, canvas)
            collect_bits(canvas, covered[n, c // 8], np.uint8(1 << c % 8))


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _coarsest(errors_m: Floats, s: int, allowed_m: float) -> int:
    """The last level of segment s that is off by no more than is allowed."""
    level = len(errors_m) - 1
    while level > 0 and errors_m[level, s] > allowed_m:
        level -= 1
    return level


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def compose(P: Floats, T: Floats, M: Floats) -> None:
    """Write the product of P (3, 4) and T (4, 4) into M (3, 4)."""
    for i in range(3):
        for j in range(4):
            M[i, j] = P[i, 0] * T[0, j] + P[i, 1] * T[1, j] + P[i, 2] * T[2, j] + P[i, 3] * T[3, j]
