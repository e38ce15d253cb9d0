"""The reel: a ring that does not grow, gaps, what has left it, and the whole take at a glance."""

from collections.abc import Callable

import numpy as np

from services.viewer.reel import Reel, Shot

Make = Callable[..., Shot]


class Shelf:
    """Where older frames are that are known from the start."""

    def __init__(self, *shots: Shot) -> None:
        self._shots = {shot.frame: shot for shot in shots}
        self.asked: list[int] = []

    def shot(self, frame: int) -> Shot | None:
        return self._shots.get(frame)

    def ask(self, frame: int) -> None:
        self.asked.append(frame)

    def why_missing(self, frame: int) -> str:
        return f"was eaten ({frame})"


def test_a_frame_comes_back_as_it_was_put(shot: Make) -> None:
    reel = Reel(range(10, 20))
    reel.put(shot(12, distrusted=("left_arm",)))
    found = reel.shot(12)
    assert found is not None
    for name, value in vars(shot(12, distrusted=("left_arm",))).items():
        np.testing.assert_array_equal(getattr(found, name), value)
    assert reel.newest == 12
    assert reel.shot(11) is None and reel.shot(13) is None


def test_frames_of_another_range_are_left_out(shot: Make) -> None:
    reel = Reel(range(10, 20))
    reel.put(shot(9))
    reel.put(shot(20))
    assert reel.newest is None


def test_the_ring_holds_the_latest_and_no_more(shot: Make) -> None:
    shelf = Shelf()
    reel = Reel(range(1000), capacity=100, older=shelf)
    for frame in range(1000):
        reel.put(shot(frame))
    assert all(reel.shot(frame) is not None for frame in range(900, 1000))
    assert reel.shot(899) is None
    assert shelf.asked == [899]


def test_what_has_left_the_ring_is_fetched_and_forgotten_again(shot: Make) -> None:
    reel = Reel(range(5000), capacity=100)
    for frame in range(5000):
        reel.put(shot(frame))
    for frame in range(1000):
        reel.put(shot(frame))  # as the coordinator sends them on request
    assert reel.newest == 4999
    kept = [frame for frame in range(1000) if reel.shot(frame) is not None]
    assert kept == list(range(1000 - len(kept), 1000))
    assert len(kept) == 512


def test_older_frames_may_be_at_hand(shot: Make) -> None:
    shelf = Shelf(shot(3), shot(4, distrusted=("head",)), shot(60))
    reel = Reel(range(1000), capacity=10, older=shelf)
    for frame in range(20, 50):
        reel.put(shot(frame))
    assert not reel.overview().known[1] and not reel.overview().distrusted.any()
    assert reel.stretch(2, 8).frames.tolist() == [3, 4]
    assert shelf.asked == [], "curves do not ask for what is not at hand"
    found = reel.shot(3)
    assert found is not None and found.energy_px == 103
    assert reel.overview().known[1] and reel.overview().distrusted[2]
    assert reel.stretch(38, 42).frames.tolist() == [40, 41]


def test_why_a_frame_is_missing_is_said(shot: Make) -> None:
    shelf = Shelf(shot(60))
    reel = Reel(range(1000), capacity=10, older=shelf)
    assert reel.why_missing(0) == "is not known yet"
    reel.put(shot(50))
    assert reel.why_missing(3) == "was eaten (3)"
    assert reel.why_missing(60) == "is not known yet"
    assert reel.shot(60) is None and reel.shot(1000) is None and shelf.asked == []


def test_gaps_are_found_the_latest_first(shot: Make) -> None:
    reel = Reel(range(100), capacity=50)
    assert reel.last_gap() is None
    for frame in (0, 1, 5, 6, 9):
        reel.put(shot(frame))
    assert reel.last_gap() == range(7, 9)
    for frame in (7, 8):
        reel.put(shot(frame))
    assert reel.last_gap() == range(2, 5)
    assert reel.last_gap(4) == range(4, 5)
    assert reel.last_gap(5) is None
    for frame in (2, 3, 4):
        reel.put(shot(frame))
    assert reel.last_gap() is None
    reel.put(shot(99))
    assert reel.last_gap() == range(50, 99)  # no more than the ring could hold


def test_a_stretch_has_known_frames_only(shot: Make) -> None:
    reel = Reel(range(10, 100))
    for frame in (10, 11, 14):
        reel.put(shot(frame))
    stretch = reel.stretch(-5, 50)
    assert stretch.frames.tolist() == [10, 11, 14]
    assert stretch.energy_px.tolist() == [110, 111, 114]
    assert reel.stretch(80, 20).frames.size == 0


def test_the_overview_tells_of_the_whole_take_in_bins(shot: Make) -> None:
    reel = Reel(range(6000), capacity=10)
    for frame in range(3000):
        reel.put(shot(frame, distrusted=("head",) if frame == 1234 else ()))
    overview = reel.overview()
    assert len(overview.known) == 600
    assert overview.known.sum() == 300
    assert np.flatnonzero(overview.distrusted).tolist() == [123]
    assert overview.energy_px[123] == 100 + 1239


def test_the_timeline_of_an_open_take_grows_with_it(shot: Make) -> None:
    reel, same = Reel(range(100_000), capacity=10, is_open=True), Reel(range(2400), capacity=10)
    assert reel.extent == range(600)
    for frame in range(1500):
        for each in (reel, same):
            each.put(shot(frame, distrusted=("head",) if frame == 1234 else ()))
    assert reel.extent == same.extent == range(2400)
    for found, expected in zip(vars(reel.overview()).values(), vars(same.overview()).values(), strict=True):
        np.testing.assert_array_equal(found, expected)
