"""The one table of what is known of a solved frame beside its pose, and how it is read from a frame.

To add a quantity, add a row here and the line that puts its numbers into `FrameSolution.measured` under the
row's name (usually in `FrameSolution.note_shares`, which every search calls). The pose message and the
journal carry them; the results' files and the viewer's page list them; the tables of README.md and
PROTOCOL.md are tested against these rows. What takes several frames to tell, such as a speed, is no row here,
but a column that `PoseTable.of` (tables.py) adds.

Numbers are not negative: the pose message refuses one that is, and without a message it counts as unknown.
Give two magnitudes instead of a signed number. poses.csv leaves out a column that any of its frames lacks.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from services.mocap.take.marks import CONFIDENCE_DIGITS, DISTRUSTED, LIMB_NAMES, PARTS, Marks
from services.mocap.types import Floats

File: TypeAlias = Literal["poses.csv", "energies.csv", "timings.csv"]
Labelled: TypeAlias = dict[str, NDArray[Any]]
"""Numbers (N,) of a quantity by part, camera or stage; by "" where it is of the whole frame."""
STAGES = ("torso", "limbs", "head", *LIMB_NAMES, "frame")
"""The stages with times; limbs are solved in parallel, frame is the time from one frame to the next."""


@dataclass(frozen=True)
class Quantity:
    """A row: what it is called, what it is counted in, and where it goes."""

    name: str
    """A field of the pose message, or else an entry of its `measured`."""
    unit: str
    file: File
    column: str
    """In that file; `{}` stands for the part, camera or stage."""
    per: Literal["frame", "part", "camera", "stage"] = "frame"
    """What one number is of."""
    digits: str = ".10g"
    most: float = np.inf
    """Numbers are from 0 to this."""
    is_live: bool = False
    """Whether only frames of live input have it."""
    in_parquet: bool = False
    """Whether poses.parquet has it."""
    chart: str = ""
    """The title of its chart on the viewer's page; empty: it has none."""
    meaning: str = ""
    """What an entry of `measured` is, for PROTOCOL.md; fields of the message say that themselves."""

    @property
    def labels(self) -> tuple[str, ...]:
        """What its numbers are of, in their order; empty for cameras, which every take has its own of."""
        return {"frame": ("",), "part": PARTS, "camera": (), "stage": STAGES}[self.per]


QUANTITIES = (
    Quantity(
        "energy_px", "px", "poses.csv", "energy_px", in_parquet=True, chart="Energy (differing pixels)"
    ),
    Quantity(
        "part_px", "px", "energies.csv", "energy_{}_px", "part", chart="Energy by the nearest part",
        meaning="The energy by the part that each differing pixel is nearest to.",
    ),
    Quantity(
        "iou", "1", "energies.csv", "iou_{}", "camera", ".4f", most=1.0,
        meaning="Intersection over union of the body and the silhouette; 1 if both are empty.",
    ),
    Quantity(DISTRUSTED, "1", "poses.csv", DISTRUSTED, "part", most=1.0, in_parquet=True),
    Quantity(
        "confidence", "1", "poses.csv", "confidence_{}", "part", CONFIDENCE_DIGITS, most=1.0,
        in_parquet=True, chart="Confidence",
    ),
    Quantity("seconds", "s", "timings.csv", "{}_s", "stage", ".6f", chart="Milliseconds"),
    Quantity(
        "prior", "1", "poses.csv", "prior",
        meaning="Cost of the pose's distance from the predicted pose and from the rest pose (the settings "
        "steadiness and rest), beside the energy.",
    ),
    Quantity("shot", "1", "poses.csv", "shot", is_live=True),
    Quantity("latency_s", "s", "poses.csv", "latency_s", is_live=True),
    Quantity(
        "cameras_absent", "1", "poses.csv", "cameras_absent", is_live=True,
        meaning="Live: how many cameras had no picture of this shot.",
    ),
)  # fmt: skip
"""In the order of the columns of poses.csv and energies.csv, and of the charts on the page."""
_IN_MARKS = (DISTRUSTED, "confidence")
FURTHER = tuple(
    row for row in QUANTITIES if row.file == "poses.csv" and row.name not in ("energy_px", *_IN_MARKS)
)
"""What poses.csv has beside the poses, the energy and the marks."""


class Solved(Protocol):
    """A solved frame, as the solver or a message has it."""

    @property
    def pose(self) -> Floats:
        """(D,)"""
        ...

    @property
    def energy_px(self) -> float:
        """Differing pixels, over all cameras."""
        ...

    @property
    def measured(self) -> Mapping[str, Sequence[float]]:
        """Numbers by a quantity's name, in the order of its labels or of the cameras."""
        ...


def numbers_of(frame: Solved, row: Quantity, labels: Sequence[str]) -> list[float]:
    """A quantity's number for each label; NaN where it is not known or out of its range."""
    known = frame.measured.get(row.name, getattr(frame, row.name, ()))
    if isinstance(known, Mapping):
        numbers = [known.get(label, np.nan) for label in labels]
    elif row.name == DISTRUSTED:
        numbers = [float(label in known) for label in labels]
    else:
        numbers = list(known) if isinstance(known, Sequence) else [known]
        numbers = numbers if len(numbers) == len(labels) else [np.nan] * len(labels)
    return [number if 0.0 <= number <= row.most else np.nan for number in numbers]


def gathered(frames: Sequence[Solved], row: Quantity, labels: Sequence[str]) -> dict[str, Floats]:
    """A quantity (N,) of N frames by label."""
    numbers = np.array([numbers_of(frame, row, labels) for frame in frames], np.float64)
    return dict(zip(labels, numbers.reshape(len(frames), len(labels)).T, strict=True))


def marks_of(frames: Sequence[Solved]) -> Marks:
    """The marks of some frames; parts that were not judged have no confidence and are not distrusted."""
    numbers = {
        row.name: np.column_stack(list(gathered(frames, row, PARTS).values()))
        for row in QUANTITIES
        if row.name in _IN_MARKS
    }
    return Marks(numbers["confidence"], numbers[DISTRUSTED] > 0)


def further_columns(frames: Sequence[Solved], *, is_live: bool) -> dict[str, Floats]:
    """The columns (N,) of poses.csv after energy and marks; those are left out that some frame lacks."""
    return {
        row.column.format(label): numbers
        for row in FURTHER
        if is_live or not row.is_live
        for label, numbers in gathered(frames, row, row.labels).items()
        if np.isfinite(numbers).all()
    }
