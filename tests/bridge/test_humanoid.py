"""Bones in Unity's axes: their joints are where ours are, and left stays left."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.bridge.humanoid import BONES, Bone, bones_of
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, joint_positions
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, JOINTS, LOWER, SEGMENT_NAMES, UPPER
from services.mocap.types import Floats

BODY = build_body(Actor(height=1.75))


def places_of(bones: list[Bone]) -> dict[str, Floats]:
    """Where a receiver that knows the bones' parents puts them."""
    parents = {BONES[joint.name]: BONES.get(joint.parent or "") for joint in JOINTS if joint.name in BONES}
    turns: dict[str | None, Rotation] = {None: Rotation.identity()}
    places: dict[str, Floats] = {}
    for bone in bones:
        parent = parents[bone.name]
        base = np.zeros(3) if parent is None else places[parent]
        places[bone.name] = base + turns[parent].apply(bone.position_m)
        turns[bone.name] = turns[parent] * Rotation.from_quat(bone.rotation_xyzw)
    return places


def test_joints_are_where_ours_are() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        pose = rng.uniform(np.maximum(LOWER, -3.0), np.minimum(UPPER, 3.0))
        places, joints_m = (
            places_of(bones_of(pose, BODY.offsets_m)),
            joint_positions(pose[None], BODY.offsets_m)[0],
        )
        assert len(places) == len(SEGMENT_NAMES)
        for joint, bone in BONES.items():
            x, y, z = joints_m[JOINT_INDEX[joint]]
            np.testing.assert_allclose(places[bone], (-y, z, x), atol=1e-9, err_msg=bone)


def test_the_t_pose_turns_no_bone() -> None:
    for bone in bones_of(np.zeros(N_DOF), BODY.offsets_m):
        assert bone.rotation_xyzw == pytest.approx((0.0, 0.0, 0.0, 1.0), abs=1e-12)


def test_a_raised_left_arm_is_the_left_one_of_somebody_who_looks_ahead() -> None:
    pose = np.zeros(N_DOF)
    pose[DOF_INDEX["left_shoulder_elevation"]] = np.radians(80)
    pose[DOF_INDEX["right_elbow_flexion"]] = np.radians(90)
    places = places_of(bones_of(pose, BODY.offsets_m))
    assert places["LeftHand"][1] > places["Head"][1] > places["RightHand"][1]
    assert places["LeftUpperArm"][0] < 0 < places["RightUpperArm"][0]
    assert places["RightHand"][2] > 0.2  # a bent elbow brings the hand before the body


def test_a_turn_to_the_left_is_one() -> None:
    pose = np.zeros(N_DOF)
    pose[DOF_INDEX["root_heading"]] = np.radians(90)
    (hips, *_) = bones_of(pose, BODY.offsets_m)
    ahead = Rotation.from_quat(hips.rotation_xyzw).apply((0.0, 0.0, 1.0))
    np.testing.assert_allclose(ahead, (-1.0, 0.0, 0.0), atol=1e-12)
