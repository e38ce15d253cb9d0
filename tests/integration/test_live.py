"""`xormocap live` on files that are played like cameras, one of which is unplugged on the way."""

import json
import shutil
import threading
from pathlib import Path
from typing import TypeAlias

import av
import numpy as np
import pytest

from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.energy.settings import EngineSettings
from services.mocap.motion.settings import OutputSettings
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import read_actor
from services.mocap.take.fit_record import FIT_FOLDER, OCCLUDED, FitRecord, read_occluded, write_record
from services.mocap.take.folder import open_take
from services.mocap.take.live import open_live
from services.mocap.take.marks import PARTS
from services.mocap.take.tables import read_joints_csv, read_poses_csv
from services.mocap.take.writer import write_picture
from services.mocap.types import Mask
from services.runs.live import LiveJob, fit_of_actor, live
from services.runs.progress import Progress, live_in_words

pytestmark = pytest.mark.timeout(280)

_SLOWER = 15
"""Of 15 frames a second: so that nothing has to be left out on a machine that is busy with other tests."""
_CUT_AFTER_S, _CUT_S = 5.0, 5.0
_CUT = "cam03"
Run: TypeAlias = tuple[Path, Path, list[str]]


def _slow_copy(video: Path, to: Path) -> None:
    """The same packets with other stamps."""
    with av.open(str(video)) as source, av.open(str(to), "w") as sink:
        stream = sink.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None and packet.pts is not None:
                packet.pts, packet.dts = packet.pts * _SLOWER, packet.dts * _SLOWER
                packet.stream = stream
                sink.mux(packet)


@pytest.fixture(scope="module")
def stage(synthetic_take: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with live.toml: two groups of cameras whose pictures are those of the synthetic take."""
    folder = tmp_path_factory.mktemp("live") / "stage"
    (folder / "videos").mkdir(parents=True)
    for name in ("background", "reference"):
        shutil.copytree(synthetic_take / name, folder / name)
    for name in ("calibration.toml", "actor.toml"):
        shutil.copy(synthetic_take / name, folder)
    tables = ""
    for n, video in enumerate(sorted((synthetic_take / "videos").glob("*.mp4"))):
        _slow_copy(video, folder / "videos" / video.name)
        group = "left" if n < 2 else "right"
        tables += f'[cameras.{video.stem}]\nsource = "videos/{video.name}"\ngroup = "{group}"\n'
    heading_rad = read_poses_csv(folder / "reference" / "poses.csv").poses[0, DOF_INDEX["root_heading"]]
    (folder / "live.toml").write_text(
        f'name = "stage"\nfps = {15 / _SLOWER}\nup = "z"\ncalibration = "calibration.toml"\n'
        f'background = "background"\nactor = "actor.toml"\ngrace_s = 1.5\n'
        f"facing = {np.degrees(heading_rad):.1f}\n{tables}"
    )
    _write_fit(folder)
    return folder


def _write_fit(folder: Path) -> None:
    """What a fit of the actor with these cameras would have learnt: that one camera never sees the rim of
    its picture."""
    cameras, actor = open_live(folder / "live.toml").cameras, read_actor(folder / "actor.toml")
    rim: Mask = np.ones(cameras[0].shape_px, bool)
    rim[2:-2, 2:-2] = False
    write_picture(folder / FIT_FOLDER / OCCLUDED / f"{cameras[0].name}.png", rim)
    record = FitRecord(
        actor=actor.content_hash, first_frame=0, end_frame=1, hints={}, energy_before_px=[0.0],
        projections={camera.name: camera.P_px_world.tolist() for camera in cameras},
        energy_after_px=[0.0], iou_before={}, iou_after={}, seconds={}, warnings=[],
    )  # fmt: skip
    write_record(folder / FIT_FOLDER, record)


@pytest.fixture(scope="module")
def unplugged(stage: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The results of a run in which a camera's feed was cut, its recording, and what was shown meanwhile."""
    folder = tmp_path_factory.mktemp("live-out")
    video, lines = stage / "videos" / f"{_CUT}.mp4", list[str]()
    cut = threading.Event()

    def show(progress: Progress) -> None:
        lines.append(live_in_words(progress))
        all_there = progress.telemetry is not None and progress.telemetry.stage != "waiting for clients"
        if all_there and progress.telemetry and not progress.telemetry.absent and not cut.is_set():
            cut.set()
            threading.Timer(_CUT_AFTER_S, unplug).start()

    def unplug() -> None:
        away = video.rename(video.with_suffix(".away"))
        threading.Timer(_CUT_S, lambda: away.rename(video)).start()

    job = LiveJob(
        config=stage / "live.toml",
        take=open_live(stage / "live.toml"),
        out=folder / "out",
        workers=1,
        engine=EngineSettings(),
        search=SearchSettings(),
        output=OutputSettings(smooth="one-euro"),
        segmenter="auto",
        page=None,
        record=folder / "recorded",
        keys=None,
        fit=fit_of_actor(open_live(stage / "live.toml")),
    )
    assert live(job, show=show) is not None
    assert cut.is_set()
    return folder / "out", folder / "recorded", lines


def test_every_pose_is_that_of_the_shot_that_it_names(stage: Path, unplugged: Run) -> None:
    out, _, _ = unplugged
    poses, truth = read_poses_csv(out / "poses.csv"), read_joints_csv(stage / "reference" / "joints.csv")
    shots = poses.extra["shot"].astype(int)
    assert np.array_equal(poses.frames, np.arange(len(shots)))
    assert np.all(np.diff(shots) > 0)
    np.testing.assert_allclose(poses.times_s, shots * _SLOWER / 15, atol=0.02)
    report = json.loads((out / "run.json").read_text())
    assert report["accuracy"]["frames"] == len(shots)
    assert report["accuracy"]["p95_mm"] < 40
    assert len(truth.frames) == 24


def test_every_group_of_cameras_knows_what_the_actors_fit_learnt(stage: Path, unplugged: Run) -> None:
    out, _, _ = unplugged
    logs = [path.read_text() for path in (out / "logs").glob("segmentation*")]
    assert len(logs) == 2
    assert all(f"with the fit in {stage / FIT_FOLDER}" in log for log in logs)
    cameras = open_live(stage / "live.toml").cameras
    assert read_occluded(out / FIT_FOLDER, cameras).keys() == {cameras[0].name}


def test_every_picture_is_in_a_pose_or_told_as_dropped(unplugged: Run) -> None:
    """How many are dropped depends on how busy the machine is."""
    out, _, _ = unplugged
    absent = read_poses_csv(out / "poses.csv").extra["cameras_absent"]
    live = json.loads((out / "run.json").read_text())["live"]
    assert len(absent) >= 6, "before the cut, meanwhile and afterwards"
    for camera, counts in live["drops"].items():
        unseen = absent.sum() if camera == _CUT else 0
        assert len(absent) - unseen + sum(counts.values()) == 24, camera


def test_every_frame_is_settled_once_the_next_ones_are_there(unplugged: Run) -> None:
    out, _, _ = unplugged
    report = json.loads((out / "run.json").read_text())
    assert set(report["corrected_frames_by_part"]) <= set(PARTS)  # told only where all frames are settled
    latencies_s = read_poses_csv(out / "poses.csv").extra["latency_s"]
    assert report["live"]["settled_latency_s"]["median"] > np.median(latencies_s) + 0.5 * _SLOWER / 15


def test_an_unplugged_camera_is_missed_and_comes_back(unplugged: Run) -> None:
    out, _, lines = unplugged
    absent = read_poses_csv(out / "poses.csv").extra["cameras_absent"]
    drops = json.loads((out / "run.json").read_text())["live"]["drops"]
    assert 1 in absent.tolist()
    assert absent[-1] == 0
    assert drops.pop(_CUT)["source"] >= 2
    assert max(counts["segmentation"] for counts in drops.values()) <= 2  # none, unless the machine is busy
    assert any("latency" in line for line in lines)


def test_what_was_recorded_is_a_take(unplugged: Run) -> None:
    _, recorded, _ = unplugged
    take = open_take(recorded)
    assert take.settings.frames == 24
    stamps = {
        camera.name: (recorded / "stamps" / f"{camera.name}.csv").read_text().splitlines()[1:]
        for camera in take.cameras
    }
    assert {len(lines) for lines in stamps.values()} == {24}
    empty = {name: sum(line.endswith(",") for line in lines) for name, lines in stamps.items()}
    assert empty.pop(_CUT) >= 2
    assert max(empty.values()) <= 1


def test_frames_of_the_recording_are_shots(unplugged: Run, synthetic_take: Path) -> None:
    _, recorded, _ = unplugged
    original, take = open_take(synthetic_take), open_take(recorded)
    for camera in take.cameras[:2]:  # those that were not unplugged
        for ours, theirs in zip(take.video(camera), original.video(camera), strict=True):
            assert np.abs(ours.astype(int) - theirs).mean() < 3
