"""What a recorder writes, without processes: marks, raw and smoothed motion, and the report of both."""

import hashlib
import json
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from proto.messages import Blob, Pose, TakeEnd, TakeInfo
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.rig import Rig
from services.mocap.motion.settings import OutputSettings
from services.mocap.motion.smoothing import smoothed
from services.mocap.result.frame_files import read_frame_file
from services.mocap.search.chains import LIMBS
from services.mocap.synth.walk import walk
from services.mocap.take.folder import open_take
from services.mocap.take.marks import PARTS
from services.mocap.take.quantities import marks_of
from services.mocap.take.tables import read_joints_csv, read_poses_csv, reference_joints, write_joints_csv
from services.mocap.types import Floats
from services.recorder.collection import Collection
from services.recorder.results import write_results
from services.recorder.store import Store

N, FPS, RUN = 12, 10.0, "0" * 32
RIG = Rig(np.ones((1, 3, 4)), np.array([[4, 4]], np.int32))
ACTOR = Actor(height=1.7)


@pytest.fixture(scope="module")
def truth() -> Floats:
    return walk(N, FPS, build_body(ACTOR))


@pytest.fixture(scope="module")
def noisy(truth: Floats) -> Floats:
    poses: Floats = truth + np.random.default_rng(0).normal(0, 0.01, truth.shape)
    return poses


def blob(text: str, kind: Any) -> Blob:
    content = text.encode()
    return Blob(hash=hashlib.sha256(content).hexdigest(), kind=kind, content=np.frombuffer(content, np.uint8))


def recorded(poses: Floats, **changed: dict[int, Any]) -> list[Pose]:
    """Messages of the poses; changed: fields by frame."""
    seconds = {"torso": 0.02, "head": 0.01, "limbs": 0.05, "frame": 0.1}
    counts = {"passes": 1, "evaluations": 7, "workers": 0, "retries": 0}
    same = {"take": "walk", "run": RUN, "energy_px": 100.0, "backend": "cpu", "worker_backends": {}, **counts}
    messages = []
    for frame, pose in enumerate(poses):
        own = {name: values[frame] for name, values in changed.items() if frame in values}
        fields = {"frame": frame, "time_s": frame / FPS, "seconds": seconds, "pose": pose, **same, **own}
        messages.append(Pose(**fields))
    return messages


def collected(store: Store, messages: list[Pose], *, both_ways: bool = False) -> Collection:
    """What a recorder has at the end of a run that has these first poses and was not settled."""
    actor, rig = blob(ACTOR.to_toml(), "actor"), blob(RIG.to_json(), "rig")
    info = TakeInfo(
        take="walk", run=RUN, plan="0" * 64, shards=1, fps=FPS, first_frame=0, end_frame=N,
        actor=actor.hash, rig=rig.hash, backend="cpu",
        backend_reason="asked for", threads=1, search={"both_ways": both_ways},
    )  # fmt: skip
    collection = Collection(store)
    for message in (info, actor, rig, *messages, TakeEnd(take="walk", run=RUN, first_frame=0, end_frame=N)):
        collection.add(message)
    assert collection.complete
    return collection


def results(folder: Path, take: Path, messages: list[Pose], output: OutputSettings) -> dict[str, Any]:
    """Write into folder; returns run.json."""
    store = Store(folder.with_name("out.partial"))
    collection = collected(store, messages)
    assert write_results(
        folder, open_take(take), collection, output, overlay=False, report=False, hurry=lambda: False
    )
    store.close(remove=True)
    assert not folder.with_name("out.partial").exists()
    report: dict[str, Any] = json.loads((folder / "run.json").read_text())
    return report


@pytest.fixture
def take(small_take, truth: Floats) -> Path:
    folder: Path = small_take(frames=N, source="silhouettes")
    joints_m = reference_joints(truth, build_body(ACTOR).offsets_m)
    frames = np.arange(N, dtype=np.int32)
    write_joints_csv(folder / "reference" / "joints.csv", frames, frames / FPS, joints_m)
    return folder


def test_what_was_tracked_is_kept_beside_what_is_smoothed(take: Path, noisy: Floats, tmp_path: Path) -> None:
    output = OutputSettings(smooth="rts", cutoff_hz=1.5)
    report = results(tmp_path / "out", take, recorded(noisy), output)
    raw, smooth = (read_poses_csv(tmp_path / "out" / name) for name in ("poses.csv", "poses_smooth.csv"))
    np.testing.assert_allclose(raw.poses, noisy, atol=1e-6)
    expected = smoothed(noisy, FPS, output)
    np.testing.assert_allclose(smooth.poses, expected, atol=1e-6)
    joints_m = reference_joints(expected, build_body(ACTOR).offsets_m)
    np.testing.assert_allclose(
        read_joints_csv(tmp_path / "out" / "joints.csv").joints_take_m, joints_m, atol=1e-5
    )
    assert report["output"]["smooth"] == "rts"
    assert report["output"]["cutoff_hz"] == 1.5
    motion = {"motion.bvh", "motion.glb", "motion.trc", "motion.c3d", "angles.csv"}
    assert set(report["output"]["smoothed"]) == {"poses_smooth.csv", "joints.csv"} | motion
    assert motion <= {file.name for file in (tmp_path / "out").iterdir()}
    assert report["accuracy"]["mean_mm"] != report["accuracy_before_smoothing"]["mean_mm"]
    assert report["accuracy_before_smoothing"]["mean_mm"] > 1


def test_poses_that_were_to_be_settled_are_not_the_whole_result(
    take: Path, noisy: Floats, tmp_path: Path
) -> None:
    """A stop on the way back: older results stay, and the journal, from which the run goes on."""
    out = tmp_path / "out"
    results(out, take, recorded(noisy), OutputSettings())
    before = (out / "run.json").read_bytes()
    store = Store(out.with_name("out.partial"))
    stopped = collected(store, recorded(noisy), both_ways=True)
    opened, quick = open_take(take), {"overlay": False, "report": False, "hurry": lambda: False}
    assert not write_results(out, opened, stopped, OutputSettings(), **quick)
    store.close(remove=False)
    assert (out / "run.json").read_bytes() == before
    assert (out.with_name("out.partial") / "run.json").exists()
    again = Store(out.with_name("out.partial"))
    assert len(again.first.frames) == N
    again.close(remove=True)


def test_without_smoothing_there_is_one_motion(take: Path, noisy: Floats, tmp_path: Path) -> None:
    report = results(tmp_path / "out", take, recorded(noisy), OutputSettings(smooth="none"))
    assert not (tmp_path / "out" / "poses_smooth.csv").exists()
    assert report["output"] == {"smooth": "none"}
    assert "accuracy_before_smoothing" not in report
    joints_m = reference_joints(noisy, build_body(ACTOR).offsets_m)
    np.testing.assert_allclose(
        read_joints_csv(tmp_path / "out" / "joints.csv").joints_take_m, joints_m, atol=1e-5
    )


def test_energies_by_part_and_camera_are_written_where_all_were_counted(
    take: Path, truth: Floats, tmp_path: Path
) -> None:
    cameras = [camera.name for camera in open_take(take).cameras]
    part_px = [[10.0 * k + frame for k in range(len(PARTS))] for frame in range(N)]
    iou = [[0.9 - 0.01 * frame] * len(cameras) for frame in range(N)]
    measured: dict[int, dict[str, list[float]]] = {
        frame: {"part_px": part_px[frame], "iou": iou[frame]} for frame in range(N)
    }
    results(tmp_path / "out", take, recorded(truth, measured=measured), OutputSettings())
    path = tmp_path / "out" / "energies.csv"
    parts = [f"energy_{part}_px" for part in PARTS]
    assert path.read_text().splitlines()[0].split(",") == ["frame", *parts, *(f"iou_{c}" for c in cameras)]
    frames, found = read_frame_file(path)
    assert (frames.tolist(), list(found["part_px"]), list(found["iou"])) == ([*range(N)], [*PARTS], cameras)
    np.testing.assert_array_equal(np.transpose(list(found["part_px"].values())), part_px)
    np.testing.assert_allclose(np.transpose(list(found["iou"].values())), iou, atol=5e-5)
    for n, lacking in enumerate(
        ({"part_px": part_px[3]}, {**measured[3], "iou": [0.9]}, {**measured[3], "iou": [2.0] * len(cameras)})
    ):
        results(
            tmp_path / f"other{n}", take, recorded(truth, measured={**measured, 3: lacking}), OutputSettings()
        )
        assert not (tmp_path / f"other{n}" / "energies.csv").exists()


def test_marks_reach_the_table_and_the_report(take: Path, truth: Floats, tmp_path: Path) -> None:
    wrong = truth.copy()
    arm = [LIMBS["left_arm"].dofs[i] for i in (0, 1, 3)]
    wrong[5:7, arm] += 0.5
    confidence = {frame: {"torso": 0.9, "left_arm": 0.05 if frame in (5, 6) else 0.8} for frame in range(N)}
    messages = recorded(wrong, distrusted={5: ["left_arm"], 6: ["left_arm"]}, confidence=confidence)
    report = results(tmp_path / "out", take, messages, OutputSettings(smooth="rts"))
    marks = read_poses_csv(tmp_path / "out" / "poses.csv").marks
    assert marks is not None
    assert marks.distrusted_by_part["left_arm"] == marks.distrusted_frames == 2
    np.testing.assert_allclose(marks.confidence[5, :3], [0.9, np.nan, 0.05])
    trust = report["trust"]
    assert trust["distrusted_frames"] == trust["distrusted_frames_by_part"]["left_arm"] == 2
    assert sum(trust["distrusted_frames_by_part"].values()) == 2
    assert trust["lowest_confidence"] == {"torso": 0.9, "left_arm": 0.05}


def test_a_report_needs_no_library_under_its_name(
    take: Path, truth: Floats, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def version_of(library: str) -> str:
        if library != "xormocap":
            raise PackageNotFoundError(library)
        return "1"

    monkeypatch.setattr("services.recorder.run_report.version", version_of)
    versions = results(tmp_path / "out", take, recorded(truth), OutputSettings())["versions"]
    assert versions["xormocap"] == "1"
    assert versions["opencv-contrib-python-headless"] == "not installed under this name"


def test_nobody_judged() -> None:
    marks = marks_of(recorded(np.zeros((2, N_DOF))))
    assert np.isnan(marks.confidence).all()
    assert not marks.distrusted.any()


def test_the_critical_path_is_told_where_every_limb_is(take: Path, truth: Floats, tmp_path: Path) -> None:
    plain = results(tmp_path / "plain", take, recorded(truth), OutputSettings())
    assert "critical_path_s" not in plain["speed"]
    assert plain["speed"]["frames_per_s"] == pytest.approx(10)
    limbs = [{"left_arm": 0.01, "right_arm": 0.02, "left_leg": 0.005, "right_leg": 0.001}] * N
    limbs[3] = {**limbs[3], "left_leg": 0.13}
    stages = {"torso": 0.02, "head": 0.01, "limbs": 0.05, "frame": 0.1}
    seconds = {frame: {**stages, **limbs[frame]} for frame in range(N)}
    speed = results(tmp_path / "limbs", take, recorded(truth, seconds=seconds), OutputSettings())["speed"]
    assert speed["critical_path_s"] == pytest.approx(0.02 + 0.01 + (0.02 * (N - 2) + 0.13) / (N - 1))
    assert speed["mean_s"]["left_leg"] > speed["median_s"]["left_leg"] == pytest.approx(0.005)
