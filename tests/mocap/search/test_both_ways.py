"""Of two tracks each limb comes from the one that has it, and every frame is solved from there."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from services.mocap.body.kinematics import joint_positions
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.picture import Picture
from services.mocap.search import both_ways
from services.mocap.search.best_path import PathSearch, apart_m, corrected_frames
from services.mocap.search.both_ways import Step, solve_both_ways
from services.mocap.search.chains import LIMBS
from services.mocap.search.contour_search import solve_by_contours
from services.mocap.search.found import FrameSolution
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.tracker import Tracker
from services.mocap.search.usual_differences import UsualDifferences
from services.mocap.take.marks import PARTS, LimbName
from services.mocap.types import Bytes, Floats

pytestmark = pytest.mark.usefixtures("quick_first_pose")
SETTINGS = SearchSettings()
N, FPS = 6, 15.0


@pytest.fixture(scope="module")
def truth(sinking_arms: Floats) -> Floats:
    return sinking_arms[:N]


@pytest.fixture(scope="module")
def seen(sinking_arms_seen: list[TriPlanes]) -> list[TriPlanes]:
    return sinking_arms_seen[:N]


def without(poses: Floats, limb: LimbName, frames: slice, standing: Callable[..., Floats]) -> Floats:
    """The poses (N, D) with a limb hanging down, where it is not, in some frames."""
    lost, dofs = poses.copy(), list(LIMBS[limb].dofs)
    lost[frames, dofs[0] : dofs[-1] + 1] = standing(shoulder_elevation=-80.0, hip_flexion=60.0)[dofs]
    return lost


def best_of(model: Model, seen: list[TriPlanes], one: Floats, other: Floats) -> Floats:
    search = PathSearch(model, SETTINGS)
    for planes, pose, rival in zip(seen, one, other, strict=True):
        search.add(planes, pose, rival)
    return np.array([chosen.pose for chosen in search.best()])


def test_each_limb_comes_from_the_track_that_has_it(
    model: Model, truth: Floats, seen: list[TriPlanes], standing: Callable[..., Floats]
) -> None:
    """In the middle frames one track lacks the left arm and the other one the right arm and a leg."""
    forward = without(truth, "left_arm", slice(2, None), standing)
    back = without(truth, "right_arm", slice(None, 4), standing)
    back = without(back, "right_leg", slice(1, 4), standing)
    np.testing.assert_array_equal(best_of(model, seen, forward, back), truth)
    np.testing.assert_array_equal(best_of(model, seen[::-1], back[::-1], forward[::-1])[::-1], truth)


def test_of_two_equal_energies_the_steadier_path_is_taken(
    model: Model, truth: Floats, seen: list[TriPlanes], standing: Callable[..., Floats]
) -> None:
    """Nothing is seen of a frame, so that movement alone decides."""
    hidden = list(seen)
    hidden[3] = TriPlanes(np.zeros_like(seen[3].silhouettes), np.full_like(seen[3].silhouettes, 255))
    forward = without(truth, "left_arm", slice(3, 4), standing)
    np.testing.assert_array_equal(best_of(model, hidden, forward, truth), truth)
    np.testing.assert_array_equal(best_of(model, hidden, truth, forward), truth)


def test_a_whole_track_that_is_better_is_taken_whole(
    model: Model, truth: Floats, seen: list[TriPlanes]
) -> None:
    astray = truth.copy()
    astray[:, 1] += 0.3
    np.testing.assert_array_equal(best_of(model, seen, astray, truth), truth)


@pytest.mark.parametrize("away_m", [(0.9, 0.6), (2.2, 0.0)])
def test_the_way_back_does_not_end_at_somebody_else(
    model: Model,
    truth: Floats,
    seen: list[TriPlanes],
    silhouettes_of: Callable[[Floats], Bytes],
    monkeypatch: pytest.MonkeyPatch,
    joint_errors_mm: Callable[[Floats, Floats], Floats],
    away_m: tuple[float, float],
) -> None:
    """Somebody stands still beside the actor, and the way back begins there."""
    still = truth[0].copy()
    still[:2] += away_m
    others = silhouettes_of(still)
    both = [TriPlanes.sure(one.silhouettes | others) for one in seen]
    monkeypatch.setattr(both_ways, "found_anew", lambda *_: still)
    steps = list(solve_both_ways(model, SETTINGS, LocalLimbs(model), both, truth, FPS))
    found = [step.solution for step in steps if step.solution is not None]
    assert len(found) == N
    for solution, true in zip(found, truth, strict=True):
        assert joint_errors_mm(solution.pose, true).mean() < 15


def test_how_far_apart_two_poses_are(model: Model, truth: Floats) -> None:
    other = truth[0].copy()
    other[LIMBS["left_arm"].dofs[0]] += 0.5
    found = apart_m(truth[0], other, model.body.offsets_m)
    joints_m = joint_positions(np.stack([truth[0], other]), model.body.offsets_m)
    assert [part for part, m in zip(PARTS, found, strict=True) if m > 0] == ["left_arm"]
    assert 0.1 < found.max() <= np.linalg.norm(joints_m[1] - joints_m[0], axis=-1).max()


def test_what_was_corrected_is_counted_by_part(
    model: Model, truth: Floats, standing: Callable[..., Floats]
) -> None:
    lost = without(without(truth, "left_arm", slice(1, 4), standing), "right_leg", slice(4, 5), standing)
    assert corrected_frames(lost, truth, model.body.offsets_m) == {"left_arm": 3, "right_leg": 1}


def test_a_limb_that_the_first_way_lost_is_found(
    model: Model,
    truth: Floats,
    seen: list[TriPlanes],
    standing: Callable[..., Floats],
    joint_errors_mm: Callable[[Floats, Floats], Floats],
) -> None:
    forward = without(truth, "left_arm", slice(1, N - 1), standing)
    steps = list(solve_both_ways(model, SETTINGS, LocalLimbs(model), seen, forward, FPS))
    solved = [(step.frame, step.solution) for step in steps if step.solution is not None]
    assert [frame for frame, _ in solved] == list(range(N))
    assert [(step.sweep, step.frame) for step in steps if step.solution is None] == [
        *(("tracking back", frame) for frame in reversed(range(N))),
        *(("settling", frame) for frame in range(N)),
    ]
    assert all(isinstance(step, Step) for step in steps)
    for frame, solution in solved:
        assert joint_errors_mm(solution.pose, truth[frame]).max() < 25
        assert solution.distrusted == []
        assert solution.limb_seconds == {}, "the last step only aligns"


def test_the_number_of_cores_changes_nothing(
    model: Model, truth: Floats, seen: list[TriPlanes], monkeypatch: pytest.MonkeyPatch
) -> None:
    def solved(n_cores: int) -> list[FrameSolution]:
        monkeypatch.setattr("services.mocap.search.model.N_CORES", n_cores)
        anew = replace(model)  # without copies
        steps = solve_both_ways(anew, SETTINGS, LocalLimbs(anew), seen, truth, FPS)
        return [step.solution for step in steps if step.solution is not None]

    for one, other in zip(solved(1), solved(3), strict=True):
        np.testing.assert_array_equal(one.pose, other.pose)
        np.testing.assert_array_equal(one.evidence, other.evidence)
        assert one.confidence == other.confidence
        assert (one.energy_px, one.measured) == (other.energy_px, other.measured)


def test_a_limb_that_was_lost_for_long_is_found_by_a_thorough_search(
    model: Model,
    truth: Floats,
    seen: list[TriPlanes],
    standing: Callable[..., Floats],
    joint_errors_mm: Callable[[Floats, Floats], Floats],
) -> None:
    """What differed in the last frames is usual, and no reason to search the arm."""
    lost = without(truth, "left_arm", slice(0, 1), standing)[:1]
    picture = Picture.whole(model.rig, seen[0].silhouettes)
    errors_mm = []
    for thorough in (False, True):
        trust = UsualDifferences(model.rig, SETTINGS.doubt_px)
        trust.recall({f"usual.{part}": [3000] * 15 for part in PARTS})
        limbs = LocalLimbs(model)
        found = solve_by_contours(model, picture, lost, SETTINGS, limbs, trust, thorough=thorough)
        errors_mm.append(joint_errors_mm(found.pose, truth[0]).max())
    assert errors_mm[0] > 150
    assert errors_mm[1] < 25


def test_a_thorough_search_leaves_sure_limbs_out(model: Model, truth: Floats, seen: list[TriPlanes]) -> None:
    picture = Picture.whole(model.rig, seen[0].silhouettes)
    trust = UsualDifferences(model.rig, SETTINGS.doubt_px)
    limbs = LocalLimbs(model)
    found = solve_by_contours(model, picture, truth[:1], SETTINGS, limbs, trust, thorough=True)
    assert all(found.confidence[limb] > 0.99 for limb in LIMBS)
    assert found.limb_seconds == {}


@pytest.mark.parametrize("is_there", [True, False])
def test_a_limb_is_not_searched_where_the_other_track_has_it(
    model: Model,
    truth: Floats,
    seen: list[TriPlanes],
    standing: Callable[..., Floats],
    is_there: bool,
) -> None:
    """What differs there, such as a wide sleeve, the other track has searched in vain."""
    lost = without(truth, "left_arm", slice(0, 1), standing)[:1]
    picture, limbs = Picture.whole(model.rig, seen[0].silhouettes), LocalLimbs(model)

    def solved(settings: SearchSettings, other: Floats | None) -> FrameSolution:
        trust = UsualDifferences(model.rig, SETTINGS.doubt_px)
        return solve_by_contours(model, picture, lost, settings, limbs, trust, other)

    aligned = solved(SETTINGS.model_copy(update={"search_limbs": "never"}), None)
    one_round = SETTINGS.model_copy(update={"max_passes": 1})  # searching the head may move the arm
    found = solved(one_round, aligned.pose if is_there else truth[0])
    assert ("left_arm" in found.limb_seconds) is not is_there


def test_a_thorough_search_looks_for_limbs_although_the_other_track_has_them_there(
    model: Model, truth: Floats, seen: list[TriPlanes], standing: Callable[..., Floats]
) -> None:
    lost = without(truth, "left_arm", slice(0, 1), standing)[:1]
    picture, limbs = Picture.whole(model.rig, seen[0].silhouettes), LocalLimbs(model)
    trust = UsualDifferences(model.rig, SETTINGS.doubt_px)
    found = solve_by_contours(model, picture, lost, SETTINGS, limbs, trust, lost[0], thorough=True)
    assert "left_arm" in found.limb_seconds


@pytest.fixture
def solved_on_the_way_back(
    model: Model, monkeypatch: pytest.MonkeyPatch
) -> Callable[[list[TriPlanes], Floats], list[int]]:
    """`solved_on_the_way_back(seen, forward)`: the frames that are solved, with the forward pose told."""

    def find(seen: list[TriPlanes], forward: Floats) -> list[int]:
        solved = list[int]()

        def solve(*given: Any, thorough: bool) -> FrameSolution:
            if given[6] is not None:  # else it is settled
                solved.extend(np.flatnonzero((forward == given[6]).all(axis=1)).tolist())
            return solve_by_contours(*given, thorough=thorough)

        monkeypatch.setattr("services.mocap.search.frame.solve_by_contours", solve)
        steps = solve_both_ways(model, SETTINGS, LocalLimbs(model), seen, forward, FPS)
        while next(steps).sweep == "tracking back":
            pass
        return solved

    return find


@pytest.mark.parametrize("lost", ["left_arm", "right_leg"])
def test_the_way_back_solves_frames_in_which_the_way_forward_is_elsewhere(
    truth: Floats,
    seen: list[TriPlanes],
    standing: Callable[..., Floats],
    solved_on_the_way_back: Callable[[list[TriPlanes], Floats], list[int]],
    lost: LimbName,
) -> None:
    """Nothing moves; besides, the last and the first frame are searched thoroughly."""
    still = truth[:1] + 1e-9 * np.arange(N)[:, None]  # to tell frames apart
    forward = without(still, lost, slice(2, 3), standing)
    assert solved_on_the_way_back([seen[0]] * N, forward) == [5, 2, 0]
    forward = still.copy()
    forward[2, DOF_INDEX["head_turn"]] += 0.5
    assert solved_on_the_way_back([seen[0]] * N, forward) == [5, 2, 0]


def test_the_way_back_expects_that_movements_go_on(
    truth: Floats,
    seen: list[TriPlanes],
    solved_on_the_way_back: Callable[[list[TriPlanes], Floats], list[int]],
) -> None:
    """Arms sink by more than 4 cm a frame, as is known from two frames on."""
    assert solved_on_the_way_back(seen, truth) == [5, 4, 0]


def test_a_lost_tracker_expects_nothing(model: Model, truth: Floats, seen: list[TriPlanes]) -> None:
    tracker = Tracker(model, SETTINGS, LocalLimbs(model), truth[:1])
    assert tracker.expects(truth[0])
    tracker.solve(TriPlanes.sure(np.zeros_like(seen[0].silhouettes)))
    assert tracker.is_lost and not tracker.expects(truth[0])


def test_limbs_are_tried_elsewhere_unless_they_are_sure_or_nobody_is_there(
    model: Model, truth: Floats, seen: list[TriPlanes], monkeypatch: pytest.MonkeyPatch
) -> None:
    def limb_seconds(planes: TriPlanes) -> float:
        steps = solve_both_ways(model, SETTINGS, LocalLimbs(model), [planes], truth[:1], FPS)
        (solution,) = (step.solution for step in steps if step.solution is not None)
        return solution.seconds["limbs"]

    monkeypatch.setattr("services.mocap.search.elsewhere._SURE", 0.0)
    assert limb_seconds(seen[0]) < 1e-3
    monkeypatch.setattr("services.mocap.search.elsewhere._SURE", 1.1)
    assert limb_seconds(seen[0]) > 1e-3
    assert limb_seconds(TriPlanes.sure(np.zeros_like(seen[0].silhouettes))) == 0.0


def test_an_actor_who_leaves_is_missed_in_both_ways(
    model: Model, truth: Floats, seen: list[TriPlanes], joint_errors_mm: Callable[[Floats, Floats], Floats]
) -> None:
    nobody = TriPlanes.sure(np.zeros_like(seen[0].silhouettes))
    gone = {2, 3}
    left = [nobody if frame in gone else planes for frame, planes in enumerate(seen)]
    tracker = Tracker(model, SETTINGS, LocalLimbs(model), truth[:1])
    forward = np.array([tracker.solve(planes).pose for planes in left])
    for step in solve_both_ways(model, SETTINGS, LocalLimbs(model), left, forward, FPS):
        if step.solution is None:
            continue
        if step.frame in gone:
            assert step.solution.distrusted == list(PARTS)
            assert set(step.solution.confidence.values()) == {0.0}
        else:
            assert "torso" not in step.solution.distrusted
            assert joint_errors_mm(step.solution.pose, truth[step.frame]).max() < 25
