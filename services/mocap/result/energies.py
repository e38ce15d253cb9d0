"""energies.csv: where model and silhouettes differed in each frame, by the body's part and by camera."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from services.mocap.errors import TakeError
from services.mocap.take.csv_columns import as_cells, read_columns, write_columns
from services.mocap.take.marks import PARTS
from services.mocap.types import Floats, Ints

_PART_COLUMNS = [f"energy_{part}_px" for part in PARTS]
_IOU = "iou_"


@dataclass(frozen=True, eq=False)
class Energies:
    """Of N frames and C cameras."""

    frames: Ints
    """(N,)"""
    part_px: Floats
    """(N, 6) the energy by the part of PARTS that each differing pixel is nearest to."""
    cameras: Sequence[str]
    """The cameras' names."""
    iou: Floats
    """(N, C) intersection over union of model and silhouette in each camera, 0 to 1."""


def write_energies_csv(path: Path, energies: Energies) -> None:
    """Write them, whole or not at all."""
    columns = {"frame": [str(frame) for frame in energies.frames]}
    for name, values in zip(_PART_COLUMNS, energies.part_px.T, strict=True):
        columns[name] = as_cells(name, values, ".10g")
    for camera, values in zip(energies.cameras, energies.iou.T, strict=True):
        columns[_IOU + camera] = as_cells(camera, values, ".4f")
    write_columns(path, columns)


def read_energies_csv(path: Path) -> Energies:
    """Raises TakeError, which names the file and the column or line."""
    columns = read_columns(path, ["frame", *_PART_COLUMNS], allow_extra=True)
    frames = columns.numbers("frame")
    cameras = [name.removeprefix(_IOU) for name in columns.cells if name.startswith(_IOU)]
    iou = np.array([columns.numbers(_IOU + camera) for camera in cameras]).reshape(len(cameras), len(frames))
    if np.any((iou < 0) | (iou > 1)):
        raise TakeError(f"{path}: {_IOU}: expected numbers from 0 to 1")
    part_px = np.column_stack([columns.numbers(name) for name in _PART_COLUMNS])
    return Energies(frames.astype(np.int32), part_px, cameras, iou.T)
