"""Makes services/mocap/search/pose_prior.csv from the motions of takes whose true joints are known."""

from pathlib import Path

import numpy as np
import typer

from bench.typical_poses import TakesOfMotion, poses_of
from services.mocap.search.chains import LIMBS
from services.mocap.search.pose_prior import PARAMETERS, TABLE
from services.mocap.take.csv_columns import as_cells, write_columns
from services.mocap.types import Floats

_BROADER_RAD = 0.14
"""Standard deviation that is added to each parameter's: other people and motions, and errors of poses from
joints."""


def write_prior(poses: Floats, path: Path = TABLE) -> None:
    """Write the means and covariances of the limbs in poses (N, D); left and right have the same ones."""
    names, means, rows = list[str](), list[Floats](), list[Floats]()
    for part, parameters in PARAMETERS.items():
        of_part = [poses[:, list(limb.main.dofs)] for name, limb in LIMBS.items() if name.endswith(part)]
        both_sides = np.vstack(of_part)
        names += parameters
        means.append(both_sides.mean(axis=0))
        rows.append(np.cov(both_sides.T) + _BROADER_RAD**2 * np.eye(len(parameters)))
    columns = {"parameter": names, "mean_rad": as_cells("mean_rad", np.concatenate(means), ".3f")}
    for k, covariances in enumerate(np.vstack(rows).T):
        columns[f"with_{k + 1}"] = as_cells(f"with_{k + 1}", covariances, ".4f")
    write_columns(path, columns)


def make_table(takes: TakesOfMotion) -> None:
    """Make the table of how likely limbs' poses are, from takes' true motions."""
    poses = np.vstack([poses_of(take) for take in takes])
    write_prior(poses)
    typer.echo(f"made of {len(poses)} poses")
