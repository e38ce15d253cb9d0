"""Takes tracked by real processes over real sockets."""

import csv
import json
from pathlib import Path

import av
import numpy as np
import pytest

from services.mocap.take.tables import read_joints_csv, read_poses_csv

pytestmark = pytest.mark.timeout(280)

RESULTS = {"poses.csv", "joints.csv", "motion.bvh", "actor.toml", "overlay.mp4", "run.json", "logs"}


def _report(result: Path) -> dict:
    return json.loads((result / "run.json").read_text())


def test_a_run_writes_all_results_for_its_frames(tracked: Path) -> None:
    assert {path.name for path in tracked.iterdir()} == RESULTS
    assert [path.name for path in tracked.parent.iterdir()] == ["result"]  # no temporary folders
    assert read_poses_csv(tracked / "poses.csv").frames.tolist() == list(range(14, 20))
    assert read_joints_csv(tracked / "joints.csv").frames.tolist() == list(range(14, 20))
    assert f"Frames: {6}" in (tracked / "motion.bvh").read_text()


def test_the_logs_of_all_processes_are_kept(tracked: Path) -> None:
    services = sorted(path.name.partition("-")[0] for path in (tracked / "logs").iterdir())
    assert services == ["coordinator", *["limb_worker"] * 4, "recorder", "segmentation"]
    assert not any("Traceback" in path.read_text() for path in (tracked / "logs").iterdir())


def test_the_motion_is_found(tracked: Path) -> None:
    report = _report(tracked)
    assert report["accuracy"]["frames"] == 6
    assert report["accuracy"]["mean_mm"] < 20
    assert report["accuracy"]["lost_limbs"] == []


def test_four_workers_did_the_limbs(tracked: Path) -> None:
    speed = _report(tracked)["speed"]
    assert speed["workers"] == 4
    assert speed["retries"] == 0


def test_the_overlay_plays_in_browsers(tracked: Path) -> None:
    with av.open(str(tracked / "overlay.mp4")) as video:
        stream = video.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert sum(1 for _ in video.decode(stream)) == 6


def test_without_workers_the_poses_are_the_same(
    synthetic_take: Path, tracked: Path, xormocap, tmp_path: Path
) -> None:
    out = tmp_path / "alone"
    done = xormocap(
        "track", synthetic_take, "--out", out, "--frames", "14:17", "--workers", 0, "--no-overlay"
    )
    assert done.returncode == 0, done.stderr
    assert not (out / "overlay.mp4").exists()
    with (out / "poses.csv").open() as alone, (tracked / "poses.csv").open() as together:
        assert list(csv.reader(alone)) == list(csv.reader(together))[:4]


def test_older_results_are_replaced_and_other_folders_are_not(
    synthetic_take: Path, xormocap, tmp_path: Path
) -> None:
    arguments = ("track", synthetic_take, "--frames", "0:1", "--workers", 0, "--no-overlay", "--out")
    assert xormocap(*arguments, tmp_path / "out").returncode == 0
    assert xormocap(*arguments, tmp_path / "out").returncode == 0
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    refused = xormocap(*arguments, tmp_path / "mine")
    assert refused.returncode == 2
    assert "choose another folder for --out" in refused.stderr
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["letter.txt"]


def test_the_first_frames_of_a_real_recording(shared_takes: Path, xormocap, tmp_path: Path) -> None:
    out = tmp_path / "balance"
    done = xormocap("track", shared_takes / "balance", "--out", out, "--frames", "0:3")
    assert done.returncode == 0, done.stderr
    energies_px = read_poses_csv(out / "poses.csv").energies_px
    assert energies_px.max() < 0.2 * 132263  # pixels of the actor in the first frame, over all cameras
    joints_m = read_joints_csv(out / "joints.csv").joints_take_m
    names = ["pelvis", "neck", "head_top"]
    heights_m = joints_m[:, : len(names), 2]
    assert np.all(np.diff(heights_m, axis=1) > 0.15), "the person stands upright"
    assert np.all(joints_m[:, -2:, 2] < 0.45), "on both feet"


def test_the_first_frames_of_another_body(shared_takes: Path, xormocap, tmp_path: Path) -> None:
    out = tmp_path / "studio-a"
    done = xormocap("track", shared_takes / "studio-a", "--out", out, "--frames", "0:3", "--no-overlay")
    assert done.returncode == 0, done.stderr
    assert _report(out)["accuracy"]["mean_mm"] < 50
