"""Compiled normal equations of moving a pose, from the matches of its rim with the input's contours."""

import numba
import numpy as np

from services.mocap.body.cloth_frames import PELVIS
from services.mocap.body.kinematics import HANGING, N_DOF, N_JOINTS, PARENT
from services.mocap.energy.cpu.njit_without_refcounts import njit_without_refcounts
from services.mocap.search.alignment.matching import Matches
from services.mocap.search.alignment.twists import DOF_JOINT, MOVED_BY, TWIST_SIZE
from services.mocap.types import Floats


@njit_without_refcounts
def add_matches(matches: Matches, n: int, cap_px: float, wrenches: Floats, pulls: Floats) -> None:
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
def normal_equations(twists: Floats, wrenches: Floats, pulls: Floats) -> tuple[Floats, Floats]:
    """The normal matrix (D, D) and the gradient (D,) of all parameters.

    wrenches and pulls as add_matches leaves them; what joints carry is summed down the tree in them (as in
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
