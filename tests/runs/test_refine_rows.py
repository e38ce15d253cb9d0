"""Which frames of a result a body is fitted to again, and of which the poses are known then."""

import numpy as np
import pytest

from services.mocap.take.marks import PARTS
from services.mocap.types import Mask
from services.runs.refine import known_rows, least_doubtful_rows

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


def test_poses_are_known_where_nothing_is_marked_and_in_the_first_frame_unless_the_body_is_lost() -> None:
    marked = _marks(4, (slice(0, 2), _ARM), (slice(3, 4), _TORSO))
    assert known_rows(marked).tolist() == [True, False, True, False]
    assert known_rows(_marks(2, (slice(0, 1), _TORSO))).tolist() == [False, True]
