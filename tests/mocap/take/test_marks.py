import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from proto import messages
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOFS
from services.mocap.errors import TakeError
from services.mocap.take.marks import LIMB_NAMES, MARK_COLUMNS, PARTS, Marks, doubtful_parts, judged_parts
from services.mocap.take.tables import PoseTable, read_poses_csv, write_poses_csv

N = 4
SHARES = st.just(np.nan) | st.floats(0, 1)


def table_with(marks: Marks | None, n: int = N, **extra: np.ndarray) -> PoseTable:
    frames = np.arange(n, dtype=np.int32)
    return PoseTable(frames, frames / 15, np.zeros((n, N_DOF)), np.ones(n), extra, marks)


def some_marks() -> Marks:
    distrusted = np.zeros((N, len(PARTS)), bool)
    distrusted[1, [2, 5]] = distrusted[3, 0] = distrusted[2, 2] = True
    confidence = np.full((N, len(PARTS)), 0.875)
    confidence[0] = np.nan
    return Marks(confidence, distrusted)


def test_the_parts_are_those_of_the_wire() -> None:
    assert get_args(messages.Part) == PARTS
    assert get_args(messages.Limb) == LIMB_NAMES


def test_a_doubtful_torso_makes_all_parts_doubtful_and_judged() -> None:
    marks = some_marks()
    marks.confidence[3] = np.nan
    expected = marks.distrusted.copy()
    expected[3] = True
    np.testing.assert_array_equal(doubtful_parts(marks.distrusted), expected)
    np.testing.assert_array_equal(doubtful_parts(marks.distrusted[3]), [True] * 6)
    assert judged_parts(marks.confidence, marks.distrusted).all(axis=1).tolist() == [False, True, True, True]
    assert not judged_parts(marks.confidence[0], marks.distrusted[0]).any()


@given(arrays(np.float64, (N, len(PARTS)), elements=SHARES), arrays(np.bool_, (N, len(PARTS))))
def test_marks_come_back(confidence: np.ndarray, distrusted: np.ndarray) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "poses.csv"
        write_poses_csv(path, table_with(Marks(confidence, distrusted), passes=np.arange(N) + 0.5))
        table = read_poses_csv(path)
    assert table.marks is not None
    np.testing.assert_array_equal(table.marks.distrusted, distrusted)
    np.testing.assert_allclose(table.marks.confidence, confidence, atol=0.6e-3)
    assert list(table.extra) == ["passes"]


def test_how_they_are_written(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    write_poses_csv(path, table_with(some_marks()))
    header, *rows = (line.split(",")[-len(MARK_COLUMNS) :] for line in path.read_text().splitlines())
    assert header == ["distrusted", *(f"confidence_{part}" for part in PARTS)]
    assert [row[0] for row in rows] == ["", "left_arm;right_leg", "left_arm", "torso"]
    assert [row[1] for row in rows] == ["", "0.875", "0.875", "0.875"]


def test_how_many_frames_are_distrusted() -> None:
    marks = some_marks()
    assert marks.distrusted_frames == 3
    assert marks.distrusted_by_part == {**dict.fromkeys(PARTS, 0), "left_arm": 2, "right_leg": 1, "torso": 1}


def test_older_tables_have_none(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    write_poses_csv(path, table_with(None))
    assert path.read_text().splitlines()[0].endswith(f"{DOFS[-1].column},energy_px")
    assert read_poses_csv(path).marks is None


def rewritten(path: Path, change: Callable[[str], str]) -> None:
    write_poses_csv(path, table_with(some_marks()))
    path.write_text(change(path.read_text()))


def test_columns_that_were_cut_out_say_nothing(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    rewritten(path, lambda t: "\n".join(line.rsplit(",", len(PARTS))[0] for line in t.splitlines()))
    marks = read_poses_csv(path).marks
    assert marks is not None
    assert np.isnan(marks.confidence).all()
    np.testing.assert_array_equal(marks.distrusted, some_marks().distrusted)


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (lambda t: t.replace(";right_leg", ";tail"), ("line 3: distrusted: expected some of torso", "tail")),
        (lambda t: t.replace("0.875", "1.2", 1), ("line 3: confidence_torso", "from 0 to 1, found '1.2'")),
        (lambda t: t.replace("0.875", "sure", 1), ("line 3: confidence_torso", "a finite number", "'sure'")),
        (lambda t: t.replace("0.875", "nan", 1), ("line 3: confidence_torso", "a finite number", "'nan'")),
    ],
)
def test_bad_marks_are_refused_in_one_sentence(
    tmp_path: Path, change: Callable[[str], str], parts: tuple[str, ...]
) -> None:
    path = tmp_path / "poses.csv"
    rewritten(path, change)
    with pytest.raises(TakeError) as refused:
        read_poses_csv(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert all(part in str(refused.value) for part in parts), refused.value


def test_extra_columns_cannot_take_their_names(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="confidence_head: are columns"):
        write_poses_csv(tmp_path / "poses.csv", table_with(None, confidence_head=np.ones(N)))
