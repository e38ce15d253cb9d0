"""Poses that people take: starts for a search that does not know the frame before.

The table beside this module is made by `scripts/bench typical-poses`: medoids of the poses of people who
walk, run, jump, dance, fight, climb, crawl and play, each with its mirror image.
"""

from functools import cache
from pathlib import Path

import numpy as np

from services.mocap.body.kinematics import N_DOF, joint_positions
from services.mocap.body.skeleton import DOFS
from services.mocap.take.csv_columns import read_columns
from services.mocap.types import Floats

TABLE = Path(__file__).with_suffix(".csv")
TOLD = tuple(d for d, dof in enumerate(DOFS) if dof.role not in ("translation", "heading"))
"""Parameters of the table: all but where the body is and which way it faces."""
_APART_M = 0.15
"""Poses are different if some joint is farther apart."""


@cache
def typical_poses() -> Floats:
    """(N, D) at the origin, facing along x, the T pose first; parameters that the table lacks are 0."""
    table = read_columns(TABLE, [], allow_extra=True)
    poses = np.zeros((1 + len(table.lines), N_DOF))
    for d in TOLD:
        if DOFS[d].column in table.cells:
            poses[1:, d] = table.numbers(DOFS[d].column)
    poses.flags.writeable = False
    return poses


def first_apart(poses: Floats, most: int, offsets_m: Floats) -> Floats:
    """The first of some poses (N, D), and at most so many in all that are different from those before."""
    joints_m, kept = joint_positions(poses, offsets_m), list[int]()
    for p, own_m in enumerate(joints_m):
        off_m = np.linalg.norm(joints_m[kept] - own_m, axis=-1).max(axis=-1)
        if len(kept) < most and bool((off_m > _APART_M).all()):
            kept.append(p)
    return np.asarray(poses[kept])
