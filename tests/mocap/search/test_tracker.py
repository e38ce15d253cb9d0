"""An actor who leaves is missed, not imagined, and is found where they come back."""

import numpy as np
import pytest

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, joint_positions
from services.mocap.body.skeleton import DOF_INDEX, SIDES
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES, LIMBS
from services.mocap.search.found import FrameSolution
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.tracker import Tracker, aligned_ahead
from services.mocap.synth.studio import studio_cameras
from services.mocap.take.marks import PARTS
from services.mocap.types import Floats

pytestmark = pytest.mark.usefixtures("quick_first_pose")


@pytest.fixture(scope="module")
def model() -> Model:
    body, rig = build_body(Actor(height=1.75)), Rig.of(studio_cameras(6))
    return Model(body, rig, CpuBackend(body, rig))


def _pose(model: Model, x_m: float, heading: float) -> Floats:
    pose = np.zeros(N_DOF)
    pose[:3] = x_m, 0.0, model.body.pelvis_height_m
    pose[DOF_INDEX["root_heading"]] = heading
    for side in SIDES:
        pose[DOF_INDEX[f"{side}_shoulder_elevation"]] = -1.0
    return pose


def _drawn(model: Model, pose: Floats) -> TriPlanes:
    return TriPlanes.sure(model.backend.coverage(pose[None], ALL_SURFACES, Region.whole(model.rig))[0])


def test_an_actor_who_leaves_is_missed_and_found_again(model: Model) -> None:
    here, there = _pose(model, 0.0, 0.5), _pose(model, 0.6, -2.0)
    tracker = Tracker(model, SearchSettings(), LocalLimbs(model), here[None])
    seen = tracker.solve(_drawn(model, here))
    assert seen.distrusted == []
    nobody = TriPlanes.sure(np.zeros_like(_drawn(model, here).silhouettes))
    for _ in range(3):
        gone = tracker.solve(nobody)
        assert gone.distrusted == list(PARTS)
        np.testing.assert_array_equal(gone.pose, seen.pose)
    back = tracker.solve(_drawn(model, there))
    off_m = np.diff(joint_positions(np.stack([back.pose, there]), model.body.offsets_m), axis=0)
    assert 1000 * np.linalg.norm(off_m, axis=-1).mean() < 30
    assert "torso" not in back.distrusted
    moved = there.copy()
    moved[0] += 0.05
    after = tracker.solve(_drawn(model, moved))
    assert abs(after.pose[0] - moved[0]) < 0.01


def test_a_pose_that_an_earlier_run_found_is_begun_with(model: Model) -> None:
    """An alignment alone cannot follow an actor who turns round while he jumps aside."""
    here, there = _pose(model, 0.0, 0.5), _pose(model, 0.6, -2.0)
    tracker = Tracker(model, SearchSettings(search_limbs="never"), LocalLimbs(model), here[None])
    found = tracker.solve(_drawn(model, there), known=there)
    off_m = np.diff(joint_positions(np.stack([found.pose, there]), model.body.offsets_m), axis=0)
    assert 1000 * np.linalg.norm(off_m, axis=-1).max() < 10
    assert found.distrusted == []
    wrong = tracker.solve(_drawn(model, there), known=here)
    np.testing.assert_allclose(wrong.pose, found.pose, atol=0.01)


@pytest.mark.parametrize("both_ways", [False, True])
def test_limbs_of_a_known_pose_are_left_to_the_way_back(model: Model, both_ways: bool) -> None:
    here = _pose(model, 0.0, 0.5)
    settings = SearchSettings(search_limbs="always", both_ways=both_ways)
    tracker = Tracker(model, settings, LocalLimbs(model), here[None])
    found = tracker.solve(_drawn(model, here), known=here)
    assert (found.seconds["limbs"] > 0) is not both_ways
    assert found.distrusted == []


def test_what_is_aligned_ahead_is_what_would_be_found(model: Model) -> None:
    """In the order of the frames; nothing is made of frames without a known pose."""
    poses = [_pose(model, 0.02 * k, 0.5) for k in range(7)]
    known = [None if k == 4 else pose + 0.01 for k, pose in enumerate(poses)]
    seen = [_drawn(model, pose) for pose in poses]
    ahead = list(aligned_ahead(model, SearchSettings(), zip(range(7), seen, known, strict=True)))
    assert [frame for frame, _ in ahead] == list(range(7))
    assert [frame for frame, aligned in ahead if aligned is None] == [4]
    one, other = (Tracker(model, SearchSettings(), LocalLimbs(model), poses[0][None]) for _ in range(2))
    for frame, aligned in ahead:
        found = one.solve(seen[frame], known=known[frame], aligned=aligned)
        expected = other.solve(seen[frame], known=known[frame])
        np.testing.assert_array_equal(found.pose, expected.pose)
        assert (found.confidence, found.distrusted) == (expected.confidence, expected.distrusted)
        assert one.memory() == other.memory()


def test_a_limb_of_a_known_pose_is_searched_if_it_looks_doubtful(model: Model) -> None:
    here = _pose(model, 0.0, 0.5)
    lost = here.copy()
    lost[list(LIMBS["left_arm"].main.dofs)] = np.radians([80.0, 60.0, 0.0, 20.0])
    tracker = Tracker(model, SearchSettings(), LocalLimbs(model), lost[None])
    found = tracker.solve(_drawn(model, here), known=lost)
    off_m = np.diff(joint_positions(np.stack([found.pose, here]), model.body.offsets_m), axis=0)
    assert 1000 * np.linalg.norm(off_m, axis=-1).max() < 30
    assert found.distrusted == []


def test_a_late_frame_is_solved_in_a_hurry(model: Model) -> None:
    """No limb is searched in it, unless the body would be lost otherwise."""
    here, away = _pose(model, 0.0, 0.5), _pose(model, 0.6, -2.0)
    tracker = Tracker(model, SearchSettings(search_limbs="always"), LocalLimbs(model), here[None])
    in_time, late = (tracker.solve(_drawn(model, here), hurried=hurried) for hurried in (False, True))
    assert (in_time.seconds["limbs"] > 0, late.seconds["limbs"]) == (True, 0.0)
    assert late.evaluations < 100 < in_time.evaluations
    assert late.distrusted == []
    found = tracker.solve(_drawn(model, away), hurried=True)
    assert "torso" not in found.distrusted
    assert abs(found.pose[0] - away[0]) < 0.02


def test_an_actor_beside_something_large_is_marked_and_followed(model: Model) -> None:
    tracker = Tracker(model, SearchSettings(), LocalLimbs(model), _pose(model, 0.0, 0.5)[None])
    tracker.solve(_drawn(model, _pose(model, 0.0, 0.5)))
    large = _drawn(model, _pose(model, -0.55, 2.0)).silhouettes
    for x_m in (0.05, 0.1, 0.15, 0.2):
        found = tracker.solve(TriPlanes.sure(_drawn(model, _pose(model, x_m, 0.5)).silhouettes | large))
        assert "torso" in found.distrusted
        assert abs(found.pose[0] - x_m) < 0.03


Memory = dict[str, list[int]]


@pytest.fixture(scope="module")
def undisturbed(model: Model) -> list[tuple[TriPlanes, FrameSolution, Memory]]:
    """What is shown, what a tracker finds in it, and its memory after that: the actor leaves and returns."""
    steps = [0.0, 0.04, 0.09, None, None, 0.6, 0.63]
    empty = TriPlanes.sure(np.zeros_like(_drawn(model, _pose(model, 0.0, 0.5)).silhouettes))
    shown = [empty if x_m is None else _drawn(model, _pose(model, x_m, 0.5)) for x_m in steps]
    tracker = Tracker(model, SearchSettings(), LocalLimbs(model), _pose(model, 0.0, 0.5)[None])
    return [(picture, tracker.solve(picture), tracker.memory()) for picture in shown]


@pytest.mark.parametrize(("ends", "until"), [(2, 5), (4, 5), (5, 7), (6, 7)])
def test_another_tracker_goes_on_as_the_one_before_would_have(
    model: Model, undisturbed: list[tuple[TriPlanes, FrameSolution, Memory]], ends: int, until: int
) -> None:
    """Wherever the first ends: on the way, while the actor is lost, just after they were found again.

    It is watched until its memory is what another case begins with.
    """
    poses = [_pose(model, 0.0, 0.5), *(solved.pose for _, solved, _ in undisturbed[:ends])]
    after = Tracker(model, SearchSettings(), LocalLimbs(model), np.array(poses[-2:]))
    after.recall(undisturbed[ends - 1][2])
    for picture, expected, memory in undisturbed[ends:until]:
        found = after.solve(picture)
        assert found.pose.tobytes() == expected.pose.tobytes()
        assert (found.energy_px, found.distrusted) == (expected.energy_px, expected.distrusted)
        assert after.memory() == memory


@pytest.mark.parametrize(
    "memory", [{}, {"tracker": [1, 0]}, {"tracker": [3, 0, 0, 0]}, {"tracker": [0, 0, 0, 0]}]
)
def test_a_memory_that_makes_no_sense_is_refused(model: Model, memory: dict[str, list[int]]) -> None:
    tracker = Tracker(model, SearchSettings(), LocalLimbs(model), np.zeros((2, N_DOF)))
    with pytest.raises(ValueError, match=r"values to unpack|poses to remember"):
        tracker.recall(memory)
