"""Poses are found in a journal that grows, is torn, or is begun anew meanwhile."""

from pathlib import Path

import msgpack
import numpy as np
import pytest

from services.mocap.body.kinematics import N_DOF
from services.mocap.errors import TakeError
from services.mocap.take.journal import JOURNAL, Journal
from services.viewer.archive import JournalIndex


def pose(frame: int, run: str = "now") -> list[bytes]:
    header = {"type": "pose", "frame": frame, "run": run}
    return [msgpack.packb(header), np.full(N_DOF, float(frame)).tobytes()]


def begun(run: str) -> list[bytes]:
    return [msgpack.packb({"type": "take_info", "run": run})]


@pytest.fixture
def index(tmp_path: Path) -> JournalIndex:
    return JournalIndex(tmp_path / JOURNAL, "now", range(10, 1000))


def test_what_is_written_meanwhile_is_found_in_any_order(tmp_path: Path, index: JournalIndex) -> None:
    with pytest.raises(FileNotFoundError):
        index.pose(10)
    journal = Journal(tmp_path / JOURNAL)
    assert index.pose(10) is None
    journal.append(begun("now"))
    for frame in (10, 12, 11):
        journal.append(pose(frame))
        assert index.pose(frame) == pose(frame)
    assert [frame for frame in range(5, 15) if index.pose(frame) is not None] == [10, 11, 12]
    journal.close()


def test_a_record_that_is_being_written_is_found_once_it_is_whole(
    tmp_path: Path, index: JournalIndex
) -> None:
    whole = tmp_path / "whole"
    journal = Journal(whole)
    for frame in (10, 11):
        journal.append(pose(frame))
    journal.close()
    content = whole.read_bytes()
    for cut in (len(content) - 1, len(content) - 300):
        (tmp_path / JOURNAL).write_bytes(content[:cut])
        assert index.pose(10) is not None and index.pose(11) is None
    (tmp_path / JOURNAL).write_bytes(content)
    assert index.pose(11) is not None


def test_other_runs_are_left_alone_and_a_new_beginning_is_noticed(
    tmp_path: Path, index: JournalIndex
) -> None:
    journal = Journal(tmp_path / JOURNAL)
    for record in (begun("before"), *(pose(frame, "before") for frame in range(10, 40))):
        journal.append(record)
    assert index.pose(10) is None
    journal.clear()
    for record in (begun("now"), *(pose(frame) for frame in range(10, 100))):  # longer than before
        journal.append(record)
    assert index.pose(10) is not None and index.pose(99) is not None
    journal.close(remove=True)
    with pytest.raises(FileNotFoundError):
        index.pose(10)


def test_what_is_no_journal_is_said(tmp_path: Path, index: JournalIndex) -> None:
    (tmp_path / JOURNAL).write_text("frame,time_s\n")
    with pytest.raises(TakeError, match="is not a journal"):
        index.pose(10)
