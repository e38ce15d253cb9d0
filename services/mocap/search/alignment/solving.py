"""Compiled Gauss-Newton steps of a pose: match, sum, solve, step within the joint limits, again."""

from typing import TypeAlias

import numba
import numpy as np

from services.mocap.body.kinematics import N_DOF, N_JOINTS, place_joints
from services.mocap.energy.cpu.collecting import Canvas
from services.mocap.energy.cpu.evaluation import cover
from services.mocap.energy.cpu.outline import MeshArrays, Scratch
from services.mocap.search.alignment.pulls import (
    Input,
    PullScratch,
    RimArrays,
    Views,
    normal_equations,
    sum_pulls,
)
from services.mocap.search.alignment.twists import TWIST_SIZE, place_twists
from services.mocap.types import Floats, Ints

Drawing: TypeAlias = tuple[Ints, MeshArrays, Scratch, tuple[Floats, Floats], Canvas]
"""Segments drawn; mesh, scratch, cameras and canvas as cover takes them."""
Rims: TypeAlias = tuple[Ints, RimArrays, Views, PullScratch]
"""Segments that pull; mesh, views and scratch as sum_pulls takes them."""
_SINGULAR = 1e-6


@numba.njit(cache=True, nogil=True, error_model="numpy")
def follow(
    pose: Floats,
    offsets_m: Floats,
    joints: Ints,
    seen: Input,
    drawing: Drawing,
    detail_px: float,
    rims: Rims,
    stages: Floats,
    free: Floats,
    prior: Floats,
    limits: Floats,
    prior_cost: Floats,
    shares_px: Floats,
) -> None:
    """Move a pose (D,) in place so that the rim comes to lie on the contours.

    seen: as sum_pulls takes it. stages (K, 3): for every step the reach, the cap, and the damping as a share
    of the diagonal. free (D,): 1 for parameters that vary. prior (3, D): target, weight of its square, and
    the largest step. limits (2, D). prior_cost (1,) gets the prior's at the last match, shares_px (S,
    SHARES) what sum_pulls sets.
    """
    segments, mesh, scratch, cameras, canvas = drawing
    pulling, rim, views, room = rims
    T_world_joint = np.empty((1, N_JOINTS, 4, 4))
    model_planes = np.zeros((1, *seen[0].shape), np.uint8)
    twists, wrenches = np.zeros((N_DOF, TWIST_SIZE)), np.empty((N_JOINTS, TWIST_SIZE, TWIST_SIZE))
    pulls, hessian, slope = np.empty((N_JOINTS, TWIST_SIZE)), np.empty((N_DOF, N_DOF)), np.empty(N_DOF)
    for k in range(len(stages)):
        reach_px, cap_px, damping = stages[k]
        place_joints(pose, offsets_m, joints, T_world_joint[0])
        model_planes[:] = 0
        cover(T_world_joint, segments, cameras, detail_px, mesh, scratch, canvas, model_planes)
        place_twists(pose, T_world_joint[0], twists)
        sum_pulls(
            rim, pulling, T_world_joint[0], views, seen, model_planes[0],
            int(reach_px), cap_px, room, wrenches, pulls, shares_px,
        )  # fmt: skip
        normal_equations(twists, wrenches, pulls, hessian, slope)
        prior_cost[0] = 0.0
        for d in range(N_DOF):
            off = pose[d] - prior[0, d]
            prior_cost[0] += prior[1, d] * off * off
            hessian[d, d] += prior[1, d]
            slope[d] += prior[1, d] * off
            hessian[d, d] += damping * hessian[d, d] + _SINGULAR
        _step(pose, hessian, slope, free, prior[2], limits)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _step(
    pose: Floats, hessian: Floats, slope: Floats, free: Floats, longest: Floats, limits: Floats
) -> None:
    """One step downhill; parameters at a limit that would be pushed beyond stay out of the equations."""
    held = free == 0.0
    for _ in range(3):
        for d in range(N_DOF):
            if held[d]:
                hessian[d, :] = 0.0
                hessian[:, d] = 0.0
                hessian[d, d] = 1.0
                slope[d] = 0.0
        step = np.linalg.solve(hessian, slope)
        again = False
        for d in range(N_DOF):
            target = pose[d] - step[d]
            if not held[d] and (target < limits[0, d] or target > limits[1, d]):
                at_limit = pose[d] <= limits[0, d] if target < limits[0, d] else pose[d] >= limits[1, d]
                if at_limit:
                    held[d] = again = True
        if not again:
            break
    for d in range(N_DOF):
        move = min(max(-step[d], -longest[d]), longest[d])
        if not held[d]:
            pose[d] = min(max(pose[d] + move, limits[0, d]), limits[1, d])
