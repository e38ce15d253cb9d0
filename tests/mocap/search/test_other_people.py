"""Other people in view count for nothing: they are neither the actor nor background."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import CLASS_BITS, TriPlanes, camera_bit, count_bits, pack, unpack
from services.mocap.errors import TakeError
from services.mocap.search.found import FrameSolution
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import Model
from services.mocap.search.occlusion import points_drawn
from services.mocap.search.other_people import find_others, told_apart, without_others
from services.mocap.search.plausibility import look_first
from services.mocap.search.settings import SearchSettings
from services.mocap.search.tracker import Tracker, is_far, whole_person
from services.mocap.search.two_people import Places
from services.mocap.types import Bytes, Floats

Poser = Callable[..., Floats]
Silhouettes = Callable[[Floats], Bytes]
ARMS_DOWN = {"shoulder_elevation": -70.0}


def somebody_at(standing: Poser, x_m: float, y_m: float, **degrees: float) -> Floats:
    pose = standing(**ARMS_DOWN, **degrees)
    pose[:2] = x_m, y_m
    return pose


@settings(max_examples=15, deadline=None)
@given(
    elevation=st.floats(-85, 60),
    stride=st.floats(-40, 40),
    off_m=st.tuples(*[st.floats(-0.15, 0.15)] * 3),
    turn=st.floats(-30, 30),
)
def test_an_actor_alone_stays_as_seen(
    model: Model,
    standing: Poser,
    silhouettes_of: Silhouettes,
    elevation: float,
    stride: float,
    off_m: tuple[float, float, float],
    turn: float,
) -> None:
    pose = standing(shoulder_elevation=elevation, left_hip_flexion=stride, right_hip_flexion=-stride)
    expected = standing(shoulder_elevation=elevation + turn, root_heading=turn)
    expected[:3] += off_m
    seen = TriPlanes.sure(silhouettes_of(pose))
    assert without_others(model, seen, expected) is seen


@pytest.mark.parametrize("cameras", [range(8), range(0, 8, 2)])
@pytest.mark.parametrize(("x_m", "y_m"), [(0.9, 0.0), (1.1, -0.6), (-1.2, 0.9), (1.8, 1.5)])
def test_who_stands_beside_the_actor_is_unsure(
    model: Model, standing: Poser, silhouettes_of: Silhouettes, x_m: float, y_m: float, cameras: range
) -> None:
    actor, other = somebody_at(standing, 0.0, 0.0), somebody_at(standing, x_m, y_m, root_heading=70)
    rig = Rig(model.rig.P_px_world[cameras], model.rig.sizes_px[cameras])
    own, others = (unpack(silhouettes_of(pose), 8)[cameras] for pose in (actor, other))
    seen, expected = TriPlanes.sure(pack(own | others)), actor.copy()
    expected[:2] += 0.08
    alone = without_others(replace(model, rig=rig), seen, expected)
    np.testing.assert_array_equal(alone.possible, seen.silhouettes)  # nothing becomes background
    sure = unpack(alone.silhouettes, rig.n_cameras)
    assert (sure & ~own).sum() < 0.06 * (others & ~own).sum()
    apart = [c for c in range(rig.n_cameras) if not (own[c] & others[c]).any()]
    assert (sure & own)[apart].sum() > (0.9 if len(cameras) == 8 else 0.5) * own[apart].sum()


def test_an_actor_who_has_moved_on_is_nobody_else(
    model: Model, standing: Poser, silhouettes_of: Silhouettes
) -> None:
    seen = TriPlanes.sure(silhouettes_of(somebody_at(standing, 1.0, 0.8)))
    assert without_others(model, seen, somebody_at(standing, -0.6, 0.0)) is seen


def test_a_camera_that_is_absent_tells_nothing(
    model: Model, standing: Poser, silhouettes_of: Silhouettes
) -> None:
    actor = somebody_at(standing, 0.0, 0.0)
    own, others = silhouettes_of(actor), silhouettes_of(somebody_at(standing, 1.2, 0.9))
    absent = np.uint8(0b1111_0000)
    seen = TriPlanes.sure((own | others) & ~absent)
    alone = without_others(model, seen, actor, range(4, 8))
    assert not (alone.possible & absent).any()
    assert np.count_nonzero(camera_bit(alone.unsure, 0)) > 500


def test_an_actor_is_followed_past_somebody_else(
    model: Model,
    standing: Poser,
    silhouettes_of: Silhouettes,
    joint_errors_mm: Callable[[Floats, Floats], Floats],
) -> None:
    def walked(frame: int) -> Floats:
        return somebody_at(standing, -0.5 + 0.12 * frame, 0.0, root_heading=90)

    others = silhouettes_of(somebody_at(standing, 0.1, 0.8))
    tracker = Tracker(model, SearchSettings(), LocalLimbs(model), walked(0)[None])
    for frame in range(10):
        seen = TriPlanes.sure(silhouettes_of(walked(frame)) | others)
        found = tracker.solve(seen)
        assert not found.is_lost
        assert joint_errors_mm(found.pose, walked(frame)).mean() < 15


def test_of_two_people_the_one_in_the_middle_is_the_actor(
    model: Model, standing: Poser, silhouettes_of: Silhouettes
) -> None:
    middle, aside = somebody_at(standing, 0.2, 0.1), somebody_at(standing, 1.3, 0.6)
    own, others = (unpack(silhouettes_of(pose), 8) for pose in (middle, aside))
    look = look_first(model.rig, own | others)
    assert look.remarks[0].startswith(
        "silhouettes: two people, or the actor and something large, are visible"
    )
    assert "x 0.2 m, y 0.1 m" in look.remarks[0]
    believed = look.believed(own | others)
    assert (believed & ~own).sum() < 0.05 * (others & ~own).sum()
    assert (believed & own).sum() > 0.7 * own.sum()  # what others may hide is unsure
    seen = TriPlanes.sure(pack(own | others))
    np.testing.assert_array_equal(unpack(look.alone(seen).silhouettes, 8), believed)
    np.testing.assert_array_equal(look.alone(seen).possible, seen.silhouettes)


@pytest.mark.parametrize("who", [0, 1])
def test_a_lost_actor_is_whoever_is_nearer_to_the_last_pose(
    model: Model, standing: Poser, silhouettes_of: Silhouettes, who: int
) -> None:
    two = [somebody_at(standing, -0.8, 0.0), somebody_at(standing, 0.7, 0.2)]
    seen = TriPlanes.sure(silhouettes_of(two[0]) | silhouettes_of(two[1]))
    assert whole_person(model, seen, Places(two[who][:2])) is None  # who of them it is, nothing tells
    found = whole_person(model, seen, Places(two[who][:2] + 0.2, two[1 - who][:2]))
    assert found is not None
    hull, alone = found
    np.testing.assert_allclose(hull.axis_world_m, two[who][:2], atol=0.1)
    own = silhouettes_of(two[who])
    assert np.count_nonzero(alone.silhouettes & ~own) < 0.05 * np.count_nonzero(seen.silhouettes & ~own)


def test_people_far_apart_are_told_apart(model: Model, standing: Poser, silhouettes_of: Silhouettes) -> None:
    own = unpack(silhouettes_of(somebody_at(standing, 0.0, 0.0)), 8)
    others = unpack(silhouettes_of(somebody_at(standing, 2.2, 0.0)), 8)
    look = look_first(model.rig, own | others)
    assert (look.believed(own | others) & ~own).sum() < 0.05 * (others & ~own).sum()


def test_what_is_doubted_has_no_colour(standing: Poser, silhouettes_of: Silhouettes) -> None:
    planes = silhouettes_of(standing())
    seen = replace(TriPlanes.sure(planes), classes=np.stack([planes] * CLASS_BITS))
    doubted = planes & np.uint8(0b0000_1111)
    assert seen.doubting(doubted).classes is not None
    np.testing.assert_array_equal(seen.doubting(doubted).sent_classes, seen.sent_classes & ~doubted)


def test_who_stands_where_others_stood_is_not_the_actor(
    model: Model, standing: Poser, silhouettes_of: Silhouettes
) -> None:
    """The actor was lost beside somebody who stands still, and has run on."""
    still, far = somebody_at(standing, 0.6, 0.0), somebody_at(standing, -0.9, 0.6)
    seen = TriPlanes.sure(silhouettes_of(still) | silhouettes_of(far))
    found = whole_person(model, seen, Places(np.array([0.2, 0.1]), still[:2]))
    assert found is not None
    np.testing.assert_allclose(found[0].axis_world_m, far[:2], atol=0.1)


def test_two_people_side_by_side_stay_apart_from_frame_to_frame(
    model: Model, standing: Poser, silhouettes_of: Silhouettes
) -> None:
    """What is the actor's does not grow over somebody else, who comes near and goes."""
    actor = somebody_at(standing, 0.0, 0.0)
    own, left_m = silhouettes_of(actor), np.abs(np.linspace(-0.6, 0.6, 13)) + 0.9
    others = [silhouettes_of(somebody_at(standing, away_m, 0.5)) for away_m in left_m]
    look = look_first(model.rig, unpack(own | others[0], 8))
    assert look.two is not None
    actor_m, others_m = look.two.actor_world_m, look.two.others_world_m
    for other in others:
        alone, actor_m, others_m = told_apart(model.rig, TriPlanes.sure(own | other), actor_m, others_m)
        assert count_bits(alone.silhouettes & ~own) < 0.1 * count_bits(other & ~own)
        assert count_bits(alone.silhouettes & own) > 0.6 * count_bits(own)


@pytest.mark.parametrize("camera", [0, 3])
def test_what_furniture_hides_from_one_camera_stays_sure_in_the_others(
    model: Model, standing: Poser, silhouettes_of: Silhouettes, camera: int
) -> None:
    actor = somebody_at(standing, 0.0, 0.0)
    own, seen = silhouettes_of(actor), unpack(silhouettes_of(actor), 8)
    seen |= unpack(silhouettes_of(somebody_at(standing, 1.3, 0.8)), 8)
    rows = np.flatnonzero(unpack(own, 8)[camera].any(axis=1))
    seen[camera, rows[0] + round(0.75 * len(rows)) :] = False  # a table before the shanks
    alone = without_others(model, TriPlanes.sure(pack(seen)), actor)
    low = np.zeros_like(seen)
    for c, mask in enumerate(unpack(own, 8)):
        of_actor = np.flatnonzero(mask.any(axis=1))
        low[c, of_actor[0] + round(0.8 * len(of_actor)) :] = c != camera
    shanks = pack(low) & own
    assert count_bits(alone.silhouettes & shanks) > 0.7 * count_bits(shanks)


def test_something_low_in_the_middle_is_no_actor(
    model: Model, standing: Poser, silhouettes_of: Silhouettes
) -> None:
    """A chair in the middle, as high as a thigh, does not become the actor."""
    chair = unpack(silhouettes_of(somebody_at(standing, 0.1, 0.1, hip_abduction=20)), 8)
    for mask in chair:
        rows = np.flatnonzero(mask.any(axis=1))
        mask[: rows[0] + round(0.6 * len(rows))] = False
    aside = unpack(silhouettes_of(somebody_at(standing, 1.2, 0.5)), 8)
    with pytest.raises(TakeError, match="the actor and something large"):
        look_first(model.rig, aside | chair)


def test_two_people_equally_near_are_refused(
    model: Model, standing: Poser, silhouettes_of: Silhouettes
) -> None:
    ends = somebody_at(standing, -0.7, 0.0), somebody_at(standing, 0.7, 0.0)
    two = silhouettes_of(ends[0]) | silhouettes_of(ends[1])
    with pytest.raises(TakeError, match="which of them is the actor is not clear"):
        look_first(model.rig, unpack(two, 8))


@pytest.mark.parametrize("high_m", [0.75, 1.05])
def test_a_box_in_the_middle_is_no_actor(
    model: Model, standing: Poser, silhouettes_of: Silhouettes, high_m: float
) -> None:
    sides_m = np.linspace(-0.25, 0.25, 26)
    box_m = np.stack(np.meshgrid(sides_m, sides_m, np.arange(0, high_m, 0.02)), axis=-1).reshape(-1, 3)
    box = points_drawn(model.rig, box_m, np.ones((8, len(box_m)), bool), 1)
    aside = unpack(silhouettes_of(somebody_at(standing, 1.1, 0.3)), 8)
    with pytest.raises(TakeError, match="which of them is the actor is not clear"):
        look_first(model.rig, aside | box)


@pytest.mark.parametrize(("x_m", "y_m"), [(1.2, 0.5), (2.1, 0.3), (-2.0, 1.2)])
def test_where_others_are_is_told(
    model: Model, standing: Poser, silhouettes_of: Silhouettes, x_m: float, y_m: float
) -> None:
    actor = somebody_at(standing, 0.0, 0.0)
    seen = silhouettes_of(actor) | silhouettes_of(somebody_at(standing, x_m, y_m))
    alone, others_m = find_others(model, TriPlanes.sure(seen), actor)
    assert np.count_nonzero(alone.unsure) > 1000
    assert others_m is not None
    np.testing.assert_allclose(others_m, [x_m, y_m], atol=0.3)


def test_who_is_left_when_the_actor_goes_is_not_the_actor(
    model: Model, standing: Poser, silhouettes_of: Silhouettes
) -> None:
    """Until it is long ago that others were there; then nothing tells that it is somebody else."""
    others = silhouettes_of(somebody_at(standing, 1.1, 0.5))
    tracker = Tracker(model, SearchSettings(), LocalLimbs(model), somebody_at(standing, -0.6, 0.0)[None])
    for frame in range(3):
        own = silhouettes_of(somebody_at(standing, -0.6 + 0.05 * frame, 0.0))
        assert not tracker.solve(TriPlanes.sure(own | others)).is_lost
    remembered = tracker.memory()["others"]
    np.testing.assert_allclose(remembered, [1100, 500, 0], atol=150)
    for _ in range(3):
        found = tracker.solve(TriPlanes.sure(others))
        assert found.is_lost
        assert np.linalg.norm(found.pose[:2] - [-0.5, 0.0]) < 0.2
    assert tracker.memory()["others"] == remembered
    n_poses, _, tries, _ = tracker.memory()["tracker"]
    tracker.recall(tracker.memory() | {"tracker": [n_poses, 61, tries, 0]})
    assert not tracker.solve(TriPlanes.sure(others)).is_lost


def test_where_others_were_is_forgotten(model: Model, standing: Poser, silhouettes_of: Silhouettes) -> None:
    pose = somebody_at(standing, 0.0, 0.0)
    tracker = Tracker(model, SearchSettings(), LocalLimbs(model), pose[None])
    tracker.recall(tracker.memory() | {"others": [1100, 500, 59]})
    left = []
    for _ in range(2):
        tracker.solve(TriPlanes.sure(silhouettes_of(pose)))
        left.append(tracker.memory()["others"])
    assert left == [[1100, 500, 60], []]


def test_a_low_actor_is_found_where_he_or_she_was(
    model: Model, standing: Poser, silhouettes_of: Silhouettes
) -> None:
    """Beside somebody who stands: only without a known place it may be a box."""
    crouching = somebody_at(standing, 0.0, 0.0, hip_flexion=100, knee_flexion=140, root_pitch=40)
    crouching[2] -= 0.6
    others = somebody_at(standing, 1.2, 0.3)
    both = unpack(silhouettes_of(crouching) | silhouettes_of(others), 8)
    with pytest.raises(TakeError, match="which of them is the actor is not clear"):
        look_first(model.rig, both)
    look = look_first(model.rig, both, places=Places(crouching[:2]))
    assert look.two is not None
    np.testing.assert_allclose(np.median(look.two.actor_world_m[:, :2], axis=0), [0, 0], atol=0.25)


@pytest.mark.parametrize("noise_px", [10, 200])
def test_a_camera_is_hidden_by_others_only_if_it_sees_enough_of_them(
    model: Model, standing: Poser, silhouettes_of: Silhouettes, noise_px: int
) -> None:
    own = unpack(silhouettes_of(standing(**ARMS_DOWN)), 8)
    others = np.zeros_like(own)
    own[3], others[3].flat[:noise_px] = False, True
    look = look_first(model.rig, own, possible=own | others, others=others)
    assert look.left_out == (3,)
    assert look.hidden_by_others == ((3,) if noise_px == 200 else ())
    assert ("somebody else hides" in look.remarks[0]) == (noise_px == 200)


def test_a_body_of_which_nothing_is_known_is_lost(
    model: Model, standing: Poser, silhouettes_of: Silhouettes
) -> None:
    pose = standing(**ARMS_DOWN)
    sure = TriPlanes.sure(silhouettes_of(pose))
    tracker = Tracker(model, SearchSettings(), LocalLimbs(model), pose[None])
    assert not tracker.solve(sure).is_lost
    assert tracker.solve(sure.doubting(np.full_like(sure.silhouettes, 255))).is_lost
    assert not tracker.solve(sure).is_lost


def test_a_camera_that_turns_white_does_not_lose_the_actor(
    model: Model,
    standing: Poser,
    silhouettes_of: Silhouettes,
    joint_errors_mm: Callable[[Floats, Floats], Floats],
) -> None:
    poses = [somebody_at(standing, 0.05 * frame, 0.0, root_heading=90) for frame in range(4)]
    tracker = Tracker(model, SearchSettings(), LocalLimbs(model), poses[0][None])
    for pose in poses:
        found = tracker.solve(TriPlanes.sure(silhouettes_of(pose) | np.uint8(2)))
        assert not found.is_lost
        assert joint_errors_mm(found.pose, pose).mean() < 15


def test_a_body_beside_the_silhouettes_is_far_whatever_a_white_camera_shows(
    model: Model, standing: Poser, silhouettes_of: Silhouettes
) -> None:
    pose, aside = somebody_at(standing, 0.0, 0.0), somebody_at(standing, 1.4, 0.0)
    picture = model.picture_of(TriPlanes.sure(silhouettes_of(pose) | np.uint8(2)))
    for one, is_beside in ((pose, False), (aside, True)):
        differing = (silhouettes_of(one) ^ picture.silhouettes) & ~picture.ignored
        assert is_far(FrameSolution(one, count_bits(differing)), picture) == is_beside
