"""Shots are counted evenly, in step with what cameras do."""

import numpy as np
import pytest

from proto.messages import LiveSilhouettes
from services.coordinator.live_shots import Pace, UnsolvedShots

_PERIOD_S = 1 / 15


def test_shot_zero_is_soon_and_in_step_with_the_cameras() -> None:
    rng = np.random.default_rng(1)
    for phase_s in np.linspace(0, _PERIOD_S, 9):
        pace = Pace(_PERIOD_S)
        latest_s = 1000 + phase_s - _PERIOD_S * rng.integers(0, 3, 8) + rng.normal(0, 0.001, 8)
        pace.begin(latest_s.tolist(), 1000.01)
        shot, due_s = pace.anchor
        assert shot == 0
        assert 0.9 < due_s - 1000.01 < 1.2
        off = (due_s - 1000 - phase_s) / _PERIOD_S
        assert abs(off - round(off)) < 0.03


def test_it_follows_cameras_that_are_a_thousandth_slow() -> None:
    pace = Pace(_PERIOD_S)
    pace.begin([10.0], 10.0)
    first_s, real_s = pace.due_s(0), 1.001 * _PERIOD_S
    for shot in range(1, 20_000):
        taken_s = first_s + shot * real_s
        assert abs(pace.due_s(shot) - taken_s) < 0.02 * _PERIOD_S
        pace.hear(shot, [taken_s - 0.001, taken_s, taken_s + 0.001])
    assert pace.since_first_s(taken_s) == pytest.approx(19_999 * real_s, abs=0.01)


def test_one_camera_that_is_off_does_not_lead_it() -> None:
    pace = Pace(_PERIOD_S)
    pace.begin([], 5.0)
    due_s = pace.due_s(1)
    pace.hear(1, [due_s, due_s + 0.03, due_s])
    assert pace.due_s(1) == due_s


def test_another_one_goes_on_with_it() -> None:
    pace, other = Pace(_PERIOD_S), Pace(_PERIOD_S)
    pace.begin([], 123_456.789)
    pace.hear(77, [pace.due_s(77) + 0.01])
    other.recall(pace.as_lists(), 123_470.0)
    assert other.has_begun
    assert other.due_s(500) == pytest.approx(pace.due_s(500), abs=1e-5)
    assert other.since_first_s(0.0) == pytest.approx(pace.since_first_s(0.0), abs=1e-5)


def test_after_the_machine_was_started_again_the_next_shot_is_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its clock has begun anew; the take's time goes on."""
    pace, other = Pace(_PERIOD_S), Pace(_PERIOD_S)
    pace.begin([], 123_456.789)
    pace.hear(77, [pace.due_s(77)])
    monkeypatch.setattr("services.coordinator.live_shots.clock_name", lambda: "another boot")
    other.recall(pace.as_lists() | {"clock": [1]}, 20.0)
    assert 20.0 < other.due_s(77) < 22.0
    assert other.since_first_s(other.due_s(78)) == pytest.approx(pace.since_first_s(pace.due_s(78)), abs=1e-5)


def test_unsolved_shots_of_several_messages_each_take_no_more_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each message has 2 * 48 * 64 bytes, two of them are a shot, and there is room for five messages."""
    monkeypatch.setattr("services.coordinator.live_shots._KEPT_BYTES", 5 * 2 * 48 * 64)
    shots, planes = UnsolvedShots(4), np.zeros((1, 48, 64), np.uint8)
    for shot in range(4):
        for cameras in ([0, 1], [2, 3]):
            message = LiveSilhouettes(
                take="stage", run="a" * 32, shot=shot, cameras=cameras, times_s=[0.0, 0.0], planes=planes,
                unsure=planes,
            )  # fmt: skip
            shots.add(message, 0.0)
    assert shots.whole({0, 1, 2, 3}, 4, 0.0) == [2, 3]
    assert shots.passed.tolist() == [2, 2, 2, 2]
