"""A journal holds what was written whole, and says what was not."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.body.kinematics import N_DOF
from services.mocap.errors import TakeError, UserError
from services.mocap.take.journal import JOURNAL, POSE, Journal, Record, read_poses, read_records


def pose(frame: int, energy_px: float = 900.0) -> Record:
    fields = {"frame": frame, "time_s": frame / 25, "energy_px": energy_px, "prior": 0.5}
    marks = {"confidence": {"torso": 0.75}, "distrusted": ["left_arm"]}
    return Record(POSE, fields | marks, {"pose": np.arange(N_DOF) / 7 + frame})


def written(path: Path, *records: Record) -> bytes:
    journal = Journal(path)
    for record in records:
        journal.append(record)
    journal.sync()
    journal.close()
    return path.read_bytes()


def frames_in(path: Path) -> list[int]:
    return [record.fields["frame"] for record in read_records(path)]


def test_what_was_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "made" / JOURNAL
    written(path, pose(3), pose(4))
    again = Journal(path)
    assert again.torn_bytes == 0
    (_, three), (offset, four) = again.records()
    assert three.kind == POSE
    assert three.fields == pose(3).fields
    assert three.arrays["pose"].tobytes() == pose(3).arrays["pose"].tobytes()
    assert again.at(offset).fields == four.fields
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
    with pytest.raises(TakeError, match="holds no frame yet"):
        read_poses(path)
    for frame in (2, 0, 1, 2):
        journal.append(pose(frame))
    table = read_poses(path)
    assert table.frames.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(table.times_s, np.arange(3) / 25)
    np.testing.assert_array_equal(table.poses, [pose(frame).arrays["pose"] for frame in range(3)])
    assert table.marks is not None
    assert table.marks.distrusted_by_part["left_arm"] == 3
    assert np.isnan(table.marks.confidence[0]).sum() == 5
    journal.close()


def test_one_process_at_a_time(tmp_path: Path) -> None:
    journal = Journal(tmp_path / JOURNAL)
    with pytest.raises(UserError, match="another recorder writes it"):
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


def test_other_files_are_not_taken_for_journals(tmp_path: Path) -> None:
    (tmp_path / JOURNAL).write_text("frame,time_s\n")
    with pytest.raises(TakeError, match="is not a journal of this version: remove it"):
        Journal(tmp_path / JOURNAL)
    with pytest.raises(TakeError, match="cannot be read"):
        read_poses(tmp_path / "nothing")
    assert (tmp_path / JOURNAL).read_text() == "frame,time_s\n"
