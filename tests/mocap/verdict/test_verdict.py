"""The verdict: its level, which parts are doubtful when, and the causes that a result's files tell."""

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from services.mocap.errors import TakeError
from services.mocap.result.frame_files import write_frame_file
from services.mocap.result.result import load_result
from services.mocap.take.marks import PARTS
from services.mocap.take.tables import read_poses_csv, write_poses_csv
from services.mocap.verdict.judging import level_of, lost_limbs_of, verdict_of
from services.mocap.verdict.verdict import Cause, Verdict, frame_in_words, spans_in_words, spans_of

FRAMES = np.arange(100, 116, dtype=np.int32)
CAMERAS = ("cam01", "cam02", "cam03", "cam04")


@pytest.fixture
def folder(bare_result: Path, tmp_path: Path) -> Path:
    """16 frames, in one of which the left arm is doubtful."""
    return Path(shutil.copytree(bare_result, tmp_path / "mine"))


def judged(folder: Path, iou: dict[str, np.ndarray] | None = None, **run: Any) -> Verdict:
    """The verdict on a result with these overlaps, 0.9 by default, and these entries of run.json."""
    known = {camera: np.full(16, 0.9) for camera in CAMERAS} | (iou or {})
    part_px = {part: np.full(16, 50.0) for part in PARTS}
    write_frame_file(folder / "energies.csv", FRAMES, {"part_px": part_px, "iou": known})
    (folder / "run.json").write_text(json.dumps({"take": {"name": "walk", "folder": "my-take"}} | run))
    return verdict_of(load_result(folder))


def mark(folder: Path, **parts: int) -> None:
    """Mark parts in so many of the 16 frames, from the first on, and nothing else."""
    tracked = read_poses_csv(folder / "poses.csv")
    assert tracked.marks is not None
    marks = replace(tracked.marks, distrusted=marked(**parts)[:16])
    write_poses_csv(folder / "poses.csv", replace(tracked, marks=marks))


def test_doubtful_parts_and_their_frames_are_named(folder: Path) -> None:
    verdict = judged(folder)
    assert verdict.headline == "usable with gaps: 1 of 16 frames has doubtful parts"
    assert verdict.doubts_in_words == "left arm in 1 (frame 103)"
    assert (verdict.doubtful_frames, verdict.lost_frames, verdict.causes) == (1, 0, ())
    assert verdict.typical_iou == pytest.approx(0.9)


def test_a_result_without_doubtful_parts_says_why_it_is_not_good(folder: Path) -> None:
    mark(folder)
    sure = "no part is doubtful in any of 16 frames"
    assert judged(folder).headline == f"good: {sure}"
    verdict = judged(folder, {"cam02": np.full(16, 0.6)})
    assert verdict.headline == f"usable with gaps: {sure}, but a cause of errors was found"


def test_it_goes_through_json_unchanged(folder: Path) -> None:
    verdict = judged(folder, {"cam02": np.full(16, 0.6)})
    assert verdict.causes
    assert Verdict.model_validate_json(verdict.model_dump_json()) == verdict


def marked(**parts: int) -> np.ndarray:
    """(20, 6): in so many frames, from the first on, a part is doubtful."""
    distrusted = np.zeros((20, 6), bool)
    for part, n in parts.items():
        distrusted[:n, PARTS.index(part)] = True
    return distrusted


EVERYTHING = dict.fromkeys(PARTS, 4)


@pytest.mark.parametrize(
    ("doubtful", "confidence", "lost_limbs"),
    [
        ({}, 0.0, 0.0),
        ({"left_leg": 20}, 0.6, 0.1),
        ({"left_leg": 8}, np.nan, 0.1),
        ({"left_leg": 10, "right_arm": 10}, 0.2, 0.2),
        ({"head": 20}, 0.0, 0.0),
        (EVERYTHING, 0.0, 0.0),
        (dict.fromkeys(PARTS, 20), 0.0, 0.0),
        (EVERYTHING | {"left_leg": 12}, 0.5, 0.0625),
    ],
)
def test_limbs_that_may_be_lost(doubtful: dict[str, int], confidence: float, lost_limbs: float) -> None:
    """Doubtful parts have that confidence; where the whole body is doubtful, no limb counts."""
    distrusted = marked(**doubtful)
    confident = np.where(distrusted, confidence, 0.85)  # results of earlier versions have less without a mark
    assert lost_limbs_of(distrusted, confident) == pytest.approx(lost_limbs)


@pytest.mark.parametrize(
    ("doubtful", "lost_limbs", "iou", "level"),
    [
        ({}, 0.0, 0.9, "good"),
        ({"left_leg": 1}, 0.01, 0.9, "usable with gaps"),
        ({"left_leg": 20}, 0.079, 0.9, "usable with gaps"),
        ({"left_leg": 20}, 0.081, 0.9, "not usable"),
        ({"torso": 4}, 0.0, 0.9, "usable with gaps"),
        ({"torso": 5}, 0.0, 0.9, "not usable"),
        ({}, 0.0, 0.59, "not usable"),
    ],
)
def test_the_level_follows_from_marks_and_overlap(
    doubtful: dict[str, int], lost_limbs: float, iou: float, level: str
) -> None:
    assert level_of(marked(**doubtful), lost_limbs, {"cam01": np.full(20, iou)}) == level


def test_results_that_are_not_usable_have_a_cause(folder: Path) -> None:
    (cause,) = judged(folder, dict.fromkeys(CAMERAS, np.full(16, 0.59))).causes
    assert "overlap little in most cameras" in cause.what, "a cause that is known stands alone"
    mark(folder, **dict.fromkeys(PARTS, 16))
    (cause,) = judged(folder).causes
    assert cause.level == judged(folder).level == "not usable"
    assert "look at overlay.mp4" in cause.remedy


def test_limbs_that_are_often_doubtful_have_a_cause_if_nothing_else_has(folder: Path) -> None:
    mark(folder, left_arm=5, right_leg=4)
    (cause,) = judged(folder).causes
    assert cause.what.startswith("left arm: doubtful in more than a quarter of the frames")
    assert cause.kind == "cause"
    (other,) = judged(folder, {"cam02": np.full(16, 0.68)}).causes
    assert other.what.startswith("cam02 agrees less")


LINE, FEW = "all cameras look along nearly one line", "only 3 cameras see the actor"
ARM, ALL = "left arm: doubtful in more than a quarter of the frames", "no camera, no moment and no measure"


@pytest.mark.parametrize(
    ("azimuths_deg", "doubtful", "causes"),
    [
        ((31, 50, -149, -129), {"left_arm": 16}, [LINE]),
        ((31, 50, -149, -129), {"left_arm": 1}, []),
        ((0, 15, 30), {"left_arm": 16}, [LINE]),
        ((0, 15, 30), {"torso": 16}, [LINE]),
        ((0, 90, 180), {"left_arm": 16}, [ARM, FEW]),
        ((0, 90, 180), {"left_arm": 1}, []),
        ((0, 90, 180), {"torso": 16}, [ALL, FEW]),
        ((0, 90, 180, 270), {"left_arm": 16}, [ARM]),
        ((0, 60, 120, 180), {"left_arm": 16}, [ARM]),
    ],
)
def test_how_cameras_stand_is_a_cause_of_what_is_often_doubtful(
    folder: Path, azimuths_deg: tuple[int, ...], doubtful: dict[str, int], causes: list[str]
) -> None:
    projections = {}
    for number, azimuth_rad in enumerate(np.radians(azimuths_deg)):
        ahead = np.array([-np.cos(azimuth_rad), -np.sin(azimuth_rad), -0.2])
        projections[f"cam{number}"] = [[1, 0, 0, 0], [0, 1, 0, 0], [*ahead / np.linalg.norm(ahead), 4.0]]
    mark(folder, **doubtful)
    found = judged(folder, fit={"projections": projections}).causes
    assert [cause.what[: len(expected)] for cause, expected in zip(found, causes, strict=True)] == causes


def test_few_frames_that_are_not_lost_do_not_hide_what_to_look_at(folder: Path) -> None:
    tracked = read_poses_csv(folder / "poses.csv")
    assert tracked.marks is not None
    distrusted = np.ones((16, len(PARTS)), bool)
    distrusted[:4] = False
    distrusted[:2, PARTS.index("left_arm")] = True
    write_poses_csv(
        folder / "poses.csv", replace(tracked, marks=replace(tracked.marks, distrusted=distrusted))
    )
    advice = Cause(what="cam02: its light changed a little", remedy="", level="good")
    first, *rest = judged(folder, checks=[advice.model_dump()]).causes
    assert "begin with another one" in first.remedy
    assert rest == [advice]


def test_a_remark_from_before_the_run_is_a_cause_if_the_result_is_not_usable(folder: Path) -> None:
    before = Cause(what="background/: there is no picture", remedy="record it", level="good")
    (remark,) = judged(folder, checks=[before.model_dump()]).causes
    assert remark.kind == "remark"
    verdict = judged(folder, dict.fromkeys(CAMERAS, np.full(16, 0.59)), checks=[before.model_dump()])
    assert [cause.kind for cause in verdict.causes] == ["cause", "cause"]
    assert verdict.causes[0].what == before.what


def test_limbs_that_may_be_lost_are_in_the_headline(folder: Path) -> None:
    verdict = judged(folder).model_copy(update={"lost_limbs": 0.046})
    assert verdict.headline.endswith("1 of 16 frames has doubtful parts; 5 % of arms and legs may be lost")
    assert "lost" not in verdict.model_copy(update={"lost_limbs": 0.004}).headline


def test_a_camera_that_stands_out_is_a_cause_with_its_remedy(folder: Path) -> None:
    (cause,) = judged(folder, {"cam02": np.full(16, 0.68)}).causes
    assert cause.what.startswith("cam02 agrees less with the body than the others (IoU 0.68, others 0.90)")
    assert "xormocap sync my-take" in cause.remedy
    assert cause.level == "usable with gaps"


@pytest.mark.parametrize(
    ("either_px", "said"),
    [
        (7000 * 0.9 / 0.675, "they show more than the body: a second person, a thing that moves, or light"),
        (7000, "they show less than the body: an actor who leaves the pictures or is hidden"),
        (8500, "a second person or a thing that moves, light that changed, or an actor who leaves"),
    ],
    ids=["more", "less", "unknown"],
)
def test_moments_that_stand_out_in_most_cameras_are_one_cause(
    folder: Path, either_px: float, said: str
) -> None:
    """Body and silhouettes cover 7000 px before, 90 % of them both; afterwards either_px, 67.5 % both."""
    is_late, poses = FRAMES >= 109, folder / "poses.csv"
    energies_px = np.where(is_late, (1 - 0.675) * either_px, (1 - 0.9) * 7000)
    write_poses_csv(poses, replace(read_poses_csv(poses), energies_px=energies_px))
    causes = judged(folder, dict.fromkeys(CAMERAS[:3], np.where(is_late, 0.6, 0.9))).causes
    assert [cause.level for cause in causes] == ["usable with gaps"]
    assert f"stop matching the body in frames 109 to 115: {said}" in causes[0].what


@pytest.mark.parametrize(
    ("low", "part"),
    [([*range(4)], "104:116"), ([*range(9, 16)], "100:109"), ([0, 1, 2, 13, 14, 15], "103:113")],
    ids=["at the beginning", "at the end", "at both ends"],
)
def test_the_part_to_track_is_one_without_the_moments_that_stand_out(
    folder: Path, low: list[int], part: str
) -> None:
    overlap = np.full(16, 0.9)
    overlap[low] = 0.6
    (cause,) = judged(folder, dict.fromkeys(CAMERAS[:3], overlap)).causes
    assert cause.remedy.endswith(f"the longest part without them is tracked with --frames {part}")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("empty", "said"),
    [
        ([], "they show less than the body"),
        ([2, 12], "they show less than the body"),
        (range(9), "a second person or a thing that moves, light that changed, or an actor who leaves"),
    ],
    ids=["none", "some", "all before"],
)
def test_cameras_that_see_nobody_do_not_count_in_what_changed(
    folder: Path, empty: Sequence[int], said: str
) -> None:
    """Of five cameras two never see anybody; in the empty frames none does."""
    is_late, poses = FRAMES >= 109, folder / "poses.csv"
    overlap = np.where(is_late, 0.6, 0.9)
    overlap[list(empty)] = 1.0
    write_poses_csv(poses, replace(read_poses_csv(poses), energies_px=(1 - overlap) * 7000))
    nobody = {camera: np.ones(16) for camera in ("cam04", "cam05")}
    causes = judged(folder, dict.fromkeys(CAMERAS[:3], overlap) | nobody).causes
    assert any(said in cause.what for cause in causes)


def test_moments_of_one_camera_are_a_remark(folder: Path) -> None:
    (cause,) = judged(folder, {"cam03": np.where(FRAMES < 104, 0.5, 0.9)}).causes
    assert cause.what.startswith("cam03's silhouettes stop matching the body in frames 100 to 103")
    assert cause.level == "good"


def test_a_body_that_is_not_the_takes(folder: Path) -> None:
    verdict = judged(folder, take={"folder": "my-take", "actor_height": 1.70})
    assert verdict.causes[0].what == "the body is 1.78 m tall, take.toml says actor_height = 1.70"


@pytest.mark.parametrize(("n_cameras", "level"), [(2, "good"), (3, "usable with gaps")])
def test_hands_that_silhouettes_lack_are_named(folder: Path, n_cameras: int, level: str) -> None:
    cameras = [f"cam{c + 1:02d}" for c in range(4)]
    lacking = {camera: ["hands"] for camera in cameras[:n_cameras]} | {"cam04": ["head"]}
    (cause,) = judged(folder, dict.fromkeys(cameras, np.full(16, 0.9)), fit={"lacking": lacking}).causes
    named = ", ".join(cameras[:n_cameras])
    assert cause.what == f"silhouettes lack the hands in {named}; the head in cam04"
    assert cause.level == level


def test_a_body_that_nobody_has_is_not_usable(folder: Path) -> None:
    actor = folder / "actor.toml"
    text = actor.read_text()
    actor.write_text(text.replace("height = 1.78", "height = 2.2"))
    assert actor.read_text() != text
    verdict = judged(folder)
    assert verdict.level == "not usable"
    assert verdict.causes[0].what == "the fitted body is 2.20 m tall, as hardly anybody"
    assert "check the scale of calibration.toml" in verdict.causes[0].remedy


def test_what_was_found_before_the_run_comes_first(folder: Path) -> None:
    before = Cause(what="cam01: is out of step", remedy="run xormocap sync", level="usable with gaps")
    low = np.full(16, 0.68)
    verdict = judged(folder, {"cam01": low, "cam02": low}, checks=[before.model_dump()])
    assert verdict.causes[0] == before
    assert len(verdict.causes) == 1 + ("cam02" in verdict.causes[-1].what)  # cam01 is explained already


def test_checks_that_are_none_are_refused(folder: Path) -> None:
    with pytest.raises(TakeError, match=r"run\.json: checks: expected what xormocap track wrote"):
        judged(folder, checks=[{"nothing": 1}])


def test_frames_and_stretches_in_words() -> None:
    assert frame_in_words([False, False, True, False, False, True]) == "doubtful: left arm, right leg"
    assert frame_in_words([True, False, True, False, False, False]) == "doubtful: whole body"
    assert frame_in_words([False] * 6) == "good"
    chosen = np.array([1, 1, 0, 1, 0, 0, 1, 1, 1], bool)
    assert spans_of(chosen, 10) == ((10, 11), (13, 13), (16, 18))
    assert spans_in_words(spans_of(chosen, 10)) == "frames 10 to 11, 13, 16 to 18"
    many = tuple((10 * n, 10 * n + n) for n in range(9))
    assert spans_in_words(many).endswith("80 to 88, and 3 more stretches")
