"""Missed frames are read from a journal that grows, is torn, or is another one.

Requests that nobody answers end, and frames that others have are asked for all the same.
"""

import logging
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import msgpack
import numpy as np
import pytest

from playback import RUN, Playback
from proto.framing import encode
from proto.messages import OPEN_END, Pose
from services.mocap.take.folder import Take
from services.mocap.take.journal import JOURNAL, Journal
from services.viewer.frame_history import FrameHistory
from services.viewer.missed_frames import RetryRequests, read_journal
from services.viewer.solved_frame import SolvedFrame


@pytest.fixture
def pose(walk: Take) -> Callable[..., Pose]:
    """`pose(7, run=…)`: the message of frame 7."""
    playback = Playback(walk, "tcp://127.0.0.1:5550")
    return lambda frame, **changes: playback.pose(frame).model_copy(update=changes)


@pytest.fixture
def journal(tmp_path: Path) -> Journal:
    return Journal(tmp_path / JOURNAL)


@pytest.fixture
def history() -> FrameHistory:
    return FrameHistory(range(10, 1000))


def _known(history: FrameHistory) -> list[int]:
    return [frame for frame in range(1000) if history.solved(frame) is not None]


def test_a_journal_is_read_while_it_grows(
    journal: Journal, history: FrameHistory, pose: Callable[..., Pose]
) -> None:
    journal.append([msgpack.packb({"type": "take_info", "run": RUN})])
    for frames in ((9, 10, 12), (), (11, 1000)):
        for frame in frames:
            journal.append(encode(pose(frame)))
        read_journal(journal.path, RUN, history)
    assert _known(history) == [10, 11, 12]
    assert history.newest == 12
    solved = history.solved(11)
    assert solved is not None and np.isfinite(solved.arrived_s)
    np.testing.assert_array_equal(solved.pose, pose(11).pose)
    assert solved.energy_px == pose(11).energy_px and solved.of("confidence")[0] == 0.9


def test_what_is_known_stays_unless_the_journal_has_it_settled(
    journal: Journal, history: FrameHistory, pose: Callable[..., Pose], solved: Callable[..., SolvedFrame]
) -> None:
    for frame in (10, 11):
        history.put(solved(frame))
        journal.append(encode(pose(frame)))
    journal.append(encode(pose(11, settled=True, energy_px=7.0)))
    read_journal(journal.path, RUN, history)
    assert [known.energy_px for frame in (10, 11) if (known := history.solved(frame))] == [110.0, 7.0]


def test_moments_that_a_continued_live_run_replaced_are_not_shown(
    journal: Journal, history: FrameHistory, pose: Callable[..., Pose]
) -> None:
    for frame in (10, 12, 13):
        journal.append(encode(pose(frame, energy_px=1.0)))
    told = {"type": "take_info", "run": RUN, "end_frame": OPEN_END, "continued_at": 11}
    journal.append([msgpack.packb(told)])
    for frame in (11, 12):
        journal.append(encode(pose(frame, energy_px=9.0)))
    read_journal(journal.path, RUN, history)
    assert _known(history) == [10, 11, 12]
    assert [known.energy_px for frame in (10, 11, 12) if (known := history.solved(frame))] == [1.0, 9.0, 9.0]


def test_a_record_that_is_being_written_is_read_once_it_is_whole(
    tmp_path: Path, journal: Journal, history: FrameHistory, pose: Callable[..., Pose]
) -> None:
    for frame in (10, 11):
        journal.append(encode(pose(frame)))
    content, cut_off = journal.path.read_bytes(), tmp_path / "cut off"
    for cut in (len(content) - 1, len(content) - 300):
        cut_off.write_bytes(content[:cut])
        read_journal(cut_off, RUN, history)
        assert _known(history) == [10]
    read_journal(journal.path, RUN, history)
    assert _known(history) == [10, 11]


def test_other_runs_are_left_alone(
    journal: Journal, history: FrameHistory, pose: Callable[..., Pose]
) -> None:
    for frame in range(10, 40):
        journal.append(encode(pose(frame, run="1" * 32)))
    read_journal(journal.path, RUN, history)
    assert _known(history) == []
    journal.clear()
    for frame in range(10, 100):  # longer than before
        journal.append(encode(pose(frame)))
    read_journal(journal.path, RUN, history)
    assert _known(history) == list(range(10, 100))
    journal.close(remove=True)
    read_journal(journal.path, RUN, history)


def test_what_is_no_journal_of_this_version_is_logged(
    tmp_path: Path, journal: Journal, history: FrameHistory, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    header = {"v": 1, "type": "pose", "run": RUN, "frame": 15, "shapes": [[30]]}
    journal.append([msgpack.packb(header), np.zeros(30).tobytes()])
    read_journal(journal.path, RUN, history)
    assert f"{journal.path} was written by another version" in caplog.text
    (tmp_path / "table").write_text("frame,time_s\n")
    read_journal(tmp_path / "table", RUN, history)
    assert "is not a journal" in caplog.text
    assert _known(history) == []


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
