import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOFS, pose_of_body
from services.mocap.camera.calibration import Up
from services.mocap.errors import TakeError
from services.mocap.take.tables import (
    REFERENCE_JOINTS,
    PoseTable,
    from_take_world,
    read_joints_csv,
    read_poses_csv,
    to_take_world,
    write_joints_csv,
    write_poses_csv,
)
from services.mocap.types import Floats

LENGTHS = st.integers(1, 6)


@given(LENGTHS.flatmap(lambda n: arrays(np.float64, (n, 15, 3), elements=st.floats(-50, 50))))
def test_joints_come_back_to_a_hundredth_of_a_millimetre(joints_m: Floats) -> None:
    frames = 3 + 2 * np.arange(len(joints_m), dtype=np.int32)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "joints.csv"
        write_joints_csv(path, frames, frames / 60, joints_m)
        table = read_joints_csv(path)
    np.testing.assert_array_equal(table.frames, frames)
    assert table.frames.dtype == np.int32
    np.testing.assert_allclose(table.times_s, frames / 60, atol=0.6e-6)
    np.testing.assert_allclose(table.joints_take_m, joints_m, atol=0.6e-5)


@settings(max_examples=30)
@given(
    LENGTHS.flatmap(
        lambda n: st.tuples(
            arrays(np.float64, (n, N_DOF), elements=st.floats(-10, 10)),
            arrays(np.float64, n, elements=st.floats(0, 1e6)),
        )
    )
)
def test_poses_and_extra_columns_come_back(drawn: tuple[Floats, Floats]) -> None:
    poses, energies_px = drawn
    frames = np.arange(len(poses), dtype=np.int32)
    extra = {"passes": np.full(len(poses), 3.0), "seconds": energies_px / 7}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "poses.csv"
        write_poses_csv(path, PoseTable(frames, frames / 15, poses, energies_px, extra))
        header = path.read_text("utf-8").splitlines()[0].split(",")
        table = read_poses_csv(path)
    assert header == ["frame", "time_s", *(dof.column for dof in DOFS), "energy_px", "passes", "seconds"]
    np.testing.assert_array_equal(table.frames, frames)
    np.testing.assert_allclose(table.poses, poses, atol=0.6e-6)
    np.testing.assert_allclose(table.energies_px, energies_px, rtol=1e-9)
    assert list(table.extra) == ["passes", "seconds"]
    np.testing.assert_allclose(table.extra["seconds"], extra["seconds"], rtol=1e-9)


def test_a_real_reference_is_written_again_byte_for_byte(shared_takes: Path, tmp_path: Path) -> None:
    original = shared_takes / "studio-a" / "reference" / "joints.csv"
    table = read_joints_csv(original)
    write_joints_csv(tmp_path / "joints.csv", table.frames, table.times_s, table.joints_take_m)
    assert (tmp_path / "joints.csv").read_bytes() == original.read_bytes()
    hips = [REFERENCE_JOINTS.index(name) for name in ("left_hip", "right_hip")]
    pelvis_m = table.joints_take_m[:, REFERENCE_JOINTS.index("pelvis")]
    np.testing.assert_allclose(table.joints_take_m[:, hips].mean(axis=1), pelvis_m, atol=2e-5)


@given(arrays(np.float64, (4, 15, 3), elements=st.floats(-9, 9)), st.sampled_from(["y", "z"]))
def test_worlds_turn_there_and_back(points_m: Floats, up: Up) -> None:
    turned_m = to_take_world(points_m, up)
    np.testing.assert_array_equal(from_take_world(turned_m, up), points_m)
    np.testing.assert_array_equal(turned_m[..., "xyz".index(up)], points_m[..., 2])


def lines_of_a_table(path: Path) -> list[str]:
    write_joints_csv(path, np.arange(2, dtype=np.int32), np.array([0.0, 0.1]), np.ones((2, 15, 3)))
    return path.read_text().splitlines()


@pytest.mark.parametrize(
    ("mend", "parts"),
    [
        (
            lambda t: [t[0].replace("neck_x", "nek_x"), *t[1:]],
            ("'nek_x'", "unknown column", "did you mean neck_x"),
        ),
        (lambda t: [t[0] + ",chin_x", t[1] + ",0", t[2] + ",0"], ("'chin_x'", "unknown column")),
        (lambda t: [line.rsplit(",", 1)[0] for line in t], ("right_ankle_z: column is missing",)),
        (lambda t: [f"{t[0]},neck_x", f"{t[1]},0", f"{t[2]},0"], ("'neck_x'", "duplicate column")),
        (lambda t: [t[0], t[1] + ",0"], ("line 2: expected 47 values", "found 48")),
        (lambda t: [t[0], t[1], t[2].replace("1.00000", "one", 1)], ("line 3: pelvis_x", "found 'one'")),
        (lambda t: [t[0], t[1], t[2].replace("1.00000", "nan", 1)], ("line 3: pelvis_x: expected a finite",)),
        (lambda t: [t[0], t[2], t[1]], ("frame: expected whole numbers",)),
        (lambda t: [t[0], "0.5" + t[1][1:]], ("frame: expected whole numbers",)),
        (lambda t: t[:1], ("contains no rows",)),
        (lambda _: [], ("frame: column is missing",)),
    ],
)
def test_a_bad_table_is_refused_in_one_sentence(
    tmp_path: Path, mend: Callable[[list[str]], list[str]], parts: tuple[str, ...]
) -> None:
    path = tmp_path / "joints.csv"
    path.write_text("\n".join(mend(lines_of_a_table(path))))
    with pytest.raises(TakeError) as refused:
        read_joints_csv(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert all(part in str(refused.value) for part in parts), refused.value
    assert "\n" not in str(refused.value)


def test_a_table_of_the_published_body_has_zeros_for_the_rest(tmp_path: Path) -> None:
    path, poses = tmp_path / "poses.csv", np.ones((2, N_DOF))
    write_poses_csv(path, PoseTable(np.arange(2, dtype=np.int32), np.arange(2.0), poses, np.zeros(2)))
    cells = [line.split(",") for line in path.read_text().splitlines()]
    lacking = {dof.column for dof in DOFS if not dof.in_paper}
    kept = [i for i, name in enumerate(cells[0]) if name not in lacking]
    path.write_text("\n".join(",".join(line[i] for i in kept) for line in cells))
    read = read_poses_csv(path)
    np.testing.assert_array_equal(read.poses, pose_of_body(poses, "paper"))
    assert not read.extra


def test_a_missing_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TakeError, match=r"poses.csv: is missing"):
        read_poses_csv(tmp_path / "poses.csv")


def test_numbers_that_are_none_are_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="left_knee_y: expected finite numbers"):
        joints_m = np.zeros((1, 15, 3))
        joints_m[0, REFERENCE_JOINTS.index("left_knee"), 1] = np.nan
        write_joints_csv(tmp_path / "joints.csv", np.zeros(1, np.int32), np.zeros(1), joints_m)
    assert not any(tmp_path.iterdir())
