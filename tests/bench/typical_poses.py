"""Makes services/mocap/search/typical_poses.csv from the motions of takes whose true joints are known.

Poses nearest to the joints of people are found for the generic body in every so many frames. Medoids of these
and of their mirror images are typical: greedy ones, exchanged while that brings every pose nearer to one.
"""

from pathlib import Path
from typing import Annotated, TypeAlias

import numpy as np
import typer

from bench.pose_floor import true_poses
from bench.studio_takes import true_actor
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import joint_positions
from services.mocap.body.segment_row import Vector
from services.mocap.body.skeleton import DOF_INDEX, DOFS, bare, mirrored
from services.mocap.search.typical_poses import TABLE, TOLD
from services.mocap.take.csv_columns import as_cells, write_columns
from services.mocap.take.layout import REFERENCE_JOINTS_CSV
from services.mocap.take.tables import read_joints_csv
from services.mocap.types import Floats

TakesOfMotion: TypeAlias = Annotated[
    list[Path], typer.Argument(metavar="TAKE...", help="z-up, with reference/joints.csv and actor.json.")
]
N_PAIRS = 24
"""Typical poses without their mirror images."""
_EVERY = 10
"""Frames between two poses of a take."""
_FAR_M = 0.5
"""Poses farther apart than this are simply different."""
_EXCHANGES = 3
_HEIGHT_M = 1.75


def poses_of(take: Path) -> Floats:
    """(F, D) poses in some frames of a z-up take, at the origin and facing along x."""
    body = build_body(Actor(height=round(true_actor(take).height_m, 3)))
    poses = true_poses(read_joints_csv(take / REFERENCE_JOINTS_CSV).joints_take_m[::_EVERY], body)
    at_origin = np.zeros_like(poses)
    at_origin[:, TOLD] = poses[:, TOLD]
    return at_origin


def mirror_images(poses: Floats) -> Floats:
    """Of poses (N, D) at the origin."""
    others = [DOF_INDEX[_opposite(dof.name)] for dof in DOFS]
    turns = [1.0 if dof.name != bare(dof.name) else _turn_in_mirror(dof.axis) for dof in DOFS]
    return np.asarray(poses[:, others] * turns)


def _opposite(name: str) -> str:
    swapped = {"left": "right", "right": "left"}.get(name.split("_")[0])
    return name if swapped is None else f"{swapped}_{bare(name)}"


def _turn_in_mirror(axis: Vector) -> float:
    """1 if a rotation about an axis of the body's middle stays as it is in a mirror, else -1."""
    return float(np.dot(axis, mirrored(axis, "right", is_axis=True)))


def typical(poses: Floats, n_pairs: int = N_PAIRS) -> tuple[Floats, float]:
    """(2 n, D): medoids of poses (N, D) and their mirror images; and their mean distance in metres from the
    nearest of these."""
    images = mirror_images(poses)
    distances_m = np.minimum(_distances_m(poses, poses), _distances_m(poses, images))
    chosen, nearest_m = list[int](), np.full(len(poses), _FAR_M)
    for turn in range(n_pairs * (1 + _EXCHANGES)):
        if turn >= n_pairs:  # each in turn makes way for what is best without it
            chosen.pop(0)
            nearest_m = np.minimum(distances_m[chosen].min(axis=0, initial=_FAR_M), _FAR_M)
        chosen.append(int(np.minimum(distances_m, nearest_m).sum(axis=1).argmin()))
        nearest_m = np.minimum(nearest_m, distances_m[chosen[-1]])
    return np.vstack([poses[chosen], images[chosen]]), float(nearest_m.mean())


def _distances_m(poses: Floats, others: Floats) -> Floats:
    """(N, M) root mean square distance of the joints of poses (N, D) and (M, D), their middles together."""
    first, second = (_centred_joints_m(each) for each in (poses, others))
    squares = (first**2).sum(axis=1)[:, None] + (second**2).sum(axis=1) - 2.0 * first @ second.T
    return np.asarray(np.sqrt(np.maximum(squares, 0.0) / (first.shape[1] // 3)))


def _centred_joints_m(poses: Floats) -> Floats:
    joints_m = joint_positions(poses, build_body(Actor(height=_HEIGHT_M)).offsets_m)
    return np.asarray((joints_m - joints_m.mean(axis=1, keepdims=True)).reshape(len(poses), -1))


def write_typical(poses: Floats, path: Path = TABLE) -> None:
    """Write the table of poses (N, D)."""
    told = [d for d in TOLD if poses[:, d].round(2).any()]  # joints tell nothing of hands and feet
    columns = {DOFS[d].column: as_cells(DOFS[d].column, poses[:, d].round(2) + 0.0, ".2f") for d in told}
    write_columns(path, columns)


def make_table(takes: TakesOfMotion) -> None:
    """Make the table of typical poses, where the search for a first pose starts, from takes' true motions."""
    poses, mean_m = typical(np.vstack([poses_of(take) for take in takes]))
    write_typical(poses)
    typer.echo(f"{len(poses)} poses written; those of the takes are {mean_m:.3f} m from the nearest")
