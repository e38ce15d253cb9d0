"""Marks: the unreliable parts of the body in a frame, and the confidence of each part."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from services.mocap.take.csv_columns import Columns, as_cells
from services.mocap.types import Floats, Mask

LimbName: TypeAlias = Literal["left_arm", "right_arm", "left_leg", "right_leg"]
Part: TypeAlias = Literal["torso", "head", LimbName]
"""Types cannot be derived from the table of the body: a test compares them with it."""
LIMB_NAMES: tuple[LimbName, ...] = get_args(LimbName)
LIMB_PAIRS: tuple[tuple[LimbName, LimbName], ...] = tuple(zip(LIMB_NAMES[::2], LIMB_NAMES[1::2], strict=True))
"""The left and the right one of each kind."""
PARTS: tuple[Part, ...] = get_args(Part)
"""The parts that are judged, in the order of every (…, 6) array."""
WHOLE_BODY: Part = "torso"
"""The part that stands for the whole body: where it is doubtful, all parts are."""
DISTRUSTED = "distrusted"
CONFIDENCE_DIGITS = ".3f"
_CONFIDENCE_COLUMNS = tuple(f"confidence_{part}" for part in PARTS)
MARK_COLUMNS = (DISTRUSTED, *_CONFIDENCE_COLUMNS)
"""The columns of poses.csv that hold marks."""
_SEPARATOR = ";"


@dataclass(frozen=True, eq=False)
class Marks:
    """Of N frames."""

    confidence: Floats
    """(N, 6) from 0 to 1; NaN where a part was not judged."""
    distrusted: Mask
    """(N, 6) unreliable parts."""

    @property
    def distrusted_frames(self) -> int:
        """The number of frames with an unreliable part."""
        return int(self.distrusted.any(axis=1).sum())

    @property
    def distrusted_by_part(self) -> dict[str, int]:
        """The number of frames in which each part is unreliable."""
        return dict(zip(PARTS, self.distrusted.sum(axis=0).tolist(), strict=True))


def doubtful_parts(distrusted: Mask) -> Mask:
    """The doubtful parts (…, 6): those that are marked, and all where the whole body is."""
    whole = PARTS.index(WHOLE_BODY)
    return distrusted | distrusted[..., whole : whole + 1]


def judged_parts(confidence: Floats, distrusted: Mask) -> Mask:
    """The parts (…, 6) that were judged; the others are neither good nor doubtful."""
    return ~np.isnan(confidence) | doubtful_parts(distrusted)


def mark_cells(marks: Marks) -> dict[str, list[str]]:
    """The columns (N,) of a table; a part that was not judged leaves its cell empty."""
    names = [_SEPARATOR.join(np.array(PARTS)[row]) for row in marks.distrusted]
    confidence = {
        column: as_cells(column, values, CONFIDENCE_DIGITS, blanks=True)
        for column, values in zip(_CONFIDENCE_COLUMNS, marks.confidence.T, strict=True)
    }
    return {DISTRUSTED: names, **confidence}


def read_marks(columns: Columns) -> Marks | None:
    """The marks of a table; None if it has no such columns. Raises TakeError."""
    if not any(name in columns.cells for name in MARK_COLUMNS):
        return None
    unknown = np.full(len(columns.lines), np.nan)
    confidence = [
        columns.numbers(name, blanks=True, most=1.0) if name in columns.cells else unknown
        for name in _CONFIDENCE_COLUMNS
    ]
    distrusted: Mask = np.zeros((len(columns.lines), len(PARTS)), bool)
    for row, cell in enumerate(columns.cells.get(DISTRUSTED, ())):
        for name in filter(None, cell.split(_SEPARATOR)):
            if name not in PARTS:
                expected = f"some of {', '.join(PARTS)}, joined by {_SEPARATOR}"
                raise columns.error(DISTRUSTED, columns.lines[row], expected, cell)
            distrusted[row, PARTS.index(name)] = True
    return Marks(np.column_stack(confidence), distrusted)
