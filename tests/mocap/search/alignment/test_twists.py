"""Twists are the derivatives of where points of the body are."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, N_JOINTS, joint_transforms
from services.mocap.body.skeleton import LOWER, UPPER
from services.mocap.search.alignment.twists import DOF_JOINT, MOVED_BY, TWIST_SIZE, place_twists

OFFSETS_M = build_body(Actor()).offsets_m
STEP = 1e-6


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_points_move_as_the_twists_say(seed: int, at_rest: bool) -> None:
    rng = np.random.default_rng(seed)
    pose = rng.uniform(np.maximum(LOWER, -3), np.minimum(UPPER, 3)) * (not at_rest)
    T_world_joint = joint_transforms(pose[None], OFFSETS_M)[0]
    twists = np.zeros((N_DOF, TWIST_SIZE))
    place_twists(pose, T_world_joint, twists)

    points_m = rng.normal(0, 0.2, (N_JOINTS, 3))  # one rides on every joint

    def world_m(moved: np.ndarray) -> np.ndarray:
        T = joint_transforms(moved, OFFSETS_M)
        return np.einsum("njik,jk->nji", T[..., :3, :3], points_m) + T[..., :3, 3]

    steps = STEP * np.eye(N_DOF)
    velocities = (world_m(pose + steps) - world_m(pose - steps)) / (2 * STEP)
    here = world_m(pose[None])[0]
    expected = np.cross(twists[:, None, :3], here[None]) + twists[:, None, 3:]
    expected *= MOVED_BY[DOF_JOINT][:, :, None]
    np.testing.assert_allclose(velocities, expected, atol=1e-6)
