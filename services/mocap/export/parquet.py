"""A result's tables as Parquet, units in the columns' metadata; needs pyarrow, which containers lack."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet

from services.mocap.atomic import atomic_file
from services.mocap.body.skeleton import DOFS
from services.mocap.result.layout import ANGLES_PARQUET, JOINTS_PARQUET, POSES_PARQUET
from services.mocap.result.result import Result
from services.mocap.take.marks import PARTS
from services.mocap.take.quantities import QUANTITIES
from services.mocap.take.tables import REFERENCE_JOINTS

Column = tuple[Any, str]
"""Values (N,), and their unit."""


def write_parquet(folder: Path, result: Result) -> None:
    """Write the poses, the joints and the angles into a folder, each file completely or not at all.

    Poses are the motion as in motion.bvh, beside energy and marks; joints are in the z-up world.
    """
    frames: dict[str, Column] = {"frame": (result.frames, "1"), "time_s": (result.times_s, "s")}
    joints: dict[str, Column] = {
        f"{joint}_{axis}_m": (np.ascontiguousarray(result.joints_world_m[:, j, a]), "m")
        for j, joint in enumerate(REFERENCE_JOINTS)
        for a, axis in enumerate("xyz")
    }
    angles = {f"{name}_deg": (values, "deg") for name, values in result.angles_deg.items()}
    tables = {
        POSES_PARQUET: {**frames, **_poses(result)},
        JOINTS_PARQUET: {**frames, **joints},
        ANGLES_PARQUET: {**frames, **angles},
    }
    for name, columns in tables.items():
        with atomic_file(folder / name) as part:
            fields = [
                pyarrow.field(name, pyarrow.array(values).type, metadata={"unit": unit})
                for name, (values, unit) in columns.items()
            ]
            values = [values for values, _ in columns.values()]
            pyarrow.parquet.write_table(pyarrow.table(values, schema=pyarrow.schema(fields)), part)


def _poses(result: Result) -> dict[str, Column]:
    columns: dict[str, Column] = {
        dof.column: (values, dof.unit) for dof, values in zip(DOFS, result.poses.T, strict=True)
    }
    kept = sorted((row for row in QUANTITIES if row.in_parquet), key=lambda row: row.name)
    for label in ("", *PARTS):  # what is of the whole frame, then part by part
        for row in kept:
            if label in result.quantities.get(row.name, {}):
                name = f"{row.name}_{label}" if label else row.name
                columns[name] = (result.quantities[row.name][label], row.unit)
    return columns
