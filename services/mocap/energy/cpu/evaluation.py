"""Compiled evaluation of batches: from parameter values to energies, or to covered pixels, in one call."""

import numba
import numpy as np

from services.mocap.body.kinematics import place_joints
from services.mocap.energy.cost import Counts
from services.mocap.energy.cpu.collecting import Canvas, collect_bits, collect_gain
from services.mocap.energy.cpu.facing import EYE_SIZE
from services.mocap.energy.cpu.outline import MeshArrays, Scratch, draw
from services.mocap.types import Bytes, Floats, Ints


@numba.njit(cache=True, nogil=True, error_model="numpy")
def evaluate(
    values: Floats,
    plan: tuple[Ints, Ints, Ints],
    pose: Floats,
    T_world_joint: Floats,
    offsets_m: Floats,
    cameras: tuple[Floats, Floats],
    detail_px: float,
    mesh: MeshArrays,
    scratch: Scratch,
    gain_sums: Counts,
    costs: Floats,
    width_px: int,
    canvas: Canvas,
    energies: Floats,
) -> None:
    """Write the energies (N,) of values (N, d).

    plan: the parameters that vary (d,), the joints that they move, the segments that are drawn. pose (35,)
    and T_world_joint (17, 4, 4): a base pose and its transforms, of which only what the plan names changes.
    gain_sums (C, H, columns) as summed_gain makes it for pictures of width_px; costs (3, C): blank, weights
    and cap of the Tally; canvas from empty_canvas.
    """
    dofs, joints, segments = plan
    P_px_world, lenses = cameras
    extent, M, eye = np.empty(2, np.int32), np.empty((3, 4)), np.empty(EYE_SIZE, np.float32)
    for n in range(len(values)):
        for k in range(len(dofs)):
            pose[dofs[k]] = values[n, k]
        place_joints(pose, offsets_m, joints, T_world_joint)
        energy = 0.0
        for c in range(len(P_px_world)):
            draw(
                T_world_joint,
                segments,
                P_px_world[c],
                lenses[c],
                detail_px,
                mesh,
                scratch,
                width_px,
                (M, eye),
                canvas,
                extent,
            )
            cost = costs[0, c] + collect_gain(canvas, extent, gain_sums[c])
            energy += costs[1, c] * (cost / (1.0 + cost / costs[2, c]))
        energies[n] = energy


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cover(
    T_world_joint: Floats,
    segments: Ints,
    cameras: tuple[Floats, Floats],
    detail_px: float,
    mesh: MeshArrays,
    scratch: Scratch,
    canvas: Canvas,
    covered: Bytes,
) -> None:
    """Set the bits of every pixel that bodies cover in covered (N, P, H, W); T_world_joint (N, 17, 4, 4)."""
    P_px_world, lenses = cameras
    extent, M, eye = np.empty(2, np.int32), np.empty((3, 4)), np.empty(EYE_SIZE, np.float32)
    width_px = covered.shape[3]
    for n in range(len(T_world_joint)):
        for c in range(len(P_px_world)):
            draw(
                T_world_joint[n],
                segments,
                P_px_world[c],
                lenses[c],
                detail_px,
                mesh,
                scratch,
                width_px,
                (M, eye),
                canvas,
                extent,
            )
            collect_bits(canvas, extent, covered[n, c // 8], np.uint8(1 << c % 8))
