"""Pictures of several cameras become shots by when they were taken."""

import time

import numpy as np
import pytest

from proto.messages import LivePace
from services.segmentation.live.shots import CoordinatorClock, ShotCounter, Shots

_PERIOD_S = 0.1
_IMAGE = np.zeros((2, 3, 3), np.uint8)


def _clock(shot_s: float, run: str = "a" * 32) -> CoordinatorClock:
    clock = CoordinatorClock("here")
    clock.hear(
        LivePace(
            take="stage", run=run, asked_s=0.0, answered_s=0.0, clock="here", shot=0, shot_s=shot_s,
            period_s=_PERIOD_S,
        ),
        0.0,
    )  # fmt: skip
    return clock


@pytest.fixture
def now_s() -> float:
    return time.monotonic()


@pytest.fixture
def shots(now_s: float) -> Shots:
    return Shots(2, _clock(now_s), 0.6 * _PERIOD_S, _PERIOD_S, grace_s=0.05)


def test_a_camera_that_hovers_between_two_shots_does_not_jump() -> None:
    counter, rng = ShotCounter(_clock(0.0), 0.6 * _PERIOD_S, _PERIOD_S), np.random.default_rng(5)
    numbers = [counter.number((n + 0.5) * _PERIOD_S + rng.uniform(-0.008, 0.008)) for n in range(500)]
    assert numbers == list(range(numbers[0] or 0, (numbers[0] or 0) + 500))


def test_a_camera_with_another_rate_slips_now_and_then_but_never_far() -> None:
    counter = ShotCounter(_clock(0.0), 0.6 * _PERIOD_S, _PERIOD_S)
    for n in range(2000):
        taken_s = n * 1.001 * _PERIOD_S
        shot = counter.number(taken_s)
        assert shot is not None
        assert abs(taken_s - shot * _PERIOD_S) <= 0.6 * _PERIOD_S


def test_a_picture_beyond_the_tolerance_is_of_no_shot() -> None:
    counter = ShotCounter(_clock(0.0), 0.01, _PERIOD_S)
    assert counter.number(0.305) == 3
    assert counter.number(0.45) is None
    assert counter.number(0.495) == 5


def test_shots_are_given_out_whole_and_in_order(shots: Shots, now_s: float) -> None:
    for shot in (0, 1):
        for camera in (1, 0):
            assert shots.put(camera, _IMAGE, now_s + shot * _PERIOD_S + 0.01 * camera) == shot
    for number in (0, 1):
        shot_taken = shots.take(1.0)
        assert shot_taken is not None
        assert shot_taken.number == number
        assert sorted(shot_taken.taken) == [0, 1]
        assert shot_taken.taken[1].time_s == pytest.approx(now_s + number * _PERIOD_S + 0.01)
    assert shots.take(0.01) is None
    assert (shots.missed, shots.dropped) == ([0, 0], [0, 0])


def test_where_too_many_wait_the_newest_goes_first(shots: Shots, now_s: float) -> None:
    for shot in range(4):
        for camera in (0, 1):
            shots.put(camera, _IMAGE, now_s + shot * _PERIOD_S)
    taken = shots.take(1.0)
    assert taken is not None
    assert taken.number == 3
    assert shots.dropped == [3, 3]


def test_what_a_source_leaves_out_is_counted(shots: Shots, now_s: float) -> None:
    for shot in (0, 1, 5):
        shots.put(0, _IMAGE, now_s + shot * _PERIOD_S)
    shots.put(0, _IMAGE, now_s + 5.1 * _PERIOD_S)  # no shot of its own is near enough
    assert (shots.missed, shots.dropped) == ([3, 0], [1, 0])


def test_a_camera_that_is_late_is_waited_for_a_moment(shots: Shots, now_s: float) -> None:
    for camera in (0, 1):
        shots.put(camera, _IMAGE, now_s)
    assert shots.take(1.0) is not None
    shots.put(0, _IMAGE, now_s + _PERIOD_S)
    alone = shots.take(2.0)
    assert alone is not None
    assert sorted(alone.taken) == [0]
    assert shots.put(1, _IMAGE, now_s + _PERIOD_S) == 1  # for a recording
    assert shots.dropped == [0, 1]


def test_before_a_run_there_are_no_shots(now_s: float) -> None:
    shots = Shots(1, _clock(now_s, run=""), 0.06, _PERIOD_S, 0.05)
    assert shots.put(0, _IMAGE, now_s) is None
    assert shots.latest_s == [now_s]
    assert shots.dropped == [0]


def test_pictures_that_were_not_read_in_time_are_dropped_not_missed(shots: Shots, now_s: float) -> None:
    shots.put(0, _IMAGE, now_s)
    shots.pass_over(0, 4)
    shots.put(0, _IMAGE, now_s + 7 * _PERIOD_S)
    assert (shots.dropped[0], shots.missed[0]) == (4, 2)
    shots.put(0, _IMAGE, now_s + 10 * _PERIOD_S)
    assert (shots.dropped[0], shots.missed[0]) == (4, 4)
