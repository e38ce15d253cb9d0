"""energies.csv and timings.csv: where model and silhouettes differ in each frame, and what took how long."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from services.mocap.result.layout import ENERGIES, TIMINGS
from services.mocap.take.csv_columns import Columns, as_cells, read_columns, write_columns
from services.mocap.take.quantities import QUANTITIES, Labelled, Quantity, Solved, gathered
from services.mocap.types import Ints

FRAME_FILES = (ENERGIES, TIMINGS)


def write_frame_files(
    folder: Path, frames: Ints, solved: Sequence[Solved], stages: Sequence[str], cameras: Sequence[str]
) -> None:
    """Write the files of N frames, each completely or not at all; none that some frame lacks numbers of.

    A frame that says nothing of one of the stages has spent no time in it.
    """
    for name in FRAME_FILES:
        values = {}
        for row in _rows_of(name):
            labels = {"camera": cameras, "stage": stages}.get(row.per, row.labels)
            values[row.name] = gathered(solved, row, labels)
            if row.per == "stage":
                values[row.name] = {label: np.nan_to_num(s) for label, s in values[row.name].items()}
        if all(np.isfinite(numbers).all() for labelled in values.values() for numbers in labelled.values()):
            write_frame_file(folder / name, frames, values)


def write_frame_file(path: Path, frames: Ints, values: Mapping[str, Labelled]) -> None:
    """Write the quantities that belong into the file of this name, completely or not at all."""
    columns = {"frame": [str(frame) for frame in frames]}
    for row in _rows_of(path.name):
        for label, numbers in values[row.name].items():
            column = row.column.format(label)
            columns[column] = as_cells(column, numbers, row.digits)
    write_columns(path, columns)


def read_frame_file(path: Path) -> tuple[Ints, dict[str, Labelled]]:
    """The frames (N,), and the quantities of the file of this name.

    Raises TakeError, which names the file and the column or line.
    """
    fixed = [row for row in _rows_of(path.name) if row.per in ("frame", "part")]
    required = ["frame", *(row.column.format(label) for row in fixed for label in row.labels)]
    columns = read_columns(path, required, allow_extra=True)
    frames = columns.numbers("frame").astype(np.int32)
    return frames, {row.name: _labelled(columns, row) for row in _rows_of(path.name)}


def _labelled(columns: Columns, row: Quantity) -> Labelled:
    head, _, tail = row.column.partition("{}")
    names = [name for name in columns.cells if name.startswith(head) and name.endswith(tail)]
    if row.per in ("frame", "part"):
        names = [row.column.format(label) for label in row.labels]
    return {
        name.removeprefix(head).removesuffix(tail): columns.numbers(name, most=row.most) for name in names
    }


def _rows_of(name: str) -> list[Quantity]:
    return [row for row in QUANTITIES if row.file == name]
