"""Slow connections get less and get it less often."""

import pytest

from services.viewer.grid import Connection, SendPacing


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Its one number is the time."""
    now = [100.0]
    monkeypatch.setattr("services.viewer.grid.time.monotonic", lambda: now[0])
    return now


def test_pacing_rests_by_what_making_and_sending_took(clock: list[float]) -> None:
    grid = SendPacing(0.2, rest=8.0)
    assert grid.is_due()
    clock[0] = 100.01
    grid.done(100.0, made_s=100.005, cpu_s=0.005)
    for at, due in ((100.19, False), (100.2, True)):
        clock[0] = at
        assert grid.is_due() is due
    clock[0] = 101.0
    grid.done(100.2, made_s=100.4, cpu_s=0.15)  # 0.2 s to draw, part of it waiting; 0.6 s on its way
    for at, due in ((102.79, False), (102.81, True)):
        clock[0] = at
        assert grid.is_due() is due


def test_what_matters_less_leaves_the_line_to_others_for_longer(clock: list[float]) -> None:
    charts = SendPacing(0.1, line_rest=4.0)
    clock[0] = 100.5
    charts.done(100.0, made_s=100.0)
    for at, due in ((102.49, False), (102.51, True)):
        clock[0] = at
        assert charts.is_due() is due


def test_a_connection_is_known_by_its_large_answers() -> None:
    connection = Connection()
    assert connection.seconds_for(1000) is None
    connection.note(100, 0.4)
    assert connection.seconds_for(1000) is None
    connection.note(100_000, 1.2)  # of which 0.2 s are whatever is sent
    assert connection.seconds_for(50_000) == pytest.approx(0.5)
    for _ in range(20):
        connection.note(100_000, 0.3)
    assert connection.seconds_for(100_000) == pytest.approx(0.1, rel=0.01)
