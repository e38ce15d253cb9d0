"""Clocks of two machines are compared by round trips, the quickest of which tells best."""

import numpy as np
import pytest

from proto.messages import LivePace
from services.segmentation.live.shots import CoordinatorClock

_RUN = "a" * 32


def _pace(asked_s: float, answered_s: float, clock: str = "there", **changes: object) -> LivePace:
    fields: dict[str, object] = {
        "take": "stage", "run": _RUN, "asked_s": asked_s, "answered_s": answered_s, "clock": clock,
        "shot": 10, "shot_s": 500.0, "period_s": 0.1,
    }  # fmt: skip
    return LivePace.model_validate(fields | changes)


def test_delays_of_a_busy_coordinator_hardly_disturb_it() -> None:
    rng = np.random.default_rng(3)
    clock, ahead_s = CoordinatorClock("here"), -7200.25
    for k in range(40):
        asked_s = 1000 + 0.5 * k
        there, back = rng.exponential(0.08) + 0.0004, rng.exponential(0.0005) + 0.0004
        clock.hear(_pace(asked_s, asked_s + there + ahead_s), asked_s + there + back)
    assert clock.there_s(2000.0) == pytest.approx(2000.0 + ahead_s, abs=0.006)
    assert clock.here_s(clock.there_s(2000.0)) == pytest.approx(2000.0)


def test_the_same_clock_needs_no_comparison() -> None:
    clock = CoordinatorClock("here")
    assert not clock.is_known
    clock.hear(_pace(10.0, 10.4, clock="here"), 11.0)
    assert clock.is_known
    assert clock.there_s(11.0) == 11.0


def test_a_coordinator_on_a_machine_that_was_started_anew_has_another_clock() -> None:
    clock = CoordinatorClock("here")
    clock.hear(_pace(10.0, 5010.0), 10.01)
    clock.hear(_pace(20.0, 3.0, clock="anew"), 20.5)
    assert clock.there_s(20.25) == pytest.approx(3.0)


def test_shots_are_even() -> None:
    clock = CoordinatorClock("here")
    assert clock.run == ""
    clock.hear(_pace(10.0, 10.0, clock="here"), 10.0)
    assert clock.run == _RUN
    assert clock.due_s(7) == pytest.approx(499.7)
    assert clock.shot_at(500.05) == pytest.approx(10.5)
