"""The player: live, playing, standing."""

from collections.abc import Callable
from typing import Literal

import pytest

from services.viewer.controls import Player
from services.viewer.frame_history import FrameHistory
from services.viewer.solved_frame import SolvedFrame


@pytest.fixture
def history(solved: Callable[..., SolvedFrame]) -> FrameHistory:
    history = FrameHistory(range(5, 100))
    for frame in range(5, 30):
        history.put(solved(frame))
    return history


def test_live_shows_the_newest(history: FrameHistory, solved: Callable[..., SolvedFrame]) -> None:
    player = Player(history, 25, 5, is_live=True)
    assert player.advance(0.01) == 29
    history.put(solved(33))
    assert player.advance(0.01) == 33


def test_playing_goes_at_the_recordings_pace(history: FrameHistory) -> None:
    player = Player(history, 25, 5, is_live=False, is_playing=True)
    frames = [player.advance(0.03) for _ in range(20)]  # 0.6 s, 15 frames
    assert frames[-1] == 5 + 15 or frames[-1] == 5 + 14
    assert frames == sorted(frames)


@pytest.mark.parametrize(("speed", "frame"), [(0.25, 7), (0.5, 10), (2.0, 25), (4.0, 29)])
def test_speed(history: FrameHistory, speed: float, frame: int) -> None:
    player = Player(history, 25, 5, is_live=False, is_playing=True, speed=speed)
    assert player.advance(0.4 + 1e-9) == frame


def test_playing_waits_for_frames_to_come_and_begins_anew_when_all_is_over(history: FrameHistory) -> None:
    player = Player(history, 25, 28, is_live=False, is_playing=True)
    assert player.advance(1) == 29
    history.is_over = True
    assert player.advance(1) == 5


def test_whoever_scrubs_is_not_live_any_more(history: FrameHistory) -> None:
    player = Player(history, 25, 5, is_live=True)
    player.seek(12)
    assert player.advance(1) == 12
    player.step(-1)
    assert player.advance(1) == 11
    player.step(-100)
    assert player.advance(1) == 5
    player.step(100)
    assert player.advance(1) == 29
    player.seek(12)
    player.go_live()
    assert player.advance(0) == 29


def test_nothing_is_known_yet() -> None:
    player = Player(FrameHistory(range(10)), 25, 0, is_live=True)
    assert player.advance(1) == 0


def test_doubtful_frames_are_found_both_ways(solved: Callable[..., SolvedFrame]) -> None:
    history = FrameHistory(range(5, 100))
    for frame in range(5, 60):
        history.put(solved(frame, distrusted=("head",) if frame in (10, 11, 12, 30, 59) else ()))
    player = Player(history, 25, 5, is_live=True)

    def seen(way: Literal[-1, 1], by_stretch: bool, times: int) -> list[int]:
        found = []
        for _ in range(times):
            player.seek_doubtful(way, by_stretch)
            found.append(player.advance(1))
        return found

    player.seek(5)
    assert seen(1, False, 6) == [10, 11, 12, 30, 59, 59]
    assert seen(-1, False, 3) == [30, 12, 11]
    assert seen(1, True, 3) == [30, 59, 59]
    assert seen(-1, True, 3) == [30, 10, 10]
    assert not player.is_live and not player.is_playing
