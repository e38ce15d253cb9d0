"""The history: a ring that does not grow, gaps, what has left it, and the whole take at a glance."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from services.mocap.take.marks import PARTS
from services.viewer.frame_history import FrameHistory
from services.viewer.solved_frame import ON_PAGE, SolvedFrame

Make = Callable[..., SolvedFrame]
_QUANTITY_OF_NUMBER = [row.name for row in ON_PAGE for _ in row.labels]
"""(K,) what each of SolvedFrame.numbers is."""


class Shelf:
    """Where older frames are that are known from the start."""

    def __init__(self, *solved_frames: SolvedFrame) -> None:
        self._frames = {solved.frame: solved for solved in solved_frames}
        self.asked: list[int] = []

    def solved(self, frame: int) -> SolvedFrame | None:
        return self._frames.get(frame)

    def ask(self, frame: int) -> None:
        self.asked.append(frame)

    def why_missing(self, frame: int) -> str:
        return f"was eaten ({frame})"


def test_a_frame_comes_back_as_it_was_put(solved: Make) -> None:
    history = FrameHistory(range(10, 20))
    history.put(solved(12, distrusted=("left_arm",)))
    found = history.solved(12)
    assert found is not None
    for name, value in vars(solved(12, distrusted=("left_arm",))).items():
        np.testing.assert_array_equal(getattr(found, name), value)
    assert history.newest == 12
    assert history.solved(11) is None and history.solved(13) is None


def test_frames_of_another_range_are_left_out(solved: Make) -> None:
    history = FrameHistory(range(10, 20))
    history.put(solved(9))
    history.put(solved(20))
    assert history.newest is None


def test_the_ring_holds_the_latest_and_no_more(solved: Make) -> None:
    shelf = Shelf()
    history = FrameHistory(range(1000), capacity=100, older=shelf)
    for frame in range(1000):
        history.put(solved(frame))
    assert all(history.solved(frame) is not None for frame in range(900, 1000))
    assert history.solved(899) is None
    assert shelf.asked == [899]


def test_what_has_left_the_ring_is_fetched_and_forgotten_again(solved: Make) -> None:
    history = FrameHistory(range(5000), capacity=100)
    for frame in range(5000):
        history.put(solved(frame))
    for frame in range(1000):
        history.put(solved(frame))  # as the coordinator sends them on request
    assert history.newest == 4999
    kept = [frame for frame in range(1000) if history.solved(frame) is not None]
    assert kept == list(range(1000 - len(kept), 1000))
    assert len(kept) == 512


def test_older_frames_may_be_at_hand(solved: Make) -> None:
    shelf = Shelf(solved(3), solved(4, distrusted=("head",)), solved(60))
    history = FrameHistory(range(1000), capacity=10, older=shelf)
    for frame in range(20, 50):
        history.put(solved(frame))
    assert not history.overview().known[1] and not history.overview().doubtful.any()
    assert history.sampled(1000).frames.tolist() == list(range(40, 50))
    assert shelf.asked == [], "curves do not ask for what is not in memory"
    found = history.solved(3)
    assert found is not None and found.energy_px == 103
    assert history.overview().known[1] and history.doubtful_beside(0, 1) is None
    assert history.solved(4) is not None
    assert history.overview().doubtful[2].tolist() == [False, True, False, False, False, False]
    assert history.doubtful_beside(0, 1) == 4


def test_why_a_frame_is_missing_is_said(solved: Make) -> None:
    shelf = Shelf(solved(60))
    history = FrameHistory(range(1000), capacity=10, older=shelf)
    assert history.why_missing(0) == "is not known yet"
    history.put(solved(50))
    assert history.why_missing(3) == "was eaten (3)"
    assert history.why_missing(60) == "is not known yet"
    assert history.solved(60) is None and history.solved(1000) is None and shelf.asked == []


def test_gaps_are_found_the_latest_first(solved: Make) -> None:
    history = FrameHistory(range(100), capacity=50)
    assert history.last_gap() is None
    for frame in (0, 1, 5, 6, 9):
        history.put(solved(frame))
    assert history.last_gap() == range(7, 9)
    for frame in (7, 8):
        history.put(solved(frame))
    assert history.last_gap() == range(2, 5)
    assert history.last_gap(4) == range(4, 5)
    assert history.last_gap(5) is None
    for frame in (2, 3, 4):
        history.put(solved(frame))
    assert history.last_gap() is None
    history.put(solved(99))
    assert history.last_gap() == range(50, 99)  # no more than the ring could hold


def test_curves_have_known_frames_only_and_no_more_than_they_want(solved: Make) -> None:
    history = FrameHistory(range(10, 100))
    for frame in (10, 11, 14, 16):
        history.put(solved(frame))
    known = history.sampled(90)
    assert known.frames.tolist() == [10, 11, 14, 16]
    assert known.of("energy_px")[:, 0].tolist() == [110, 111, 114, 116]
    np.testing.assert_allclose(known.poses[:, 0], [0.010, 0.011, 0.014, 0.016])
    assert history.sampled(30).frames.tolist() == [10, 16], "every third"
    empty = FrameHistory(range(10)).sampled(5)
    assert empty.frames.size == 0 and empty.of("energy_px").shape == (0, 1)


def test_the_overview_tells_of_the_whole_take_in_bins(solved: Make) -> None:
    history = FrameHistory(range(6000), capacity=10)
    for frame in range(3000):
        history.put(solved(frame, distrusted=("head",) if frame == 1234 else ()))
    overview = history.overview()
    assert len(overview.known) == 600
    assert overview.known.sum() == 300
    assert np.argwhere(overview.doubtful).tolist() == [[123, 1]]
    assert overview.energy_px[123] == 100 + 1239


def test_a_doubtful_torso_makes_all_rows_doubtful_and_what_nobody_judged_is_neither(solved: Make) -> None:
    history = FrameHistory(range(4))
    for frame, distrusted in enumerate([(), ("torso",), (), ("head",)]):
        numbers = solved(frame, distrusted=distrusted).numbers.copy()
        numbers[[name == "confidence" and frame > 1 for name in _QUANTITY_OF_NUMBER]] = np.nan
        history.put(replace(solved(frame), numbers=numbers))
    overview = history.overview()
    head_only = [part == "head" for part in PARTS]
    assert overview.doubtful.tolist() == [[False] * 6, [True] * 6, [False] * 6, head_only]
    assert overview.unjudged.tolist() == [[False] * 6] * 2 + [
        [True] * 6,
        [not is_head for is_head in head_only],
    ]
    for frame in (2, 3):
        history.put(replace(solved(frame), settled=True))
    assert not history.overview().unjudged.any()


def test_settled_frames_replace_what_the_overview_tells_of_the_first_ones(solved: Make) -> None:
    history = FrameHistory(range(1200))
    for frame in range(8):
        history.put(solved(frame, distrusted=("left_arm",)))
    for frame in range(6):
        history.put(replace(solved(frame, distrusted=("right_leg",) if frame == 2 else ()), settled=True))
    overview = history.overview()
    assert np.argwhere(overview.doubtful).tolist() == [[1, PARTS.index("right_leg")], [3, 2]]
    assert [history.doubtful_beside(frame, 1) for frame in (0, 2, 6)] == [2, 6, 7]


def test_a_first_pose_that_comes_late_does_not_replace_the_settled_one(solved: Make) -> None:
    history, settled = FrameHistory(range(10)), replace(solved(3), settled=True)
    history.put(settled)
    history.put(solved(3, distrusted=("left_arm",)))
    assert history.solved(3) is settled
    assert history.doubtful_beside(0, 1) is None


def test_the_timeline_of_an_open_take_grows_with_it(solved: Make) -> None:
    history, same = (
        FrameHistory(range(100_000), capacity=10, is_open=True),
        FrameHistory(range(2400), capacity=10),
    )
    assert history.extent == range(600)
    for frame in range(1500):
        for each in (history, same):
            each.put(solved(frame, distrusted=("head",) if frame == 1234 else ()))
    assert history.extent == same.extent == range(2400)
    for found, expected in zip(
        vars(history.overview()).values(), vars(same.overview()).values(), strict=True
    ):
        np.testing.assert_array_equal(found, expected)
