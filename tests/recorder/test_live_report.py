"""How late live poses came, with and without those that had to catch up."""

import numpy as np
import pytest

from services.recorder.run_report import since_abreast

_FPS = 10.0


def test_poses_that_catch_up_are_told_apart() -> None:
    """The first pose comes after two seconds, each further one in half the time between two shots."""
    times_s = np.arange(100) / _FPS
    latencies_s = np.maximum(2.0 - 0.05 * np.arange(100), 0.06)
    told = since_abreast(times_s, latencies_s, _FPS)
    assert told is not None
    assert told["poses_before"] == 26  # until 0.7 s, four shots and 0.3 s
    assert told["after_s"] == pytest.approx(2.6 + 0.7)
    assert told["latency_s"]["median"] == pytest.approx(0.06)
    assert told["latency_s"]["p95"] == pytest.approx(0.5175)


def test_poses_that_are_abreast_at_once_or_never() -> None:
    times_s = 3.0 + np.arange(5) / _FPS
    told = since_abreast(times_s, np.full(5, 0.1), _FPS)
    assert told is not None
    assert (told["poses_before"], told["after_s"]) == (0, pytest.approx(0.1))
    assert since_abreast(times_s, np.full(5, 4.0), _FPS) is None
