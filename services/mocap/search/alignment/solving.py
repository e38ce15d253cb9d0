"""Compiled Gauss-Newton iterations of a pose: match, sum, solve, step within the joint limits."""

from typing import TypeAlias

import numba
import numpy as np

from services.mocap.body.cloth_frames import PELVIS
from services.mocap.body.kinematics import (
    HANGING,
    N_DOF,
    N_FRAMES,
    N_JOINTS,
    PARENT,
    SURFACE_FRAMES,
    place_frames,
)
from services.mocap.energy.cpu.collecting import Canvas
from services.mocap.energy.cpu.outline import MeshArrays, Scratch, cover
from services.mocap.njit import njit_without_refcounts
from services.mocap.search.alignment.matching import (
    SHARES,
    Input,
    Matches,
    RimArrays,
    RimScratch,
    Views,
    match_view,
)
from services.mocap.search.alignment.pose_prices import PosePrices, add_prices
from services.mocap.search.alignment.twists import DOF_JOINT, MOVED_BY, TWIST_SIZE, place_twists
from services.mocap.types import Floats, Ints

Drawing: TypeAlias = tuple[Ints, Ints, MeshArrays, Scratch, tuple[Floats, Floats], Canvas]
"""Surfaces that stay where they are, and those that move; mesh, scratch, cameras and canvas as cover takes
them."""
Rims: TypeAlias = tuple[Ints, RimArrays, Views, tuple[RimScratch, Matches]]
"""Surfaces that pull; mesh, views and room as match_view takes them."""
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
    anchor: Floats,
    limits: Floats,
    prices: PosePrices,
) -> tuple[Floats, float, Floats, Floats]:
    """Move a pose (D,) so that the rim comes to lie on the contours.

    steps (K, 4): for every step, in pixels, the reach, the distance that counts as on the contour, and the
    cap; and the damping as a share of the diagonal. free (D,): 1 for parameters that vary. anchor (3, D):
    target, weight of its square, and the largest step. limits (2, D). Returns the pose, and of the last match
    the anchor's cost, the rim's shares (S + 5, SHARES), and the normal matrices of the places of the frames
    (J + 5, 3, 3), their lower halves.
    """
    still, moving, mesh, scratch, cameras, canvas = drawing
    pulling, rim, views, (rim_scratch, matches) = rims
    pose, anchor_cost, shares_px = start.copy(), 0.0, np.zeros((len(SURFACE_FRAMES), SHARES))
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
                _add_matches(matches, n, cap_px, wrenches, pulls)
        places = wrenches[:, 3:, 3:].copy()  # now: _normal_equations adds to a joint what its children carry
        hessian, slope = _normal_equations(twists, wrenches, pulls)
        add_prices(prices, pose, T_world_frame[0], twists, hessian, slope)
        anchor_cost = 0.0
        for d in range(N_DOF):
            off = pose[d] - anchor[0, d]
            anchor_cost += anchor[1, d] * off * off
            hessian[d, d] += anchor[1, d]
            slope[d] += anchor[1, d] * off
            hessian[d, d] += damping * hessian[d, d] + _SINGULAR
        _step(pose, hessian, slope, free, anchor[2], limits)
    return pose, anchor_cost, shares_px, places


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


@njit_without_refcounts
def _add_matches(matches: Matches, n: int, cap_px: float, wrenches: Floats, pulls: Floats) -> None:
    """Add n matches to the sums of their frames, wrenches (J + 5, 6, 6) and pulls (J + 5, 6).

    With the row w of the Jacobian by the frame's twist, the residual r and its length l of outline:

        wrench += weight w w'  (its lower half),    pull += weight r w,    weight = l / (1 + (r / cap)^2)
    """
    _, frames, residuals_px, lengths_px, rows = matches
    for n_th in range(n):
        r, w = residuals_px[n_th], rows[n_th]
        wrench, pull = wrenches[frames[n_th]], pulls[frames[n_th]]
        weight = lengths_px[n_th] / (1.0 + (r / cap_px) ** 2)
        for i in range(TWIST_SIZE):
            weighted = weight * w[i]
            pull[i] += weighted * r
            for k in range(i + 1):
                wrench[i, k] += weighted * w[k]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _normal_equations(twists: Floats, wrenches: Floats, pulls: Floats) -> tuple[Floats, Floats]:
    """The normal matrix (D, D) and the gradient (D,) of all parameters.

    wrenches and pulls as _add_matches leaves them; what joints carry is summed down the tree in them (as in
    the composite rigid body algorithm: Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 6).
    What cloth that hangs from the pelvis carries is the pelvis's.
    """
    hessian, slope = np.empty((N_DOF, N_DOF)), np.empty(N_DOF)
    wrenches[PELVIS] += wrenches[HANGING]
    pulls[PELVIS] += pulls[HANGING]
    for j in range(N_JOINTS):
        for i in range(TWIST_SIZE):
            for k in range(i):
                wrenches[j, k, i] = wrenches[j, i, k]
    for j in range(N_JOINTS - 1, 0, -1):
        wrenches[PARENT[j]] += wrenches[j]
        pulls[PARENT[j]] += pulls[j]
    moved = np.empty(TWIST_SIZE)
    for d in range(N_DOF):
        joint = DOF_JOINT[d]
        for i in range(TWIST_SIZE):
            moved[i] = 0.0
            for k in range(TWIST_SIZE):
                moved[i] += wrenches[joint, i, k] * twists[d, k]
        slope[d] = _dot(twists[d], pulls[joint])
        for e in range(d + 1):
            value = _dot(twists[e], moved) if MOVED_BY[DOF_JOINT[e], joint] else 0.0
            hessian[d, e] = hessian[e, d] = value
    return hessian, slope


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _dot(a: Floats, b: Floats) -> float:
    total = 0.0
    for i in range(TWIST_SIZE):
        total += a[i] * b[i]
    return total
