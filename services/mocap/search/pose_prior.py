"""How unusual limbs' poses are among people: this places limbs that no camera sees, and decides between poses
that look alike.

Arms and legs have one mean and one covariance each, of the parameters of ball and hinge. Near the mean a pose
costs half its squared Mahalanobis distance, far away only the distance's logarithm: a pose that people seldom
take costs little less than one that they never take. The table beside this module is made by
`scripts/bench pose-prior` from true motions.
"""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np

from services.mocap.body.skeleton import DOFS, bare
from services.mocap.search.chains import LIMBS
from services.mocap.take.csv_columns import read_columns
from services.mocap.types import Floats, Ints

TABLE = Path(__file__).with_suffix(".csv")
PARAMETERS = {bare(name): [bare(DOFS[d].name) for d in limb.main.dofs] for name, limb in LIMBS.items()}
"""Arm and leg -> the parameters of their ball and hinge, without the side."""
_FAR = 8.0
"""Squared distance at which the price turns from a parabola to a logarithm."""


class PosePrior(NamedTuple):
    """Means and inverse covariances of the limbs, in the order of LIMBS."""

    dofs: Ints
    """(4, K) the parameters of each limb's ball and hinge."""
    means: Floats
    """(4, K)"""
    precisions: Floats
    """(4, K, K)"""


@cache
def pose_prior() -> PosePrior:
    """That of the table."""
    table = read_columns(TABLE, [], allow_extra=True)
    rows = dict(zip(table.cells["parameter"], range(len(table.lines)), strict=True))
    means, precisions = list[Floats](), list[Floats]()
    for name in LIMBS:
        at = [rows[parameter] for parameter in PARAMETERS[bare(name)]]
        covariance = np.array([table.numbers(f"with_{k + 1}")[at] for k in range(len(at))])
        means.append(table.numbers("mean_rad")[at])
        precisions.append(np.linalg.inv(covariance))
    dofs = np.array([limb.main.dofs for limb in LIMBS.values()], np.int32)
    return PosePrior(dofs, np.array(means), np.array(precisions))


def surprises(poses: Floats) -> Floats:
    """(N, 4) how unusual each limb is in poses (N, D): 0 at the mean."""
    prior = pose_prior()
    off = poses[:, prior.dofs] - prior.means
    squares = np.einsum("nlj,ljk,nlk->nl", off, prior.precisions, off)
    return np.asarray(0.5 * _FAR * np.log1p(squares / _FAR))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_pose_prior(prior: PosePrior, weight: float, pose: Floats, hessian: Floats, slope: Floats) -> None:
    """Add weight times the surprises at a pose (D,), with the curvature of a parabola that touches them, to
    the normal equations (D, D) and (D,)."""
    n_dofs = prior.dofs.shape[1]
    for limb in range(len(prior.dofs)):
        dofs, precision = prior.dofs[limb], prior.precisions[limb]
        square = 0.0
        for j in range(n_dofs):
            for k in range(n_dofs):
                off = pose[dofs[k]] - prior.means[limb, k]
                square += (pose[dofs[j]] - prior.means[limb, j]) * precision[j, k] * off
        share = 0.5 * weight / (1.0 + square / _FAR)
        for j in range(n_dofs):
            for k in range(n_dofs):
                hessian[dofs[j], dofs[k]] += share * precision[j, k]
                slope[dofs[j]] += share * precision[j, k] * (pose[dofs[k]] - prior.means[limb, k])
