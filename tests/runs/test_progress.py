"""How far a run is: frames that are found again count once, and the rate is that of the last seconds."""

from collections.abc import Iterator
from contextlib import closing

import pytest

from proto.messages import Pose, Telemetry
from services.runs.launcher import free_endpoint
from services.runs.progress import Progress, ProgressWatch, live_in_words


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Its one number is the time."""
    now = [100.0]
    monkeypatch.setattr("services.runs.progress.time.monotonic", lambda: now[0])
    return now


@pytest.fixture
def watch() -> Iterator[ProgressWatch]:
    """Over frames from 5 on."""
    with closing(ProgressWatch(free_endpoint(), None, 5)) as made:
        yield made


def test_frames_that_are_found_again_count_once(watch: ProgressWatch, clock: list[float]) -> None:
    assert watch.progress(False).stage == "finding the first pose"
    for frame in (5, 6, 7, 6, 7, 8):
        watch.take_in(Pose.model_construct(frame=frame, energy_px=10.0 * frame))
        clock[0] += 0.1
    now = watch.progress(False)
    assert (now.frames_done, now.energy_px, now.stage) == (4, 80.0, "tracking")
    assert watch.progress(True).stage == "writing results"


def test_the_rate_is_that_of_the_last_seconds(watch: ProgressWatch, clock: list[float]) -> None:
    for frame in range(5, 105):
        clock[0] += 0.1 if frame < 50 else 0.2
        watch.take_in(Pose.model_construct(frame=frame, energy_px=0.0))
    assert watch.progress(False).frames_per_s == pytest.approx(5.0, rel=0.01)
    clock[0] += 10.0
    assert watch.progress(False).frames_per_s == 0.0


def test_live_tracking_says_its_rate_as_every_other_place_does() -> None:
    told = Telemetry.model_construct(drops={}, absent=[], stage="tracking", latency_s={})
    words = live_in_words(Progress(40, True, 12.345, 900.0, "tracking", told))
    assert words.startswith("tracking  40 poses, 12.3 frames per second  dropped")
