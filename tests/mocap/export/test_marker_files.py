"""motion.trc and motion.c3d read back by their formats' rules."""

from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pytest

from services.mocap.body.kinematics import N_DOF
from services.mocap.errors import UserError
from services.mocap.export.marker_files import write_c3d, write_trc
from services.mocap.result.result import Result, load_result
from services.mocap.take.tables import REFERENCE_JOINTS


@pytest.fixture(scope="module")
def result(bare_result: Path) -> Result:
    return load_result(bare_result)


def test_trc(result: Result, tmp_path: Path) -> None:
    write_trc(tmp_path / "motion.trc", result.motion)
    lines = (tmp_path / "motion.trc").read_text("ascii").split("\n")
    assert lines[0].split("\t") == ["PathFileType", "4", "(X/Y/Z)", "motion.trc"]
    about = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
    assert float(about["DataRate"]) == float(about["CameraRate"]) == float(about["OrigDataRate"]) == 29.97
    assert (about["NumFrames"], about["NumMarkers"], about["Units"]) == ("16", "15", "mm")
    assert (about["OrigDataStartFrame"], about["OrigNumFrames"]) == ("100", "16")
    names, axes = lines[3].split("\t"), lines[4].split("\t")
    assert names[:2] == ["Frame#", "Time"]
    assert tuple(names[2::3]) == REFERENCE_JOINTS
    assert axes[2:] == [f"{axis}{n}" for n in range(1, 16) for axis in "XYZ"]
    assert len(names) == len(axes) == 47
    assert lines[5] == ""
    rows = np.array([line.split("\t") for line in lines[6:-1]], float)
    assert lines[-1] == ""
    np.testing.assert_array_equal(rows[:, 0], np.arange(100, 116))
    np.testing.assert_allclose(rows[:, 1], np.arange(100, 116) / 29.97, atol=1e-6)
    joints_m = rows[:, 2:].reshape(16, 15, 3) / 1000
    np.testing.assert_allclose(joints_m, result.joints_world_m[..., [1, 2, 0]], rtol=0, atol=1e-6)


def test_in_trc_a_standing_actor_is_upright_and_faces_z(result: Result, tmp_path: Path) -> None:
    poses = np.zeros((1, N_DOF))
    poses[0, 0:3] = 1.0, 0.5, 0.9
    still = replace(result.motion, poses=poses, frames=result.frames[:1], times_s=result.times_s[:1])
    write_trc(tmp_path / "still.trc", still)
    row = np.array((tmp_path / "still.trc").read_text().splitlines()[6].split("\t"), float)
    places = dict(zip(REFERENCE_JOINTS, row[2:].reshape(15, 3) / 1000, strict=True))
    np.testing.assert_allclose(places["pelvis"], [0.5, 0.9, 1.0], atol=1e-6)
    assert places["head_top"][1] > 1.5
    assert places["left_wrist"][0] > 1.0 > 0.0 > places["right_wrist"][0]


def test_c3d(result: Result, tmp_path: Path) -> None:
    write_c3d(tmp_path / "motion.c3d", result.motion)
    read = ezc3d.c3d(str(tmp_path / "motion.c3d"))
    about = {name: entry["value"] for name, entry in read["parameters"]["POINT"].items() if name[0] != "_"}
    assert tuple(about["LABELS"]) == REFERENCE_JOINTS
    assert about["UNITS"] == ["mm"]
    assert about["RATE"][0] == pytest.approx(29.97, abs=1e-4)
    assert (about["X_SCREEN"], about["Y_SCREEN"]) == (["+X"], ["+Z"])
    joints_m = read["data"]["points"][:3].transpose(2, 1, 0) / 1000
    np.testing.assert_allclose(joints_m, result.joints_world_m, rtol=0, atol=1e-6)
    assert np.all(read["data"]["meta_points"]["residuals"] == 0)  # known, not guessed


def test_c3d_has_its_limits(result: Result, tmp_path: Path) -> None:
    motion = result.motion
    late = replace(motion, frames=motion.frames + 70000)
    write_c3d(tmp_path / "late.c3d", late)
    header = np.frombuffer((tmp_path / "late.c3d").read_bytes()[:512], "<u2")
    assert (header[3], header[4]) == (1, 16)
    long = replace(motion, poses=np.zeros((65536, N_DOF)), frames=np.arange(65536, dtype=np.int32))
    with pytest.raises(UserError, match="cannot hold 65536 frames: the format ends at 65535"):
        write_c3d(tmp_path / "long.c3d", long)
    assert not (tmp_path / "long.c3d").exists()


def test_c3d_counts_frames_from_one(result: Result, tmp_path: Path) -> None:
    """Its header: the number of points, then the first and the last frame, as 16-bit words."""
    write_c3d(tmp_path / "motion.c3d", result.motion)
    header = np.frombuffer((tmp_path / "motion.c3d").read_bytes()[:512], "<u2")
    assert (header[1], header[3], header[4]) == (15, 101, 116)
