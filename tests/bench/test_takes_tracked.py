"""What table2 and accuracy make of tracked takes; the tracking itself is stood in for."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from bench import accuracy, command, table2, takes
from bench.__main__ import app
from bench.__main__ import app as bench_app
from bench.command import Run
from bench.degradations import trimaps_of
from services.mocap.body.actor import Actor
from services.mocap.body.kinematics import N_DOF
from services.mocap.errors import UserError
from services.mocap.synth.take import write_synthetic_take
from services.mocap.take.folder import open_take
from services.mocap.take.marks import PARTS, Marks
from services.mocap.take.tables import PoseTable, read_poses_csv
from services.mocap.types import Floats

N = 3
TRACK = "track"


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic take whose silhouettes are the exact ones, so that nothing has to be segmented."""
    folder: Path = tmp_path_factory.mktemp("takes") / "walk"
    write_synthetic_take(folder, n_frames=N, n_cameras=4, height_m=1.75)
    shutil.move(folder / "reference" / "silhouettes", folder / "silhouettes")
    shutil.rmtree(folder / "videos")
    return folder


def run_of(poses: Floats, lost: list[int], marked: list[int], first: int = 0, **speed: Any) -> Run:
    frames = np.arange(first, first + len(poses), dtype=np.int32)
    distrusted = np.isin(frames, marked)[:, None] & (np.array(PARTS) == "left_arm")
    marks = Marks(np.full((len(poses), len(PARTS)), 0.5), distrusted)
    report = {
        "speed": {"frames_per_s": 4.0, "evaluations_per_frame": 500.0, "mean_s": {"torso": 0.1}, **speed},
        "accuracy": {
            "frames": len(poses),
            "mean_mm": 9.0,
            "median_mm": 7.0,
            "p95_mm": 21.0,
            "lost_limbs": [{"frame": frame, "joint": "left_wrist"} for frame in lost for _ in range(2)],
            "frames_with_lost_limbs": len(lost),
        },
        "trust": {"distrusted_frames": len(marked)},
    }
    table = PoseTable(frames, frames / 15, poses, np.zeros(len(poses)), marks=marks)
    return Run(report, Actor(height=1.75), table)


@pytest.fixture
def truth(take: Path) -> Floats:
    return read_poses_csv(take / "reference" / "poses.csv").poses


def test_a_wrong_frame_without_a_mark_is_a_silent_one(truth: Floats) -> None:
    assert run_of(truth, lost=[0, 2], marked=[2]).silently_wrong_frames == 1
    assert run_of(truth, lost=[0, 2], marked=[0, 1, 2]).silently_wrong_frames == 0


def test_the_very_body_in_the_very_pose_overlaps_fully(take: Path, truth: Floats, tmp_path: Path) -> None:
    opened = open_take(take)
    silhouettes = trimaps_of(opened, tmp_path)
    iou = accuracy.overlaps(opened, silhouettes, run_of(truth, [], []))
    assert iou.shape == (N, 4)
    assert iou.min() > 0.97, "the studio's own drawing rounds otherwise"
    beside = truth + 0.1 * np.eye(N_DOF)[0]
    assert accuracy.overlaps(opened, silhouettes, run_of(beside, [], [])).max() < iou.min()


def test_overlaps_are_those_of_the_frames_that_were_tracked(
    take: Path, truth: Floats, tmp_path: Path
) -> None:
    opened = open_take(take)
    silhouettes = trimaps_of(opened, tmp_path)
    whole = accuracy.overlaps(opened, silhouettes, run_of(truth, [], []))
    last = accuracy.overlaps(opened, silhouettes, run_of(truth[1:], [], [], first=1))
    np.testing.assert_array_equal(last, whole[1:])


@pytest.fixture
def tracked(monkeypatch: pytest.MonkeyPatch, truth: Floats) -> list[tuple[Any, ...]]:
    """Stands in for tracking; returns the calls."""
    calls: list[tuple[Any, ...]] = []

    def track(folder: Path, _: Path, frames: str, workers: int, options: tuple[str, ...]) -> Run:
        calls.append((open_take(folder), frames, workers, options))
        if "--fails" in options or "paper" in options:
            raise UserError("xormocap track: No such option: --search")
        fps = 0.5 if "plain" in options else 10.0
        run = run_of(truth, [0], [0], frames_per_s=fps, critical_path_s=0.05)
        run.report["accuracy"]["mean_mm"] = 9.0 if len(calls) == 1 else 12.0
        return run

    for module in (accuracy, table2):
        monkeypatch.setattr(module, TRACK, track)
    return calls


def test_accuracy_tells_of_a_take_and_its_degradations(take: Path, tracked, tmp_path: Path) -> None:
    written = tmp_path / "rows.json"
    done = CliRunner().invoke(app, ["accuracy", str(take), "--noise", "--track", "--set max_passes=1",
                                    "--json", str(written)])  # fmt: skip
    assert done.exit_code == 0, done.output
    plain, half, side, noise = json.loads(written.read_text())["rows"]
    assert [row["variant"] for row in (plain, half, side, noise)] == [
        "as it is",
        "every other camera",
        "the first half of the cameras",
        "5 % of the boundary eaten, 1 % specks",
    ]
    assert (plain["growth_percent"], half["growth_percent"]) == (None, pytest.approx(100 / 3))
    assert plain["lost_percent"] == pytest.approx(100 / 3)
    assert (plain["silent_frames"], plain["distrusted_frames"]) == (0, 1)
    assert plain["iou"] > 0.97
    assert half["iou"] == side["iou"] == noise["iou"] == plain["iou"], (
        "judged by the silhouettes before they were harder"
    )
    assert [len(opened.cameras) for opened, *_ in tracked] == [4, 2, 2, 4]
    assert all(options == ("--set", "max_passes=1") for *_, options in tracked)


@pytest.mark.usefixtures("tracked")
def test_a_take_that_cannot_be_tracked_is_left_out(take: Path) -> None:
    done = CliRunner().invoke(app, ["accuracy", str(take), "nowhere", "--track", "--fails"])
    assert done.exit_code == 1
    assert f"{take}: is left out: xormocap track: No such option" in done.output
    assert "nowhere: is left out: nowhere: is no folder and no motion" in done.output


def test_table2_sets_the_ways_beside_the_papers(
    take: Path, tracked, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table2, "take_folder", {"dance": take, "walk": take}.__getitem__)
    written = tmp_path / "rows.json"
    done = CliRunner().invoke(app, ["table2", "dance", "--json", str(written)])
    assert done.exit_code == 0, done.output
    assert "windows, pre-rendering, one process, dance: is left out: xormocap track: No" in done.output
    plain, thinned, alone, five = json.loads(written.read_text())["rows"]
    assert (plain["paper_s"], alone["paper_s"]) == (14.1, None)
    assert (plain["seconds_per_frame"], five["seconds_per_frame"]) == (2.0, 0.1)
    assert (plain["times_plain"], five["times_plain"]) == (1.0, pytest.approx(20))
    assert thinned["way"] == "plain XOR of thinned meshes"
    assert (alone["processes"], five["processes"]) == (1, 5)
    assert (alone["critical_path_s"], five["critical_path_s"]) == (0.05, None)
    assert "sequence B" in done.output
    assert [frames for _, frames, *_ in tracked] == [f"0:{N}"] * 6


def test_slow_ways_solve_fewer_frames_unless_told_otherwise(take: Path, tracked, monkeypatch) -> None:
    monkeypatch.setattr(table2, "take_folder", {"dance": take, "walk": take}.__getitem__)
    slow = table2.Way("slow", (), 0, {}, most_frames=2)
    quick = table2.Way("quick", (), 0, {}, most_frames=None)
    list(table2.measure("walk", "1:", [slow, quick], all_frames=False))
    list(table2.measure("walk", ":", [slow], all_frames=True))
    assert [frames for _, frames, *_ in tracked] == ["1:3", "1:3", "0:3"]
    list(table2.measure("walk", ":", [slow], all_frames=False))
    assert tracked[-1][1] == "0:2"


def test_the_papers_numbers() -> None:
    said = {way.name: (way.paper_s["A"], way.paper_s["B"]) for way in table2.WAYS if way.paper_s}
    assert list(said.values()) == [(7.98, 14.1), (3.30, 10.1), (1.16, 1.76)]
    assert {way.workers for way in table2.WAYS} == {0, 4}


def test_a_synthetic_take_is_made_once_and_again_when_what_draws_it_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[tuple[object, ...]] = []

    def synth(*arguments: object) -> None:
        made.append(arguments)
        folder = Path(str(arguments[1]))
        folder.mkdir()
        settings = 'name = "x"\nfps = 15\nunits = "m"\nup = "z"\nframes = 2\nactor_height = 1.75\n'
        (folder / "take.toml").write_text(settings)

    monkeypatch.setenv("XORMOCAP_CACHE", str(tmp_path))
    monkeypatch.setattr(takes, "xormocap", synth)
    first = takes.take_folder("dance")
    assert takes.take_folder("dance") == first
    assert len(made) == 1
    assert made[0][2:] == ("--motion", "dance", "--frames", 400)
    assert "height = 1.75" in (first / "actor.toml").read_text()
    monkeypatch.setattr(takes, "_sources", lambda: "changed")
    assert takes.take_folder("dance") != first
    assert not first.exists(), "what nobody asks for any more is not kept"


def test_the_commands_own_sentence_comes_through(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"^xormocap track: .*nowhere: is not a folder"):
        command.xormocap("track", tmp_path / "nowhere")


def test_the_help_names_both_tables() -> None:
    told = CliRunner().invoke(bench_app, ["--help"])
    assert told.exit_code == 0
    assert "table2" in told.stdout
    assert "accuracy" in told.stdout
