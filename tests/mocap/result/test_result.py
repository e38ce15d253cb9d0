"""Results read back from their folder: what is enough, what adds to it, and what is refused."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from services.mocap.errors import UserError
from services.mocap.result.result import load_result
from services.mocap.take.quantities import FURTHER, Quantity
from services.mocap.take.tables import read_poses_csv, reference_joints, write_poses_csv


@pytest.fixture
def folder(bare_result: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(bare_result, tmp_path / "mine"))


def refusal(folder: Path) -> str:
    with pytest.raises(UserError) as refused:
        load_result(folder)
    assert "\n" not in str(refused.value)
    return str(refused.value).removeprefix(f"{folder}/")


def test_poses_and_actor_are_enough(folder: Path) -> None:
    result = load_result(folder)
    table = read_poses_csv(folder / "poses.csv")
    np.testing.assert_array_equal(result.poses, table.poses)
    assert result.frames.tolist() == list(range(100, 116))
    assert result.fps == pytest.approx(29.97, abs=1e-4)
    assert result.motion.name == "mine"
    assert result.motion.body.offsets_m[:, 2].min() == pytest.approx(-0.45)  # the thigh of actor.toml
    joints_m = reference_joints(table.poses, result.motion.body.offsets_m)
    np.testing.assert_array_equal(result.joints_world_m, joints_m)
    assert np.flatnonzero(result.distrusted.any(axis=1)).tolist() == [3]
    assert result.confidence.shape == (16, 6)
    assert len(result.angles_deg) == 43
    assert result.take_folder is None


def test_the_smoothed_motion_is_what_is_shown(folder: Path) -> None:
    table = read_poses_csv(folder / "poses.csv")
    table.poses[:, 0] += 1.0
    write_poses_csv(folder / "poses_smooth.csv", table)
    result = load_result(str(folder))
    np.testing.assert_allclose(result.poses[:, 0] - result.tracked.poses[:, 0], 1.0, atol=1e-6)


def test_columns_of_a_quantity_are_read_back_by_label(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hue = Quantity("hue", "1", "poses.csv", "hue_{}", "part")
    monkeypatch.setattr("services.mocap.result.result.FURTHER", (*FURTHER, hue))
    table = read_poses_csv(folder / "poses.csv")
    columns = {name: np.arange(len(table.frames)) + n for n, name in enumerate(("prior", "hue_head"))}
    write_poses_csv(folder / "poses.csv", replace(table, extra=columns))
    known = load_result(folder).quantities
    np.testing.assert_array_equal(known["prior"][""], columns["prior"])
    assert list(known["hue"]) == ["head"]
    np.testing.assert_array_equal(known["hue"]["head"], columns["hue_head"])
    assert known["shot"] == {}


def test_the_report_says_name_and_rate(folder: Path) -> None:
    (folder / "run.json").write_text(json.dumps({"take": {"name": "dance", "fps": 50.0, "folder": "a/b"}}))
    result = load_result(folder)
    assert (result.motion.name, result.fps, result.take_folder) == ("dance", 50.0, Path("a/b"))


def test_a_frame_that_is_missing(folder: Path) -> None:
    lines = (folder / "poses.csv").read_text().splitlines()
    (folder / "poses.csv").write_text("\n".join(lines[:5] + lines[6:]) + "\n")
    assert refusal(folder) == "poses.csv: frame: expected every frame, found none after frame 103"


def test_smoothed_poses_of_another_run(folder: Path) -> None:
    lines = (folder / "poses.csv").read_text().splitlines()
    (folder / "poses_smooth.csv").write_text("\n".join(lines[:9]) + "\n")
    assert refusal(folder) == "poses_smooth.csv: frame: expected the frames of poses.csv"


def test_what_is_no_result(folder: Path) -> None:
    assert refusal(folder / "nowhere").endswith(
        "is not a folder: expected a results folder of xormocap track"
    )
    (folder / "run.json").write_text("[]")
    assert refusal(folder).startswith("run.json: is not a file of xormocap track")
    (folder / "run.json").unlink()
    (folder / "actor.toml").unlink()
    assert refusal(folder).startswith("actor.toml: is missing")
