"""What OpenSim reads of motion.trc, and the package c3d of motion.c3d."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.checks.tools import run
from services.mocap.types import Floats

_SCRIPT = Path(__file__).with_name("in_readers.py")


@dataclass(frozen=True, eq=False)
class Points:
    """The content of a file."""

    labels: tuple[str, ...]
    unit: str
    rate_hz: float
    points: Floats
    """(N, P, 3) in that unit and the file's axes."""


def read_points(python: Path, trc: Path, c3d: Path) -> tuple[Points, Points]:
    """Read a TRC and a C3D file with other people's readers."""
    found = json.loads(run([str(python), str(_SCRIPT), str(trc), str(c3d)]))
    first, second = (
        Points(tuple(one["labels"]), one["unit"], one["rate"], np.array(one["points"]))
        for one in (found["trc"], found["c3d"])
    )
    return first, second
