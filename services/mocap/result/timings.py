"""timings.csv: how long each stage took in each frame."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from services.mocap.take.csv_columns import as_cells, read_columns, write_columns
from services.mocap.types import Floats, Ints


def write_timings_csv(path: Path, frames: Ints, seconds: Sequence[Mapping[str, float]]) -> None:
    """Write the wall time in seconds of every stage, by name, of every frame (N,), whole or not at all."""
    stages = sorted({stage for row in seconds for stage in row})
    columns = {"frame": [str(frame) for frame in frames]}
    for stage in stages:
        values = np.array([row.get(stage, 0.0) for row in seconds])
        columns[f"{stage}_s"] = as_cells(stage, values, ".6f")
    write_columns(path, columns)


def read_timings_csv(path: Path) -> dict[str, Floats]:
    """Seconds (N,) by stage; raises TakeError, which names the file and the column or line."""
    columns = read_columns(path, ["frame"], allow_extra=True)
    return {name.removesuffix("_s"): columns.numbers(name) for name in columns.cells if name != "frame"}
