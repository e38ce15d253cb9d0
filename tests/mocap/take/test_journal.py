"""A journal holds what was written whole, and says what was not."""

import errno
import os
import struct
import zlib
from pathlib import Path
from unittest.mock import Mock

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.errors import TakeError, UserError
from services.mocap.take.journal import JOURNAL, Journal, record_at, records


def pose(frame: int) -> list[bytes]:
    return [str(frame).encode(), (np.arange(35.0) / 7 + frame).tobytes()]


def written(path: Path, *to_write: list[bytes]) -> bytes:
    journal = Journal(path)
    for record in to_write:
        journal.append(record)
    journal.sync()
    journal.close()
    return path.read_bytes()


def frames_in(path: Path) -> list[int]:
    with path.open("rb") as file:
        return [int(frames[0]) for _, frames, _ in records(file.fileno(), path)]


def test_what_was_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "made" / JOURNAL
    written(path, pose(3), pose(4))
    again = Journal(path)
    assert again.torn_bytes == 0
    (_, three), (offset, four) = again.records()
    assert three == pose(3)
    assert again.at(offset) == four == pose(4)
    again.append(pose(5))
    again.close()
    assert frames_in(path) == [3, 4, 5]


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_a_torn_last_record_is_cut_off_and_said(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("torn") / JOURNAL
    two = len(written(path, pose(0), pose(1)))
    whole = written(path, pose(2))
    cut = data.draw(st.integers(two, len(whole) - 1))
    path.write_bytes(whole[:cut])
    assert frames_in(path) == [0, 1], "readers do not mind"
    journal = Journal(path)
    assert journal.torn_bytes == cut - two
    journal.append(pose(9))
    journal.close()
    assert frames_in(path) == [0, 1, 9]


@pytest.mark.parametrize("damaged", [25, 60, -1, -40])
def test_what_follows_a_damaged_record_does_not_count(tmp_path: Path, damaged: int) -> None:
    path = tmp_path / JOURNAL
    content = bytearray(written(path, pose(0)))
    content[damaged] ^= 0x10
    path.write_bytes(content)
    assert frames_in(path) == []
    journal = Journal(path)
    assert journal.torn_bytes > 0
    journal.close()


@pytest.mark.parametrize("content", [b"", b"xormocap jour"])
def test_a_journal_that_was_hardly_begun_is_an_empty_one(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / JOURNAL
    path.write_bytes(content)
    assert frames_in(path) == []
    written(path, pose(0))
    assert frames_in(path) == [0]


def test_it_is_read_while_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / JOURNAL
    journal = Journal(path)
    assert frames_in(path) == []
    for n, frame in enumerate((2, 0, 1, 2)):
        offset = journal.append(pose(frame))
        assert frames_in(path) == [2, 0, 1, 2][: n + 1]
        with path.open("rb") as file:
            assert record_at(file.fileno(), offset) == (pose(frame), path.stat().st_size)
    journal.close()


def test_a_record_of_an_earlier_version_has_no_frames(tmp_path: Path) -> None:
    journal = Journal(tmp_path / JOURNAL)
    payload = msgpack.packb({"kind": "pose", "fields": {"frame": 3}, "arrays": {}})
    journal.append(pose(0))
    with (tmp_path / JOURNAL).open("ab") as file:
        file.write(struct.pack("<II", len(payload), zlib.crc32(payload)) + payload)
    assert [frames for _, frames in journal.records()] == [pose(0), []]
    journal.close()


def test_one_process_at_a_time(tmp_path: Path) -> None:
    journal = Journal(tmp_path / JOURNAL)
    with pytest.raises(UserError, match="another recorder is writing it"):
        Journal(tmp_path / JOURNAL)
    journal.append(pose(0))
    journal.close()
    written(tmp_path / JOURNAL, pose(1))


def test_it_goes_when_it_is_not_needed_and_takes_an_empty_folder_along(tmp_path: Path) -> None:
    Journal(tmp_path / "empty" / JOURNAL).close()
    assert not (tmp_path / "empty").exists()
    kept = Journal(tmp_path / "kept" / JOURNAL)
    kept.append(pose(0))
    (tmp_path / "kept" / "run.json").touch()
    kept.close(remove=True)
    assert [path.name for path in (tmp_path / "kept").iterdir()] == ["run.json"]


def test_beginning_anew(tmp_path: Path) -> None:
    journal = Journal(tmp_path / JOURNAL)
    journal.append(pose(0))
    journal.clear()
    journal.append(pose(7))
    assert frames_in(tmp_path / JOURNAL) == [7]
    journal.close()


@pytest.mark.parametrize("call", ["ftruncate", "fsync"])
def test_a_disk_that_fails_when_beginning_anew_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    journal = Journal(tmp_path / JOURNAL)
    journal.append(pose(0))
    monkeypatch.setattr(os, call, Mock(side_effect=OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
    with pytest.raises(UserError, match=f"{JOURNAL}: cannot be written .No space left on device.: free"):
        journal.clear()
    journal.close()


def test_other_files_are_not_taken_for_journals(tmp_path: Path) -> None:
    (tmp_path / JOURNAL).write_text("frame,time_s\n")
    with pytest.raises(TakeError, match="is not a journal of this version: remove it"):
        Journal(tmp_path / JOURNAL)
    assert (tmp_path / JOURNAL).read_text() == "frame,time_s\n"


def test_what_is_no_journal_is_left_to_others(tmp_path: Path) -> None:
    path = tmp_path / JOURNAL
    path.write_bytes(b"something else")
    for _ in range(2):  # a lock that was kept would make it another error
        with pytest.raises(TakeError):
            Journal(path)
    assert path.read_bytes() == b"something else"
