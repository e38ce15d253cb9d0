"""Compiled Gauss-Newton iterations of a pose: match, sum, solve, step within the joint limits."""

from typing import TypeAlias

import numba
import numpy as np

from services.mocap.body.kinematics import N_DOF, N_FRAMES, SURFACE_FRAMES, place_frames
from services.mocap.energy.cpu.collecting import Canvas
from services.mocap.energy.cpu.evaluation import cover
from services.mocap.energy.cpu.outline import MeshArrays, Scratch
from services.mocap.search.alignment.contacts import Contacts, add_contacts
from services.mocap.search.alignment.matching import (
    SHARES,
    Input,
    Matches,
    RimArrays,
    RimScratch,
    Views,
    match_view,
)
from services.mocap.search.alignment.normal_equations import add_matches, normal_equations
from services.mocap.search.alignment.twists import TWIST_SIZE, place_twists
from services.mocap.search.pose_prior import PosePrior, add_prior
from services.mocap.types import Floats, Ints

Drawing: TypeAlias = tuple[Ints, Ints, MeshArrays, Scratch, tuple[Floats, Floats], Canvas]
"""Surfaces that stay where they are, and those that move; mesh, scratch, cameras and canvas as cover takes
them."""
Rims: TypeAlias = tuple[Ints, RimArrays, Views, tuple[RimScratch, Matches]]
"""Surfaces that pull; mesh, views and room as match_view takes them."""
Unlikely: TypeAlias = tuple[Contacts, float, PosePrior, float]
"""Shapes that limbs must not be inside of, and the prior of their poses, each with its weight, as
add_contacts and add_prior take them."""
_SINGULAR = 1e-6


@numba.njit(cache=True, nogil=True, error_model="numpy")
def follow(
    start: Floats,
    offsets_m: Floats,
    frames: Ints,
    seen: Input,
    drawing: Drawing,
    detail_px: float,
    rims: Rims,
    steps: Floats,
    free: Floats,
    prior: Floats,
    limits: Floats,
    unlikely: Unlikely,
) -> tuple[Floats, float, Floats, Floats]:
    """Move a pose (D,) so that the rim comes to lie on the contours.

    steps (K, 4): for every step, in pixels, the reach, the distance that counts as on the contour, and the
    cap; and the damping as a share of the diagonal. free (D,): 1 for parameters that vary. prior (3, D):
    target, weight of its square, and the largest step. limits (2, D). Returns the pose, and of the last match
    the prior's cost, the rim's shares (S + 5, SHARES), and the normal matrices of the places of the frames
    (J + 5, 3, 3), their lower halves.
    """
    still, moving, mesh, scratch, cameras, canvas = drawing
    pulling, rim, views, (rim_scratch, matches) = rims
    contacts, contact_weight, pose_prior, pose_weight = unlikely
    pose, prior_cost, shares_px = start.copy(), 0.0, np.zeros((len(SURFACE_FRAMES), SHARES))
    T_world_frame = np.empty((1, N_FRAMES, 4, 4))
    place_frames(pose, offsets_m, frames, T_world_frame[0])
    still_planes = np.zeros((1, *seen[0].shape), np.uint8)
    cover(T_world_frame, still, cameras, detail_px, mesh, scratch, canvas, still_planes)
    twists, wrenches = np.zeros((N_DOF, TWIST_SIZE)), np.empty((N_FRAMES, TWIST_SIZE, TWIST_SIZE))
    pulls, places = np.empty((N_FRAMES, TWIST_SIZE)), np.zeros((N_FRAMES, 3, 3))
    for k in range(len(steps)):
        reach_px, near_px, cap_px, damping = steps[k]
        place_frames(pose, offsets_m, frames, T_world_frame[0])
        model_planes = still_planes.copy()
        cover(T_world_frame, moving, cameras, detail_px, mesh, scratch, canvas, model_planes)
        place_twists(pose, T_world_frame[0], twists)
        wrenches[:], pulls[:], shares_px[:] = 0.0, 0.0, 0.0
        for c in range(len(views[2])):
            if views[2][c] > 0.0:
                n = match_view(
                    c, rim, pulling, T_world_frame[0], views, seen, model_planes[0],
                    int(reach_px), near_px, rim_scratch, matches, shares_px,
                )  # fmt: skip
                add_matches(matches, n, cap_px, wrenches, pulls)
        places = wrenches[:, 3:, 3:].copy()  # now: normal_equations adds to a joint what its children carry
        hessian, slope = normal_equations(twists, wrenches, pulls)
        add_contacts(contacts, contact_weight, T_world_frame[0], twists, hessian, slope)
        add_prior(pose_prior, pose_weight, pose, hessian, slope)
        prior_cost = 0.0
        for d in range(N_DOF):
            off = pose[d] - prior[0, d]
            prior_cost += prior[1, d] * off * off
            hessian[d, d] += prior[1, d]
            slope[d] += prior[1, d] * off
            hessian[d, d] += damping * hessian[d, d] + _SINGULAR
        _step(pose, hessian, slope, free, prior[2], limits)
    return pose, prior_cost, shares_px, places


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _step(
    pose: Floats, hessian: Floats, slope: Floats, free: Floats, longest: Floats, limits: Floats
) -> None:
    """One step downhill; parameters at a limit that would move beyond it are left out of the equations."""
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
