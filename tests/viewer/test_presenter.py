"""The presenter: joins late, asks for what it missed, and makes a show of it."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from patience import until
from playback import Playback
from proto.messages import PoseRequest, SilhouettesRequest
from services.mocap.result.layout import journal_of
from services.mocap.take.folder import Take
from services.recorder.store import Store
from services.runs.launcher import free_endpoint
from services.viewer.presenter import TakePresenter
from services.viewer.show import Show
from services.viewer.tiles import Look


@pytest.fixture
def shows() -> list[Show]:
    return []


@pytest.fixture
def store(result: Path) -> Iterator[Store]:
    """The journal of a recorder whose results will be in the folder."""
    store = Store(journal_of(result).parent)
    yield store
    store.close(remove=True)


def _until(presenter: TakePresenter, condition: Callable[[], bool]) -> None:
    until(condition, turn=lambda: presenter.listen(0.05))


def _newest(shows: list[Show]) -> int:
    return -1 if not shows or shows[-1].history.newest is None else shows[-1].history.newest


def test_a_late_viewer_has_all_frames(walk: Take, shows: list[Show]) -> None:
    with Playback(walk, free_endpoint(), frames=walk.settings.frames, period_s=0.1) as playback:
        while playback.next_frame < 12:
            time.sleep(0.05)
        presenter = TakePresenter(playback.endpoint, None, walk, shows.append)
        _until(presenter, lambda: _newest(shows) > 12 and shows[-1].history.last_gap() is None)
        show = shows[-1]
        assert show.camera_names == tuple(camera.name for camera in walk.cameras)
        for frame in (0, 7, 12):
            solved = show.history.solved(frame)
            assert solved is not None
            np.testing.assert_array_equal(solved.pose, playback.pose(frame).pose)
            assert solved.of("confidence")[0] == 0.9 and np.isnan(solved.of("confidence")[1])
        presenter.close()


def test_what_nobody_but_the_recorder_has_comes_from_its_journal_with_its_pictures(
    walk: Take, shows: list[Show], store: Store, result: Path
) -> None:
    with Playback(walk, free_endpoint(), period_s=0.005) as playback:
        playback.forgotten_end = 10_000
        for frame in range(100):
            store.keep(playback.pose(frame))
        while playback.next_frame < 100:
            time.sleep(0.05)
        presenter = TakePresenter(playback.endpoint, None, walk, shows.append, result)
        _until(presenter, lambda: _newest(shows) > 150)
        show = shows[-1]
        _until(presenter, lambda: all(show.history.solved(frame) is not None for frame in range(100)))
        solved = show.history.solved(20)
        assert solved is not None and show.artist is not None
        np.testing.assert_array_equal(solved.pose, playback.pose(20).pose)
        (tile,) = show.artist.draw(solved, Look("pictures", (3,), None))
        assert cv2.imdecode(np.frombuffer(tile.jpeg, np.uint8), cv2.IMREAD_COLOR).std() > 10
        presenter.close()


def test_a_gap_that_the_coordinator_cannot_fill_is_read_from_the_journal(
    walk: Take, shows: list[Show], store: Store, result: Path
) -> None:
    with Playback(walk, free_endpoint(), period_s=0.005) as playback:
        playback.forgotten_end = 10_000
        while playback.next_frame < 100:
            time.sleep(0.05)
        presenter = TakePresenter(playback.endpoint, None, walk, shows.append, result)
        _until(presenter, lambda: _newest(shows) > 100 and len(playback.asked) > 2)
        assert shows[-1].history.solved(20) is None
        for frame in range(100):
            store.keep(playback.pose(frame))
        _until(presenter, lambda: all(shows[-1].history.solved(frame) is not None for frame in range(100)))
        presenter.close()


def test_what_was_settled_meanwhile_is_read_from_the_journal_at_the_end(
    walk: Take, shows: list[Show], store: Store, result: Path
) -> None:
    with Playback(walk, free_endpoint(), frames=30, period_s=0.05) as playback:
        presenter = TakePresenter(playback.endpoint, None, walk, shows.append, result)
        _until(presenter, lambda: _newest(shows) > 20)
        store.keep(playback.pose(7).model_copy(update={"settled": True}))
        history = shows[-1].history
        _until(presenter, lambda: (solved := history.solved(7)) is not None and solved.settled)
        assert history.is_over
        presenter.close()


def test_what_a_restarted_coordinator_has_not_got_is_not_asked_for_again_and_again(
    walk: Take, shows: list[Show]
) -> None:
    with Playback(walk, free_endpoint(), period_s=0.01) as playback:
        playback.forgotten_end = 100
        while playback.next_frame < 200:
            time.sleep(0.05)
        presenter = TakePresenter(playback.endpoint, None, walk, shows.append)
        _until(presenter, lambda: _newest(shows) > 200 and shows[-1].history.last_gap() == range(100))
        for _ in range(150):  # three seconds
            presenter.listen(0.02)
        asked = [message for message in playback.asked if isinstance(message, PoseRequest)]
        in_vain = [message for message in asked if message.first_frame < 100]
        assert 1 <= len(in_vain) <= 4
        presenter.listen(0.5)
        n_asked = len(playback.asked)
        for _ in range(100):
            assert shows[-1].history.solved(50) is None
            presenter.listen(0.02)
        assert len(playback.asked) - n_asked <= 4
        assert shows[-1].history.solved(150) is not None
        presenter.close()


def test_without_the_take_there_are_silhouettes(walk: Take, shows: list[Show]) -> None:
    with Playback(walk, free_endpoint()) as playback:
        presenter = TakePresenter(playback.endpoint, None, None, shows.append)
        _until(presenter, lambda: _newest(shows) > 3)
        show = shows[-1]
        assert show.camera_names[0] == "camera 1" and show.artist is not None
        solved = show.history.solved(3)
        assert solved is not None
        first = show.artist.draw(
            solved, Look("difference", (0, 1), None)
        )  # asks, and gives up after a moment
        assert [tile.differing_px for tile in first] == [None, None]
        _until(presenter, lambda: any(isinstance(m, SilhouettesRequest) for m in playback.asked))
        for _ in range(10):  # poses come as well
            presenter.listen(0.1)
        second = show.artist.draw(solved, Look("difference", (1, 0), None))
        assert all(tile.differing_px for tile in second)
        presenter.close()


def test_a_restarted_coordinator_with_another_take_brings_another_show(walk: Take, shows: list[Show]) -> None:
    endpoint = free_endpoint()
    with Playback(walk, endpoint, period_s=0.02):
        presenter = TakePresenter(endpoint, None, walk, shows.append)
        _until(presenter, lambda: _newest(shows) > 3)
    with Playback(walk, endpoint, frames=500, period_s=0.02):
        _until(presenter, lambda: len(shows) == 2 and _newest(shows) > 3)
    assert [len(show.history.frames) for show in shows] == [10_000, 500]
    presenter.close()


def test_the_end_of_a_take_is_noticed(walk: Take, shows: list[Show]) -> None:
    with Playback(walk, free_endpoint(), frames=30, period_s=0.05) as playback:
        presenter = TakePresenter(playback.endpoint, None, walk, shows.append)
        _until(presenter, lambda: bool(shows) and shows[-1].history.is_over)
        _until(presenter, lambda: _newest(shows) == 29 and shows[-1].history.last_gap() is None)
        presenter.close()
