"""The frames of cloth: a skirt hangs from the pelvis and on the legs."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from poses_within_limits import FEW, OFFSETS_M, POSES

from services.mocap.body.kinematics import (
    CLOTH_FRAMES,
    HANGING,
    N_DOF,
    SURFACE_FRAMES,
    frame_transforms,
    moving_frames,
    place_frames,
)
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, SIDES, dofs_of
from services.mocap.types import Floats

LEG = ("hip", "knee", "ankle")


def with_hem(hem_m: float) -> Floats:
    """Offsets (J + 1, 3) of a body in a skirt, whose hem is so far under the pelvis."""
    return np.vstack([OFFSETS_M, (0.0, 0.0, -hem_m)])


def corners_of_webs(T_world_frame: Floats) -> Floats:
    """(4, 2, 2, 3) of every web the two points of each leg."""
    T = T_world_frame[CLOTH_FRAMES[1:]]
    origins_m, ways_m = T[:, :3, 3], np.moveaxis(T[:, :3, :3], 2, 1)
    corners_m = np.concatenate([origins_m[:, None], origins_m[:, None] + ways_m], axis=1)
    return np.asarray(corners_m.reshape(-1, 2, 2, 3))


def distance_m(point_m: Floats, joints_m: Floats) -> float:
    """From a point (3,) to the nearest of the lines between joints (N, 3)."""
    distances_m = []
    for a, b in pairwise(joints_m):
        share = np.clip((point_m - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        distances_m.append(np.linalg.norm(a + share * (b - a) - point_m))
    return float(min(distances_m))


@FEW
@given(POSES)
def test_cloth_hangs_halfway_between_the_pelvis_and_upright(pose: Floats) -> None:
    T = frame_transforms(pose[None], OFFSETS_M)[0]
    pelvis, hanging = T[JOINT_INDEX["pelvis"]], T[HANGING]
    np.testing.assert_allclose(hanging[:3, :3] @ hanging[:3, :3].T, np.eye(3), atol=1e-9)
    np.testing.assert_array_equal(hanging[:3, 3], pelvis[:3, 3])
    up, of_pelvis = np.array([0.0, 0.0, 1.0]), pelvis[:3, 2]
    # The z axes of all three in one plane, and the turns to both sides equal.
    assert hanging[:3, 2] @ up == pytest.approx(hanging[:3, 2] @ of_pelvis, abs=1e-6)
    assert np.linalg.det([hanging[:3, 2], up, of_pelvis]) == pytest.approx(0.0, abs=1e-6)


@FEW
@given(POSES, st.floats(0.1, 0.8))
def test_webs_hang_on_the_legs(pose: Floats, hem_m: float) -> None:
    T = frame_transforms(pose[None], with_hem(hem_m))[0]
    corners_m = corners_of_webs(T)  # (4, 2, 2, 3)
    legs_m = np.array([[T[JOINT_INDEX[f"{side}_{at}"], :3, 3] for at in LEG] for side in SIDES])
    up = T[HANGING, :3, 2]
    depths_m = (T[HANGING, :3, 3] - corners_m) @ up
    np.testing.assert_allclose(corners_m[0, :, 0], legs_m[:, 0], atol=1e-12)
    assert np.all(depths_m[1:] < max(hem_m, depths_m[0, :, 0].max()) + 1e-9)
    for side in range(2):
        knee_m, leaves_m, below_m, under_knee_m = corners_m[[0, 1, 2, 3], side, 1]
        for on_leg_m, hanging_m in ((leaves_m, below_m), (knee_m, under_knee_m)):
            assert distance_m(on_leg_m, legs_m[side]) < 1e-9
            down = on_leg_m - hanging_m
            np.testing.assert_allclose(down, max(down @ up, 0.0) * up, atol=1e-9)


@FEW
@given(POSES, st.floats(0.1, 0.8), st.integers(0, 2**31))
def test_webs_do_not_jump(pose: Floats, hem_m: float, seed: int) -> None:
    nudged = pose + 1e-4 * np.random.default_rng(seed).uniform(-1.0, 1.0, N_DOF)
    before, after = (
        corners_of_webs(frame_transforms(each[None], with_hem(hem_m))[0]) for each in (pose, nudged)
    )
    assert np.abs(after - before).max() < 0.02


@pytest.mark.parametrize("axis", ["root_pitch", "root_lean"])
def test_cloth_of_somebody_upside_down_is_turned_as_the_pelvis(axis: str) -> None:
    pose = np.zeros(N_DOF)
    pose[DOF_INDEX[axis]] = np.pi
    T = frame_transforms(pose[None], with_hem(0.5))[0]
    assert np.isfinite(T).all()
    np.testing.assert_array_equal(T[HANGING, :3, :3], T[JOINT_INDEX["pelvis"], :3, :3])


def test_the_hem_of_someone_who_stands_is_level() -> None:
    T = frame_transforms(np.zeros((1, N_DOF)), with_hem(0.6))[0]
    corners_m = corners_of_webs(T)
    np.testing.assert_allclose(corners_m[1:, :, 1, 2], T[HANGING, 2, 3] - 0.6, atol=1e-9)


def test_cloth_hangs_down_from_a_raised_knee() -> None:
    pose = np.zeros(N_DOF)
    pose[[DOF_INDEX["left_hip_flexion"], DOF_INDEX["left_knee_flexion"]]] = np.pi / 2
    T = frame_transforms(pose[None], with_hem(0.6))[0]
    knee_m, under_knee_m = corners_of_webs(T)[3, 0]
    assert knee_m[0] == under_knee_m[0] == pytest.approx(-OFFSETS_M[JOINT_INDEX["left_knee"], 2])
    assert under_knee_m[2] == pytest.approx(T[HANGING, 2, 3] - 0.6)


@FEW
@given(POSES, POSES, st.sampled_from(["left_hip", "right_knee", "left_shoulder", "pelvis"]))
def test_placing_only_what_moves_is_enough(one: Floats, other: Floats, joint: str) -> None:
    changed, dofs = one.copy(), dofs_of(joint)
    changed[list(dofs)] = other[list(dofs)]
    placed = frame_transforms(one[None], with_hem(0.5))[0]
    moving = moving_frames(dofs, tuple(range(len(SURFACE_FRAMES))))
    place_frames(changed, with_hem(0.5), moving, placed)
    whole = frame_transforms(changed[None], with_hem(0.5))[0]
    np.testing.assert_array_equal(placed[SURFACE_FRAMES], whole[SURFACE_FRAMES])
    n_cloth = {"left_hip": 4, "right_knee": 4, "left_shoulder": 0, "pelvis": 5}[joint]
    assert np.isin(CLOTH_FRAMES, moving).sum() == n_cloth
