"""Compiled evaluation of batches: from parameter values to energies, or to covered pixels, in one call."""

import numpy as np

from services.mocap.body.kinematics import place_frames
from services.mocap.energy.cost import Counts
from services.mocap.energy.cpu.collecting import Canvas, collect_bits, collect_gain
from services.mocap.energy.cpu.njit_without_refcounts import njit_without_refcounts
from services.mocap.energy.cpu.outline import MeshArrays, Scratch, draw
from services.mocap.types import Bytes, Floats, Ints


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
    gain_sums: Counts,
    costs: Floats,
    canvas: Canvas,
    energies: Floats,
) -> None:
    """Write the energies (N,) of values (N, d).

    plan: the parameters that vary (d,), the frames that they move, the surfaces that are drawn. pose (D,)
    and T_world_frame (J + 5, 4, 4): a base pose and its transforms, of which only what the plan names
    changes. gain_sums (C, H, W + 1) as summed_gain makes it; costs (3, C): blank, weights and cap of the
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
            cost = costs[0, c] + collect_gain(canvas, gain_sums[c])
            energy += costs[1, c] * (cost / (1.0 + cost / costs[2, c]))
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
