"""Which frames of a result a body is fitted to again."""

import numpy as np
import pytest

from services.mocap.take.marks import PARTS
from services.mocap.types import Mask
from services.runs.refine import least_doubtful_rows

_TORSO, _ARM, _LEG = (PARTS.index(part) for part in ("torso", "left_arm", "right_leg"))


def _marks(n_frames: int, *marked: tuple[slice, int]) -> Mask:
    distrusted = np.zeros((n_frames, len(PARTS)), bool)
    for rows, part in marked:
        distrusted[rows, part] = True
    return distrusted


@pytest.mark.parametrize(
    ("distrusted", "rows"),
    [
        (_marks(8, (slice(0, 4), _ARM)), [4, 5, 6, 7]),
        (_marks(8, (slice(0, 6), _ARM)), [6, 7]),
        (_marks(8, (slice(0, 7), _ARM), (slice(2, 4), _LEG)), [0, 4, 6, 7]),
        (_marks(8, (slice(0, 8), _ARM), (slice(0, 8), _LEG)), [0, 2, 5, 7]),
        (_marks(8, (slice(0, 6), _TORSO), (slice(6, 8), _ARM)), [6, 7]),
        (_marks(8, (slice(0, 8), _TORSO)), []),
    ],
    ids=["unmarked", "half", "filled-up", "all-marked", "lost-but-two", "lost"],
)
def test_frames_with_the_fewest_marks_are_taken_and_none_in_which_the_body_is_lost(
    distrusted: Mask, rows: list[int]
) -> None:
    assert least_doubtful_rows(distrusted, 4).tolist() == rows
