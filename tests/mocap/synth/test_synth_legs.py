import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, joint_transforms
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, LOWER, SIDES, UPPER, Side, dofs_of
from services.mocap.synth.legs import FootTargets, put_feet, reach_m, set_ball_joint
from services.mocap.types import Floats

BODY = build_body(Actor(height=1.75))
LEGS = [i for side in SIDES for i in dofs_of(f"{side}_hip", f"{side}_knee", f"{side}_ankle")]


def _poses(seed: int, n: int, share: float) -> Floats:
    """Poses anywhere, headed anywhere, with legs within a share of their limits and bent knees."""
    rng = np.random.default_rng(seed)
    poses = np.zeros((n, N_DOF))
    poses[:, :3] = rng.uniform(-1, 1, (n, 3))
    poses[:, 3:6] = rng.uniform(-1, 1, (n, 3)) * [3.0, 0.3, 0.3]
    poses[:, LEGS] = share * rng.uniform(LOWER[LEGS], UPPER[LEGS], (n, len(LEGS)))
    for side in SIDES:
        poses[:, DOF_INDEX[f"{side}_knee_flexion"]] += 0.1
    return poses


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_feet_get_where_they_should_be(seed: int) -> None:
    poses = _poses(seed, 20, 0.5)
    T_world_joint = joint_transforms(poses, BODY.offsets_m)
    ankles = {side: T_world_joint[:, JOINT_INDEX[f"{side}_ankle"]] for side in SIDES}
    targets: dict[Side, FootTargets] = {
        side: FootTargets(T[:, :3, 3], T[:, :3, :3]) for side, T in ankles.items()
    }
    start = poses.copy()
    start[:, LEGS] = 0.0
    put = put_feet(start, BODY.offsets_m, targets)
    np.testing.assert_array_equal(np.delete(put, LEGS, axis=1), np.delete(poses, LEGS, axis=1))
    found = joint_transforms(put, BODY.offsets_m)
    for side, T in ankles.items():
        np.testing.assert_allclose(found[:, JOINT_INDEX[f"{side}_ankle"]], T, atol=1e-5)
        np.testing.assert_allclose(found[:, JOINT_INDEX[f"{side}_ankle"], :3, 3], T[:, :3, 3], atol=1e-9)


def test_out_of_reach_the_straight_leg_points_there() -> None:
    poses = np.zeros((1, N_DOF))
    hip_m = BODY.offsets_m[JOINT_INDEX["left_hip"]]
    target_m = hip_m + np.array([0.9, 0.0, -1.2])
    put = put_feet(poses, BODY.offsets_m, {"left": FootTargets(target_m[None], np.eye(3)[None])})
    ankle_m = joint_transforms(put, BODY.offsets_m)[0, JOINT_INDEX["left_ankle"], :3, 3]
    assert put[0, DOF_INDEX["left_knee_flexion"]] == 0.0
    expected_m = hip_m + np.array([0.6, 0.0, -0.8]) * reach_m(BODY.offsets_m, "left")
    np.testing.assert_allclose(ankle_m, expected_m, atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_ball_joint_parameters_are_found_again(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for joint, parent in (("left_shoulder", "waist"), ("right_shoulder", "waist"), ("right_hip", "pelvis")):
        rows = list(dofs_of(joint))
        poses = np.zeros((10, N_DOF))
        poses[:, rows] = rng.uniform(LOWER[rows], UPPER[rows], (10, len(rows)))
        T = joint_transforms(poses, BODY.offsets_m)
        R_parent_joint = (
            T[:, JOINT_INDEX[parent], :3, :3].transpose(0, 2, 1) @ T[:, JOINT_INDEX[joint], :3, :3]
        )
        found = np.zeros_like(poses)
        set_ball_joint(found, joint, R_parent_joint)
        swing = np.linalg.norm(poses[:, rows[:2]], axis=1)
        within = swing < np.pi - 1e-3  # beyond half a turn the shorter way round is found
        np.testing.assert_allclose(found[within], poses[within], atol=1e-6)
