"""Takes tracked by real processes over real sockets."""

import csv
import json
import os
import re
import shutil
from pathlib import Path

import av
import numpy as np
import pytest
from busy import BUSY, ONE_WAY, SHORT, SMALL_GRIDS

from services.mocap.camera.calibration import read_calibration, write_calibration
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import read_actor
from services.mocap.take.fit_record import read_record
from services.mocap.take.folder import open_take
from services.mocap.take.layout import CALIBRATION, SETTINGS, background_video_path, video_path
from services.mocap.take.tables import read_joints_csv, read_poses_csv

pytestmark = pytest.mark.timeout(280)

_EXACT = ("--set", "detail_px=0")
RESULTS = {
    *("poses.csv", "poses_smooth.csv", "joints.csv", "angles.csv"),
    *("timings.csv", "energies.csv", "report.html"),
    *("motion.bvh", "motion.glb", "motion.trc", "motion.c3d"),
    *("actor.toml", "overlay.mp4", "run.json", "logs"),
}


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


def test_the_report_says_what_evaluated_the_energy(tracked: Path) -> None:
    settings = _report(tracked)["settings"]
    assert settings["threads"] == 1
    assert SearchSettings.model_validate(settings["search"]) == SearchSettings(search_limbs="always")
    assert settings["backend_reason"]
    assert settings["frames_by_backend"] == {settings["backend"]: 6}
    assert set(settings["worker_limbs_by_backend"]) == {settings["backend"]}
    assert settings["worker_limbs_by_backend"][settings["backend"]] >= 6 * 4
    told = f" INFO {settings['backend']} backend: {settings['backend_reason']}\n"
    logs = [path.read_text() for path in (tracked / "logs").iterdir() if "segm" not in path.name]
    assert sum(told in text for text in logs) == 1 + 4


def test_the_overlay_plays_in_browsers(tracked: Path) -> None:
    with av.open(str(tracked / "overlay.mp4")) as video:
        stream = video.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert sum(1 for _ in video.decode(stream)) == 6


@pytest.mark.usefixtures("no_report")
def test_without_workers_the_poses_are_the_same(
    synthetic_take: Path, tracked: Path, xormocap, tmp_path: Path
) -> None:
    out = tmp_path / "alone"
    done = xormocap(
        "track", synthetic_take, "--out", out, "--frames", "14:20", "--workers", 0, "--no-overlay", *BUSY
    )
    assert done.returncode == 0, done.stderr
    assert not (out / "overlay.mp4").exists()
    with (out / "poses.csv").open() as alone, (tracked / "poses.csv").open() as together:
        assert list(csv.reader(alone)) == list(csv.reader(together))


@pytest.mark.usefixtures("no_report")
def test_what_is_chosen_reaches_every_process(known_take: Path, xormocap, tmp_path: Path) -> None:
    out, file = tmp_path / "out", tmp_path / "search.toml"
    file.write_text("max_passes = 1\ndetail_px = 2\ncamera_weights = [1, 1, 1, 1, 0.5]\n")
    energy = ("--backend", "cpu", "--threads", "2")
    search = (
        "--search",
        "paper",
        "--settings",
        file,
        "--set",
        "detail_px=0",
        "--set",
        "arm_grid=[3, 3, 1, 3]",
    )
    common = ("--workers", "1", "--frames", "0:1", "--no-overlay", "--no-check")
    smoothing = ("--smooth", "one-euro", "--cutoff-hz", "2.5")
    done = xormocap("track", known_take, "--out", out, *common, *energy, *search, *smoothing)
    assert done.returncode == 0, done.stderr
    settings, output = _report(out)["settings"], _report(out)["output"]
    assert (output["smooth"], output["cutoff_hz"]) == ("one-euro", 2.5)
    chosen = {name: settings[name] for name in ("backend", "backend_reason", "threads")}
    assert chosen == {"backend": "cpu", "backend_reason": "asked for", "threads": 2}
    assert SearchSettings.model_validate(settings["search"]) == SearchSettings(
        method="paper",
        body="paper",
        max_passes=1,
        detail_px=0,
        arm_grid=(3, 3, 1, 3),
        camera_weights=(1, 1, 1, 1, 0.5),
        colour=0,
    )
    assert settings["worker_limbs_by_backend"]["cpu"] > 0
    logs = [(out / "logs" / f"{name}.log").read_text() for name in ("coordinator-0", "limb_worker-1")]
    assert all("cpu backend: asked for" in text for text in logs)


@pytest.mark.usefixtures("no_report")
def test_the_gpus_way_finds_the_poses_of_the_cpus(exact_take: Path, xormocap, tmp_path: Path) -> None:
    common = ("--workers", "1", "--frames", "0:2", *_EXACT, *BUSY, *SMALL_GRIDS, *SHORT)
    poses = {}
    for backend in ("cpu", "gl"):
        out = tmp_path / backend
        done = xormocap("track", exact_take, "--out", out, "--backend", backend, *common)
        if "cannot be opened" in done.stderr and os.environ.get("XORMOCAP_REQUIRE_GL") != "1":
            pytest.skip(done.stderr)
        assert done.returncode == 0, done.stderr
        assert _report(out)["settings"]["frames_by_backend"] == {backend: 2}
        assert set(_report(out)["settings"]["worker_limbs_by_backend"]) == {backend}
        poses[backend] = (out / "poses.csv").read_text()
    assert poses["gl"] == poses["cpu"]


@pytest.mark.parametrize("backend", ["gl", "paper"])
def test_a_backend_that_cannot_run_here_is_refused_in_one_sentence(
    synthetic_take: Path, xormocap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, backend: str
) -> None:
    monkeypatch.setenv("GLCONTEXT_LINUX_LIBEGL", "libEGL-that-is-not-here.so")
    refused = xormocap("track", synthetic_take, "--out", tmp_path / "out", "--backend", backend, *SHORT)
    assert refused.returncode == 2
    (sentence,) = (line for line in refused.stderr.splitlines() if "--backend" in line)
    assert sentence.startswith(f"--backend {backend}: OpenGL 4.3 on EGL cannot be opened: ")
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("no_report")
def test_without_opengl_auto_computes_on_the_cpu(
    exact_take: Path, xormocap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GLCONTEXT_LINUX_LIBEGL", "libEGL-that-is-not-here.so")
    arguments = ("--workers", 0, "--frames", "0:1", *SHORT, "--out", tmp_path / "out")
    done = xormocap("track", exact_take, *arguments)
    assert done.returncode == 0, done.stderr
    settings = _report(tmp_path / "out")["settings"]
    assert settings["backend"] == "cpu"
    assert settings["backend_reason"].startswith("no OpenGL that can be used: ")
    assert settings["worker_limbs_by_backend"] == {}


@pytest.mark.usefixtures("no_report")
def test_older_results_are_replaced_and_other_folders_are_not(
    exact_take: Path, xormocap, tmp_path: Path
) -> None:
    arguments = ("track", exact_take, "--frames", "0:1", "--workers", 0, *SHORT, "--out")
    assert xormocap(*arguments, tmp_path / "out").returncode == 0
    assert xormocap(*arguments, tmp_path / "out").returncode == 0
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    refused = xormocap(*arguments, tmp_path / "mine")
    assert refused.returncode == 2
    assert "choose another folder for --out" in refused.stderr
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["letter.txt"]
    (tmp_path / "session").mkdir()
    shutil.copy(exact_take / "calibration.toml", tmp_path / "session")  # a result has such a file, too
    refused = xormocap(*arguments, tmp_path / "session")
    assert refused.returncode == 2
    assert "contains other files than results (calibration.toml)" in refused.stderr
    longer = [*arguments[:3], "0:2", *arguments[4:]]
    assert xormocap(*longer, tmp_path / "out").returncode == 0
    said = xormocap(*arguments, tmp_path / "out").stderr
    assert "results of 2 frames are there, which those of 1 will replace" in " ".join(said.split())


def test_the_first_frames_of_a_real_recording(shared_takes: Path, xormocap, tmp_path: Path) -> None:
    out = tmp_path / "balance"
    done = xormocap("track", shared_takes / "balance", "--out", out, "--frames", "0:3", "--no-fit", *ONE_WAY)
    assert done.returncode == 0, done.stderr
    energies_px = read_poses_csv(out / "poses.csv").energies_px
    assert energies_px.max() < 0.2 * 132263  # pixels of the actor in the first frame, over all cameras
    joints_m = read_joints_csv(out / "joints.csv").joints_take_m
    names = ["pelvis", "neck", "head_top"]
    heights_m = joints_m[:, : len(names), 2]
    assert np.all(np.diff(heights_m, axis=1) > 0.15), "the person stands upright"
    assert np.all(joints_m[:, -2:, 2] < 0.45), "on both feet"


def test_the_first_frames_of_another_body(shared_takes: Path, xormocap, tmp_path: Path) -> None:
    """Fitted to three frames of five cameras, too few for a second fit to the whole take."""
    take, out = tmp_path / "studio-a", tmp_path / "out"
    shutil.copytree(shared_takes / "studio-a", take, copy_function=os.symlink)
    cameras = read_calibration(take / CALIBRATION, "z")
    (take / CALIBRATION).unlink()
    write_calibration(take / CALIBRATION, (*cameras[::2], cameras[-1]), "z")
    for camera in cameras[1:-1:2]:
        video_path(take, camera.name).unlink()
        background_video_path(take, camera.name).unlink()
    settings = (take / SETTINGS).read_text()
    (take / SETTINGS).unlink()
    shorter = re.sub(r"(?m)^init_frames = .*$", "init_frames = 3", settings)
    (take / SETTINGS).write_text(shorter)
    assert open_take(take).settings.init_frames == 3
    done = xormocap("track", take, "--out", out, "--frames", "0:3", *SHORT)
    assert done.returncode == 0, done.stderr
    report = _report(out)
    assert report["accuracy"]["mean_mm"] < 30
    assert np.mean(report["fit"]["energy_after_px"]) < 0.9 * np.mean(report["fit"]["energy_before_px"])
    assert abs(report["actor"]["height"] - 1.78) < 0.02
    assert read_record(out / "fit") is not None
    assert read_actor(out / "fit" / "actor.toml") == read_actor(out / "actor.toml")
    assert "the body is fitted for this run; xormocap fit" in done.stdout
    assert "fitted again" not in done.stdout, "three frames are too few"
    assert "poses of 3 frames are known" in next((out / "logs").glob("coordinator*")).read_text()
    assert not (take / "actor.toml").exists()
