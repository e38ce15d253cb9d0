"""What a pose leaves over is seen where it is, and what usually is left over is no reason to doubt."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX, SEGMENT_INDEX
from services.mocap.energy.picture import Picture
from services.mocap.search.alignment.aligner import SeenRim
from services.mocap.search.best_path import Chosen
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.found import Differences, FrameSolution
from services.mocap.search.lost_probability import (
    evidence_of,
    frames_around,
    lost_in_time,
    rival_probabilities,
)
from services.mocap.search.model import Model
from services.mocap.search.part_confidence import (
    LEAST_CONFIDENCE,
    SteadyConfidence,
    confidences,
    doubt_rivals,
)
from services.mocap.search.pose_prior import pose_prior
from services.mocap.search.usual_differences import UsualDifferences, differences
from services.mocap.take.marks import LIMB_NAMES, PARTS, Part
from services.mocap.types import Bytes, Floats

NOTHING: dict[Part, int] = dict.fromkeys(
    ("torso", "head", "left_arm", "right_arm", "left_leg", "right_leg"), 0
)
USUAL_RIM = SeenRim(
    np.tile([100.0, 87.0, 0.0], (len(ALL_SURFACES), 1)), np.tile(np.eye(3), (len(ALL_SURFACES), 1, 1))
)
USUAL_POSE = np.zeros(N_DOF)
USUAL_POSE[pose_prior().dofs] = pose_prior().means
LOWER_ARM = [SEGMENT_INDEX["left_forearm"], SEGMENT_INDEX["left_hand"]]


def _rim(lengths_px: tuple[float, ...], told: float = 1.0) -> SeenRim:
    """The usual rim, but for that of the left forearm and hand; told: how much of their place it tells."""
    rim = SeenRim(USUAL_RIM.lengths_px.copy(), USUAL_RIM.place_normals.copy())
    rim.lengths_px[LOWER_ARM] = lengths_px
    rim.place_normals[LOWER_ARM] *= told
    return rim


def _left_arm(px: int) -> Differences:
    px_by_part = {**NOTHING, "torso": px, "left_arm": px}
    return Differences(px_by_part, px_by_part, 0.05)


def test_the_right_pose_leaves_nothing(
    model: Model, standing: Callable[..., Floats], silhouettes_of: Callable[[Floats], Bytes]
) -> None:
    pose = standing(shoulder_elevation=-40)
    planes = silhouettes_of(pose)
    found = differences(model, Picture.whole(model.rig, planes), pose, planes)
    assert found == Differences(NOTHING, NOTHING, 0.0)
    trust = UsualDifferences(model.rig, 30.0)
    confidence = confidences(evidence_of(USUAL_RIM, found.nearest_px, USUAL_POSE), USUAL_RIM)
    assert trust.to_search(found) == trust.distrusted(found, confidence) == []
    assert min(confidence.values()) > 0.98


def test_an_arm_that_is_elsewhere_is_in_doubt_and_the_legs_are_not(
    model: Model, standing: Callable[..., Floats], silhouettes_of: Callable[[Floats], Bytes]
) -> None:
    pose = standing()
    wrong = pose.copy()
    wrong[DOF_INDEX["left_shoulder_elevation"]] += 1.0
    found = differences(model, Picture.whole(model.rig, silhouettes_of(pose)), wrong, silhouettes_of(wrong))
    trust, rim = UsualDifferences(model.rig, 30.0), _rim((100.0, 20.0, 0.0), told=0.2)
    confidence = confidences(evidence_of(rim, found.nearest_px, wrong), rim)
    assert "left_arm" in trust.to_search(found)
    assert trust.distrusted(found, confidence) == ["left_arm"]
    assert confidence["left_arm"] < 0.5 < 0.98 < min(confidence[part] for part in ("left_leg", "right_leg"))


def test_an_empty_picture_is_a_loss_of_all(
    model: Model, standing: Callable[..., Floats], silhouettes_of: Callable[[Floats], Bytes]
) -> None:
    pose = standing()
    planes = silhouettes_of(pose)
    found = differences(model, Picture.whole(model.rig, np.zeros_like(planes)), pose, planes)
    assert "torso" in UsualDifferences(model.rig, 30.0).distrusted(found, {})


def test_pixels_that_are_ignored_do_not_count(
    model: Model, standing: Callable[..., Floats], silhouettes_of: Callable[[Floats], Bytes]
) -> None:
    pose = standing()
    planes = silhouettes_of(pose)
    ignored = Picture.whole(model.rig, planes).ignoring(np.full_like(planes, 255))
    found = differences(model, ignored, pose, np.zeros_like(planes))
    assert found == Differences(NOTHING, NOTHING, 1.0)  # nothing tells where the body is


def test_what_usually_differs_is_no_doubt_but_a_leap_is(model: Model) -> None:
    trust = UsualDifferences(model.rig, 30.0)
    for _ in range(20):
        trust.remember(_left_arm(100))
    assert trust.to_search(_left_arm(150)) == []
    assert trust.to_search(_left_arm(200)) == ["left_arm"]


def test_a_lost_limb_never_becomes_usual(model: Model) -> None:
    trust = UsualDifferences(model.rig, 30.0)
    trust.remember(_left_arm(0))
    for _ in range(200):
        trust.remember(_left_arm(120))
    assert trust.to_search(_left_arm(120)) == ["left_arm"]


def test_the_torso_is_in_doubt_against_what_is_usual_but_never_at_a_quarter(model: Model) -> None:
    def sharing(share: float) -> Differences:
        return Differences(NOTHING, NOTHING, share)

    bare, coat = UsualDifferences(model.rig, 30.0), UsualDifferences(model.rig, 30.0)
    for _ in range(20):
        bare.remember(sharing(0.02))
        coat.remember(sharing(0.13))
    again = UsualDifferences(model.rig, 30.0)
    again.recall(coat.as_lists())
    for trust, doubtful in ((bare, [0.11, 0.18, 0.26]), (coat, [0.2, 0.26]), (again, [0.2, 0.26])):
        found = [
            share
            for share in (0.09, 0.11, 0.18, 0.2, 0.26)
            if trust.distrusted(sharing(share), {}) == ["torso"]
        ]
        assert set(doubtful) <= set(found)
        assert (0.18 in found) == (trust is bare)
    for _ in range(200):
        bare.remember(sharing(0.3))
    assert bare.distrusted(sharing(0.11), {}) == ["torso"]


def test_searches_in_vain_grow_rare_and_one_that_helps_ends_the_rest(model: Model) -> None:
    trust, searched = UsualDifferences(model.rig, 30.0), []
    trust.remember(_left_arm(0))
    for frame in range(40):
        if trust.to_search(_left_arm(500)):
            searched.append(frame)
            trust.note_search(["left_arm"], gained=False)
        trust.remember(_left_arm(500))
    assert searched == [0, 2, 6, 14, 22, 30, 38]
    trust.note_search(["left_arm"], gained=True)
    assert trust.to_search(_left_arm(500)) == ["left_arm"]


def test_the_torso_is_not_searched_like_a_limb(model: Model) -> None:
    lost = Differences(_left_arm(500).px, NOTHING, 0.5)
    trust = UsualDifferences(model.rig, 30.0)
    assert trust.distrusted(lost, {"left_arm": 0.5}) == ["torso", "left_arm"]
    assert trust.to_search(lost) == ["left_arm"]


def test_confidence_falls_with_what_speaks_against_a_limb() -> None:
    def of_arm(rim: SeenRim, near_px: int = 0, pose: Floats = USUAL_POSE) -> float:
        return confidences(evidence_of(rim, {**NOTHING, "left_arm": near_px}, pose), rim)["left_arm"]

    usual, flat = of_arm(USUAL_RIM), _rim((100.0, 87.0, 0.0))
    flat.place_normals[LOWER_ARM] = np.diag([1.0, 0.01, 1.0])  # cameras that face each other see it
    hidden, off = _rim((5.0, 4.35, 0.0), told=0.05), _rim((100.0, 30.0, 0.0), told=0.05)
    assert usual > 0.98
    assert of_arm(off) < 0.5
    unusual = USUAL_POSE.copy()
    unusual[DOF_INDEX["left_shoulder_elevation"]] += 1.5
    assert max(of_arm(hidden), of_arm(flat), of_arm(USUAL_RIM, 2000), of_arm(USUAL_RIM, 0, unusual)) < usual


def test_what_unsure_pixels_hide_counts_like_the_rest_and_a_part_behind_them_is_not_judged() -> None:
    def judged(rim: SeenRim) -> float | None:
        return confidences(evidence_of(rim, NOTHING, USUAL_POSE), rim).get("left_arm")

    half, shown = _rim((50.0, 43.5, 50.0), told=0.5), _rim((50.0, 43.5, 0.0), told=0.5)
    assert judged(half) == pytest.approx(judged(USUAL_RIM), abs=1e-3)
    assert judged(shown) < judged(half)
    assert judged(_rim((0.0, 0.0, 40.0), told=0.0)) is None


def test_a_limb_that_two_tracks_have_elsewhere_is_doubtful_unless_one_of_them_fits_far_better() -> None:
    apart_m = np.array([0.4, 0.0, 0.05, 0.4, 0.4, 0.4])
    margin_px = np.array([0.0, np.inf, 0.0, 0.0, 50.0, 2000.0])
    lost = rival_probabilities(apart_m, margin_px)
    np.testing.assert_allclose(lost[[1, 2]], 0.0)
    assert 0.25 >= lost[3] > lost[4] > 0.1 > 0.01 > lost[5]
    solution = FrameSolution(
        np.zeros(1), 0.0, confidence=dict.fromkeys(NOTHING, 0.98), distrusted=["left_arm"]
    )
    doubt_rivals(solution, Chosen(np.zeros(1), apart_m, margin_px))
    assert solution.distrusted == ["left_arm", "right_arm", "left_leg"]
    assert solution.confidence["torso"] == 0.98  # which is judged by the whole body's differences
    assert solution.confidence["right_leg"] > 0.97 > solution.confidence["left_leg"]
    assert solution.confidence["right_arm"] == 0.98 * 0.75


FPS = 20.0


def _by_itself(n_frames: int, probability: float) -> Floats:
    return np.full((n_frames, 4), probability)


def test_a_limb_is_likelier_lost_beside_frames_in_which_it_is() -> None:
    """The worst frame counts from 0.1 s off on, the mean from 0.25 s off on, and nothing farther away."""
    alone = _by_itself(21, 0.001)
    usual = lost_in_time(alone, 10, FPS)[0]
    beside = []
    for off in range(1, 11):
        lost = alone.copy()
        lost[10 + off, 0] = 0.6
        found = lost_in_time(lost, 10, FPS)
        np.testing.assert_array_equal(found, lost_in_time(lost[::-1], 10, FPS))
        np.testing.assert_array_equal(found[1:], usual)
        beside.append(float(found[0]))
    assert beside[0] == beside[1] > 10 * usual
    assert beside[1] > beside[2] == beside[4] > usual
    assert beside[5:] == [usual] * 5


def test_what_is_not_known_of_a_limb_stays_so_and_counts_for_nothing() -> None:
    lost = _by_itself(11, 0.02)
    lost[5, 0] = lost[[3, 4, 6], 1] = np.nan
    lost[:, 2] = np.nan
    found = lost_in_time(lost, 5, FPS)
    assert np.isnan(found[[0, 2]]).all()
    assert found[1] == pytest.approx(found[3], rel=1e-12)


def test_confidence_is_steadied_once_the_next_frames_are_there() -> None:
    n, ahead = 30, frames_around(FPS)
    lost = _by_itself(n, 0.03)
    lost[10:13, 0] = 0.5
    solutions = [FrameSolution(USUAL_POSE, 0.0) for _ in range(n)]
    for frame, solution in enumerate(solutions):
        solution.confidence = dict(zip(LIMB_NAMES, 1.0 - lost[frame], strict=True)) | {"head": 0.5}
        solution.distrusted = ["head"]
    solutions[20].confidence, solutions[20].distrusted = dict.fromkeys(PARTS, 0.0), list(PARTS)
    steady, numbers = SteadyConfidence(FPS), list[int]()
    for frame, solution in enumerate(solutions):
        finished = list(steady.add(solution))
        assert [number for number, _ in finished] == ([frame - ahead] if frame >= ahead else [])
        numbers += [number for number, done in finished if done is solutions[number]]
    numbers += [number for number, done in steady.rest() if done is solutions[number]]
    assert numbers == list(range(n))
    lost[20] = 1.0
    for frame in set(range(n)) - {20}:
        expected = dict(zip(LIMB_NAMES, 1.0 - lost_in_time(lost, frame, FPS), strict=True))
        assert solutions[frame].confidence == pytest.approx(expected | {"head": 0.5})
        low = [limb for limb in LIMB_NAMES if expected[limb] < LEAST_CONFIDENCE]
        assert solutions[frame].distrusted == ["head", *low]
    assert "left_arm" in solutions[9].distrusted, "it was lost a frame later"
    assert solutions[20].distrusted == list(PARTS)
    assert set(solutions[20].confidence.values()) == {0.0}
