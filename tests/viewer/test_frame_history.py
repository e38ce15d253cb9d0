"""The history: what it keeps, gaps, and the whole take at a glance."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from services.mocap.take.marks import PARTS
from services.viewer.frame_history import MOST_FRAMES, FrameHistory
from services.viewer.page_words import why_missing
from services.viewer.solved_frame import ON_PAGE, SolvedFrame

Make = Callable[..., SolvedFrame]
_QUANTITY_OF_NUMBER = [row.name for row in ON_PAGE for _ in row.labels]
"""(K,) what each of SolvedFrame.numbers is."""


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


def test_an_open_take_forgets_its_oldest_frames_and_no_others(
    solved: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.viewer.frame_history.MOST_FRAMES", 1000)
    history, closed = FrameHistory(range(10, 1_000_000), is_open=True), FrameHistory(range(10, 3010))
    for frame in range(10, 3010):
        for each in (history, closed):
            each.put(solved(frame, distrusted=("head",) if frame == 2400 else ()))
        assert len(history.extent) <= 1000
    first = history.frames.start
    assert 2010 <= first <= 2110
    assert all(history.solved(frame) is not None for frame in range(first, 3010))
    assert history.solved(first - 1) is None
    assert history.extent.start == first and history.newest == 3009
    assert history.doubtful_beside(0, 1) == history.doubtful_beside(5000, -1) == 2400
    assert history.overview().known.sum() == np.ceil(0.6 * (3010 - first))
    history.put(solved(first - 1))
    assert history.solved(first - 1) is None, "it is outside the range"
    assert all(closed.solved(frame) is not None for frame in range(10, 3010))


def test_a_number_far_ahead_takes_no_more_memory(solved: Make) -> None:
    history = FrameHistory(range(2**31), is_open=True)
    for frame in (0, 5, 2**31 - 2):
        history.put(solved(frame))
    assert history.solved(2**31 - 2) is not None and history.solved(5) is None
    assert history.newest == 2**31 - 2 and len(history.extent) <= MOST_FRAMES


def test_why_a_frame_is_missing_is_said(solved: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.viewer.frame_history.MOST_FRAMES", 600)
    history = FrameHistory(range(100_000), is_open=True)
    assert why_missing(0, history) == "Frame 0 is not known yet."
    history.put(solved(50))
    assert why_missing(3, history).startswith("Frame 3 has not come: the coordinator keeps few frames")
    assert why_missing(60, history) == "Frame 60 is not known yet."
    history.put(solved(5000))
    assert why_missing(3, history).startswith("Frame 3 is no longer in memory")


def test_gaps_are_found_the_latest_first(solved: Make) -> None:
    history = FrameHistory(range(100))
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
    assert history.last_gap() == range(10, 99)
    late = FrameHistory(range(20, 100))
    late.put(solved(25))
    assert late.last_gap() == range(20, 25)


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
    history = FrameHistory(range(6000))
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
    history, same = FrameHistory(range(100_000), is_open=True), FrameHistory(range(2400))
    assert history.extent == range(600)
    for frame in range(1500):
        for each in (history, same):
            each.put(solved(frame, distrusted=("head",) if frame == 1234 else ()))
    assert history.extent == same.extent == range(2400)
    for found, expected in zip(
        vars(history.overview()).values(), vars(same.overview()).values(), strict=True
    ):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("n_frames", [1, 599, 600, 601, 1000, 2401])
def test_every_frame_is_in_its_bin(solved: Make, n_frames: int) -> None:
    history = FrameHistory(range(7, 7 + n_frames))
    energy_px = np.zeros(min(600, n_frames))
    for frame in range(7, 7 + n_frames, 5):
        history.put(solved(frame))
        at = (frame - 7) * len(energy_px) // n_frames
        energy_px[at] = max(energy_px[at], 100.0 + frame)
    np.testing.assert_array_equal(history.overview().energy_px, energy_px)
    np.testing.assert_array_equal(history.overview().known, energy_px > 0)
