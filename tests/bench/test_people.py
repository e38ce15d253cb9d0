"""The bench of people who are not the body model; the tracking itself is stood in for."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from bench import people
from bench.__main__ import app
from bench.command import Run
from bench.limb_scores import Errors, MarkErrors
from bench.people import Outcome, Row
from bench.people_tables import as_tables, groups_of, outcome_figures, sums_of
from bench.pose_floor import floor_of, true_poses
from bench.studio_takes import Studio, names_between, true_actor, with_true_silhouettes
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.errors import TakeError, UserError
from services.mocap.synth.take import write_synthetic_take
from services.mocap.synth.walk import walk
from services.mocap.take.folder import open_take
from services.mocap.take.layout import REFERENCE_JOINTS_CSV
from services.mocap.take.tables import PoseTable, read_joints_csv, reference_joints, write_joints_csv

N = 3
HEIGHT_M = 1.75
ACTOR_JSON = {
    "stature": 1.70,
    "bone_lengths": {"forearm": 0.25, "shank": 0.40},
    "options": {"outfit": {"kind": "loose"}},
}


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A take of the own body, with exact silhouettes beside its videos."""
    folder: Path = tmp_path_factory.mktemp("takes") / "dev-001"
    write_synthetic_take(folder, n_frames=N, n_cameras=4, height_m=HEIGHT_M)
    (folder / "reference" / "actor.json").write_text(json.dumps(ACTOR_JSON))
    return folder


@pytest.fixture
def tracked_as_true(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tracking finds the true joints, and its poses are nearly right."""

    def track(folder: Path, out: Path, frames: str, workers: int, options: tuple[str, ...]) -> Run:
        assert (frames, workers, options) == (":", 1, ("--set", "max_passes=5"))
        if "--refused" in folder.name:
            raise UserError("xormocap track: nobody is to be seen")
        joints = read_joints_csv(folder / REFERENCE_JOINTS_CSV)
        out.mkdir(parents=True)
        write_joints_csv(out / "joints.csv", joints.frames, joints.times_s, joints.joints_take_m)
        poses = true_poses(joints.joints_take_m, build_body(Actor(height=HEIGHT_M)))
        table = PoseTable(joints.frames, joints.times_s, poses, np.zeros(N))
        return Run({"speed": {"frames_per_s": 4.0}}, Actor(height=HEIGHT_M), table)

    monkeypatch.setattr(people, "track", track)


def test_true_poses_have_the_true_joints() -> None:
    body = build_body(Actor(height=1.8))
    poses = walk(60, 15.0, body)[20:60:8]
    poses[:, DOF_INDEX["root_heading"]] += 2.5
    true_m = reference_joints(poses, body.offsets_m)
    found_m = reference_joints(true_poses(true_m, body), body.offsets_m)
    assert np.linalg.norm(found_m - true_m, axis=2).max() < 0.02


def test_the_floor_of_the_own_body_is_low_and_a_wrong_arm_is_a_failure(take: Path, tmp_path: Path) -> None:
    opened = open_take(with_true_silhouettes(take, tmp_path / "true"))
    true_m = read_joints_csv(take / REFERENCE_JOINTS_CSV).joints_take_m
    tracked = true_poses(true_m, build_body(Actor(height=HEIGHT_M)))
    tracked[1, DOF_INDEX["left_elbow_flexion"]] += 1.5
    floor = floor_of(opened, Actor(height=HEIGHT_M), list(range(N)), tracked, true_m)
    assert floor.frames == N
    assert floor.errors.mean_mm < 10.0
    assert floor.errors.lost_percent == 0.0
    assert floor.tracked_errors.lost_percent == pytest.approx(100.0 / (4 * N))
    assert floor.failures_percent >= 100.0 / N


@pytest.mark.usefixtures("tracked_as_true")
def test_the_command_measures_and_tells_refusals(take: Path, tmp_path: Path) -> None:
    refused, written = tmp_path / "dev-002--refused", tmp_path / "people.json"
    shutil.copytree(take, refused)
    arguments = ["people", str(take), str(refused), "--true-silhouettes", "--floor-frames", "2"]
    arguments += ["--workers", "1", "--track", "--set max_passes=5", "--json", str(written)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "nobody is to be seen" in " ".join(done.output.split())
    found, left = json.loads(written.read_text())["rows"]
    assert (found["take"], found["cameras"], found["clothes"], found["frames"]) == ("dev-001", 4, "loose", N)
    assert found["outcome"]["errors"]["mean_mm"] == pytest.approx(0.0, abs=0.01)
    assert found["outcome"]["height_off_cm"] == pytest.approx(5.0)
    assert set(found["outcome"]["bones_off_percent"]) == {"forearm", "shank"}
    assert found["floor"]["frames"] == 2
    assert left["outcome"] is None
    assert "nobody" in left["refusal"]


@pytest.mark.parametrize(
    "arguments", [[], ["--seeds", "dev-001"], ["--studio", "."], ["--seeds", "x"], [".", "--videos"]]
)
def test_the_command_wants_takes_or_a_studio_with_seeds(arguments: list[str]) -> None:
    assert CliRunner().invoke(app, ["people", *arguments]).exit_code == 2


def test_names_between() -> None:
    assert names_between("dev-098:dev-101") == ["dev-098", "dev-099", "dev-100", "dev-101"]
    assert names_between("dev-7") == ["dev-7"]
    assert names_between("") == []
    for text in ("dev-3:dev-2", "dev-1:test-2", "7:9", ":dev-1"):
        with pytest.raises(UserError, match="expected a first and a last take"):
            names_between(text)


@pytest.mark.parametrize(
    ("with_videos", "options"), [(False, ["--fast", "--boundary-noise", "0.7"]), (True, ["--silhouettes"])]
)
def test_a_studio_makes_a_take_once(tmp_path: Path, options: list[str], *, with_videos: bool) -> None:
    maker = tmp_path / "make_take.py"
    maker.write_text(
        "import sys, pathlib\n"
        "name, take, reference, *rest = sys.argv[1:]\n"
        f"assert rest == {options}\n"
        "if name == 'dev-002': sys.exit('no such motion')\n"
        "(pathlib.Path(take) / 'take.toml').write_text(name)\n"
        "pathlib.Path(reference).mkdir()\n"
    )
    studio = Studio(tmp_path, tmp_path / "kept", with_videos)
    folder = studio.take("dev-001")
    assert (folder / "take.toml").read_text() == "dev-001"
    with pytest.raises(UserError, match=r"make_take.py dev-002: no such motion"):
        studio.take("dev-002")
    maker.unlink()
    assert studio.take("dev-001") == folder
    assert sorted(path.name for path in folder.iterdir()) == ["reference", "take.toml"]
    with pytest.raises(UserError, match=r"has no make_take.py"):
        studio.take("dev-003")


def test_true_silhouettes_take_the_place_of_videos(take: Path, tmp_path: Path) -> None:
    made = with_true_silhouettes(take, tmp_path / "true")
    assert open_take(made).source == "silhouettes"
    assert open_take(take).source == "videos"
    assert with_true_silhouettes(tmp_path, tmp_path / "none") == tmp_path


def test_what_is_known_of_the_actor(take: Path, tmp_path: Path) -> None:
    known = true_actor(take)
    assert (known.height_m, known.clothes, known.bone_lengths_m["shank"]) == (1.70, "loose", 0.40)
    with pytest.raises(TakeError, match="expected stature"):
        true_actor(tmp_path)


def _row(cameras: int, clothes: str, mean_mm: float, fps: float) -> Row:
    errors, marks = Errors(mean_mm, 2 * mean_mm, mean_mm, 0.0), MarkErrors(0.0, 0.0, 0.0)
    outcome = Outcome(errors, marks, {"thigh": -3.0, "shank": 1.0}, -mean_mm / 10, fps, {})
    return Row(f"take-{cameras}", cameras, clothes, 10, outcome=outcome)


def test_the_table_sums_up_by_cameras_and_clothes() -> None:
    rows = [_row(4, "tight", 10.0, 8.0), _row(5, "coat", 20.0, 4.0), _row(12, "tight", 60.0, 9.0)]
    measured = [(row, outcome_figures(row.outcome)) for row in rows if row.outcome]
    sums = sums_of(measured)
    assert (sums["mean"]["mean"], sums["median"]["mean"], sums["worst"]["mean"]) == (30.0, 20.0, 60.0)
    assert (sums["worst"]["fps"], sums["worst"]["height"], sums["mean"]["bones"]) == (4.0, -6.0, 2.0)
    groups = [(cameras, clothes, len(group)) for cameras, clothes, group in groups_of(measured)]
    assert groups == [("4 to 5", "", 2), ("9 and more", "", 1), ("", "coat", 1), ("", "tight", 2)]
    console = Console(width=140, record=True)
    for table in as_tables([*rows, Row("take-9", 8, "skirt", 10, refusal="xormocap track: no")]):
        console.print(table)
    shown = " ".join(console.export_text().split())
    assert "thigh -3" in shown
    assert "take-9, 8 cameras: refused: xormocap track: no" in shown
