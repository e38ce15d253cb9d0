"""Measured points of the scene: a table of where cameras see them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from services.mocap.errors import CalibrationError, nearest
from services.mocap.take.csv_columns import read_columns
from services.mocap.types import Floats

COLUMNS = ("camera", "u", "v", "x", "y", "z")


@dataclass(frozen=True, eq=False)
class ScenePoints:
    """Measured points in pictures, one row for each point in a camera's picture."""

    path: Path
    cameras: tuple[str, ...]
    """(N,) names."""
    points_px: Floats
    """(N, 2) in the raw picture, pixel centres at whole coordinates."""
    points_world_m: Floats
    """(N, 3) in the z-up world. Rows with equal coordinates are of the same point."""
    lines: tuple[int, ...]
    """(N,) of the file."""


def read_points(path: Path, names: Sequence[str] | None = None) -> ScenePoints:
    """Read a table with the columns camera, u, v (pixels) and x, y, z (metres); raises TakeError.

    names: the cameras that may be named in it, if they are known.
    """
    table = read_columns(path, COLUMNS, allow_extra=True)
    cameras = tuple(cell.strip() for cell in table.cells["camera"])
    for name, line in zip(cameras, table.lines, strict=True):
        if names is not None and name not in names:
            raise CalibrationError(f"{path}: line {line}: camera: unknown {name}: {nearest(name, names)}")
    u, v, *xyz = (table.numbers(column) for column in COLUMNS[1:])
    return ScenePoints(path, cameras, np.stack([u, v], 1), np.stack(xyz, 1), tuple(table.lines))
