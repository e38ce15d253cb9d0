"""Frames that have left memory: from the recorder's journal, then from results; and why there are none.

Requests that nobody answers end, and frames that others have are asked for all the same.
"""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import msgpack
import numpy as np
import pytest

from playback import RUN, Playback
from proto.messages import PoseRequest, TakeInfo
from services.mocap.result.layout import journal_of
from services.mocap.search.settings import SearchSettings
from services.mocap.take.folder import Take
from services.recorder.store import Store
from services.viewer.archive import Archive, RetryRequests

_FRAMES = range(24)


@pytest.fixture
def info() -> TakeInfo:
    return TakeInfo(
        take="walk", run=RUN, fps=25.0, first_frame=0, end_frame=24, plan="0" * 64, shards=1, actor="1" * 64,
        rig="2" * 64, backend="cpu", backend_reason="test", threads=1,
        search=SearchSettings().model_dump(mode="json"),
    )  # fmt: skip


@pytest.fixture
def asked() -> list[PoseRequest]:
    return []


@pytest.fixture
def store(result: Path) -> Iterator[Store]:
    """The journal of a recorder whose results will be in the folder."""
    store = Store(journal_of(result).parent)
    yield store
    store.close(remove=True)


def test_the_recorders_journal_is_read_while_it_grows(
    walk: Take, result: Path, info: TakeInfo, store: Store, asked: list[PoseRequest]
) -> None:
    archive = Archive(info, _FRAMES, result, asked.append, lambda: 0.0)
    playback = Playback(walk, "tcp://127.0.0.1:5550")
    for frame in (0, 1, 3):
        store.keep(playback.pose(frame))
        solved = archive.solved(frame)
        assert solved is not None
        np.testing.assert_array_equal(solved.pose, playback.pose(frame).pose)
        assert solved.energy_px == playback.pose(frame).energy_px and solved.of("confidence")[0] == 0.9
    assert archive.solved(2) is None, "and not from results of a run before"
    archive.ask(2)
    assert [(request.first_frame, request.run) for request in asked] == [(2, RUN)]


def test_results_follow_the_journal(result: Path, info: TakeInfo, asked: list[PoseRequest]) -> None:
    archive = Archive(info, _FRAMES, result, asked.append, lambda: 0.0)
    assert archive.solved(3) is None
    archive.is_over = True
    assert archive.solved(3) is not None and archive.solved(24) is None


def _words_when_nobody_has(archive: Archive, monkeypatch: pytest.MonkeyPatch) -> str:
    """What is said of a frame that the coordinator does not send, however often it is asked."""
    assert archive.solved(5) is None
    archive.ask(5)
    assert archive.why_missing(5) == "was asked for"
    with monkeypatch.context() as later:
        for later_s in range(1, 9):
            later.setattr("time.monotonic", lambda now=1e6 + later_s: now)
            archive.ask(5)
    return archive.why_missing(5)


def test_the_page_says_why_it_has_not_got_a_frame(
    result: Path, info: TakeInfo, asked: list[PoseRequest], monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = Archive(info, _FRAMES, None, asked.append, lambda: 1e9)
    assert "does not know the results folder (--results)" in _words_when_nobody_has(elsewhere, monkeypatch)
    assert len(asked) == 3
    missing = Archive(info, _FRAMES, result, asked.append, lambda: 1e9)
    words = f"there is no journal at {journal_of(result)}"
    assert words in _words_when_nobody_has(missing, monkeypatch)


def test_a_journal_of_another_version_is_said(
    result: Path, info: TakeInfo, store: Store, asked: list[PoseRequest], monkeypatch: pytest.MonkeyPatch
) -> None:
    header = {"v": 1, "type": "pose", "run": RUN, "frame": 5, "shapes": [[30]]}
    store._journal.append([msgpack.packb(header), np.zeros(30).tobytes()])
    archive = Archive(info, _FRAMES, result, asked.append, lambda: 1e9)
    assert "was written by another version" in _words_when_nobody_has(archive, monkeypatch)


def test_the_same_frames_are_asked_for_a_few_times_and_then_let_be() -> None:
    requests = RetryRequests()
    asked = [tick for tick in range(100) if requests.asks(range(10, 20), 0.1 * tick, heard_s=0.1 * tick)]
    assert len(asked) == 3
    assert all(later - earlier >= 4 for earlier, later in pairwise(asked))
    assert requests.gone_end == 20
    assert not requests.asks(range(5, 12), 100.0, heard_s=100.0)
    assert requests.asks(range(20, 30), 200.0, heard_s=200.0)


def test_of_a_silent_coordinator_nothing_follows() -> None:
    requests = RetryRequests()
    assert sum(requests.asks(range(10), 0.5 * tick, heard_s=-1.0) for tick in range(50)) == 50
    assert requests.gone_end == 0


def test_frames_that_come_in_parts_are_never_let_be() -> None:
    requests = RetryRequests()
    assert all(requests.asks(range(start, 64), float(start), heard_s=float(start)) for start in range(60))
    assert requests.gone_end == 0
