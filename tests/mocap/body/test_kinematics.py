"""Forward kinematics: against scipy's rotations, and what must hold in every pose."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from poses_within_limits import FEW, OFFSETS_M, POSES
from scipy.spatial.transform import Rotation

from services.mocap.body.kinematics import (
    N_DOF,
    joint_positions,
    joint_transforms,
    segment_transforms,
)
from services.mocap.body.skeleton import (
    DOF_INDEX,
    DOFS,
    JOINT_INDEX,
    JOINT_NAMES,
    JOINTS,
    LOWER,
    SEGMENT_JOINT,
    UPPER,
)
from services.mocap.types import Floats

MIRROR_Y = np.array([1.0, -1.0, 1.0])
# Parameters that move the body off its plane of symmetry: mirrored, they change sign.
SIDEWAYS = ("root_y", "root_heading", "root_lean", "waist_lean", "waist_turn", "head_lean", "head_turn")


def swapped(name: str) -> str:
    """The same name on the other side."""
    for side, other in (("left_", "right_"), ("right_", "left_")):
        if name.startswith(side):
            return other + name.removeprefix(side)
    return name


SWAPPED_DOFS = [DOF_INDEX[swapped(dof.name)] for dof in DOFS]
SWAPPED_JOINTS = [JOINT_INDEX[swapped(name)] for name in JOINT_NAMES]


def by_scipy(pose: Floats) -> Floats:
    """T_world_joint (J, 4, 4), straight from the words in skeleton.py."""
    T_world_joint = np.tile(np.eye(4), (len(JOINTS), 1, 1))
    for j, joint in enumerate(JOINTS):
        mine = [(dof, value) for dof, value in zip(DOFS, pose, strict=True) if dof.joint == joint.name]
        swing = sum((value * np.array(dof.axis) for dof, value in mine if dof.role == "swing"), np.zeros(3))
        turn = Rotation.from_rotvec(swing)
        for role in ("heading", "lean", "pitch", "twist"):
            for dof, value in mine:
                if dof.role == role:
                    turn = turn * Rotation.from_rotvec(value * np.array(dof.axis))
        local = np.eye(4)
        local[:3, :3] = turn.as_matrix()
        local[:3, 3] = OFFSETS_M[j]
        for dof, value in mine:
            if dof.role == "translation":
                local[:3, 3] += value * np.array(dof.axis)
        parent = np.eye(4) if joint.parent is None else T_world_joint[JOINT_INDEX[joint.parent]]
        T_world_joint[j] = parent @ local
    return T_world_joint


def posed(**values_deg: float) -> dict[str, Floats]:
    """Joint centres of the rest pose with some parameters changed."""
    pose = np.zeros(N_DOF)
    for name, value in values_deg.items():
        pose[DOF_INDEX[name]] = np.radians(value)
    return dict(zip(JOINT_NAMES, joint_positions(pose[None], OFFSETS_M)[0], strict=True))


def directions(segment: str, **values_deg: float) -> Floats:
    """The axes (3, 3), in columns, of a segment's frame in the world, all else in the rest pose."""
    pose = np.zeros(N_DOF)
    for name, value in values_deg.items():
        pose[DOF_INDEX[name]] = np.radians(value)
    T_world_segment = segment_transforms(pose[None], OFFSETS_M)[0]
    R: Floats = T_world_segment[list(SEGMENT_JOINT).index(segment), :3, :3]
    return R


@FEW
@given(POSES)
def test_agrees_with_scipy(pose: Floats) -> None:
    np.testing.assert_allclose(joint_transforms(pose[None], OFFSETS_M)[0], by_scipy(pose), atol=1e-12)


@FEW
@given(POSES)
def test_rotations_are_proper_and_bones_keep_their_lengths(pose: Floats) -> None:
    T = joint_transforms(pose[None], OFFSETS_M)[0]
    R = T[:, :3, :3]
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-12)
    np.testing.assert_array_equal(T[:, 3], np.tile([0.0, 0.0, 0.0, 1.0], (len(T), 1)))
    parents = [JOINT_INDEX[joint.parent] for joint in JOINTS if joint.parent is not None]
    bones_m = np.linalg.norm(T[1:, :3, 3] - T[parents, :3, 3], axis=1)
    np.testing.assert_allclose(bones_m, np.linalg.norm(OFFSETS_M[1:], axis=1), atol=1e-12)


@FEW
@given(POSES, arrays(np.float64, 3, elements=st.floats(-5, 5, width=32)), st.floats(-7, 7, width=32))
def test_moving_and_turning_the_root_moves_all_rigidly(pose: Floats, shift_m: Floats, turn: float) -> None:
    moved = pose.copy()
    moved[:3] = Rotation.from_rotvec([0.0, 0.0, turn]).apply(pose[:3]) + shift_m
    moved[DOF_INDEX["root_heading"]] += turn
    turned = Rotation.from_rotvec([0.0, 0.0, turn]).apply(joint_positions(pose[None], OFFSETS_M)[0])
    np.testing.assert_allclose(joint_positions(moved[None], OFFSETS_M)[0], turned + shift_m, atol=1e-11)


@FEW
@given(POSES)
def test_a_mirrored_pose_has_mirrored_joints(pose: Floats) -> None:
    mirrored = pose[SWAPPED_DOFS]
    mirrored[[DOF_INDEX[name] for name in SIDEWAYS]] *= -1
    expected = joint_positions(pose[None], OFFSETS_M)[0][SWAPPED_JOINTS] * MIRROR_Y
    np.testing.assert_allclose(joint_positions(mirrored[None], OFFSETS_M)[0], expected, atol=1e-12)


@FEW
@given(st.lists(POSES, min_size=1, max_size=4))
def test_a_batch_equals_one_by_one(poses: list[Floats]) -> None:
    batch = joint_transforms(np.array(poses), OFFSETS_M)
    for pose, T_world_joint in zip(poses, batch, strict=True):
        np.testing.assert_array_equal(joint_transforms(pose[None], OFFSETS_M)[0], T_world_joint)


@given(POSES, st.integers(0, N_DOF - 1))
@FEW
def test_a_parameter_moves_nothing_above_its_joint(pose: Floats, dof: int) -> None:
    changed = pose.copy()
    changed[dof] += 0.3
    before, after = joint_transforms(np.stack([pose, changed]), OFFSETS_M)
    moved = {name for name, a, b in zip(JOINT_NAMES, before, after, strict=True) if not np.allclose(a, b)}
    below = {DOFS[dof].joint}
    for joint in JOINTS:
        if joint.parent in below:
            below.add(joint.name)
    assert moved == below


def test_views_and_derived_arrays_agree() -> None:
    poses = np.random.default_rng(2).uniform(-1, 1, (4, 2 * N_DOF))[:, ::2]
    T_world_joint = joint_transforms(poses, OFFSETS_M)
    np.testing.assert_array_equal(T_world_joint, joint_transforms(poses.copy(), OFFSETS_M))
    np.testing.assert_array_equal(joint_positions(poses, OFFSETS_M), T_world_joint[:, :, :3, 3])
    carriers = [JOINT_INDEX[joint] for joint in SEGMENT_JOINT.values()]
    np.testing.assert_array_equal(segment_transforms(poses, OFFSETS_M), T_world_joint[:, carriers])


@pytest.mark.parametrize("shape", [(N_DOF,), (2, N_DOF - 1), (1, 1, N_DOF)])
def test_other_shapes_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=rf"poses: expected shape \(N, {N_DOF}\), got"):
        joint_transforms(np.zeros(shape), OFFSETS_M)


def test_no_poses_give_no_transforms() -> None:
    assert joint_transforms(np.zeros((0, N_DOF)), OFFSETS_M).shape == (0, len(JOINTS), 4, 4)


def test_rest_pose_is_a_t() -> None:
    at = posed()
    for joint in JOINTS:
        start = np.zeros(3) if joint.parent is None else at[joint.parent]
        np.testing.assert_allclose(at[joint.name], start + OFFSETS_M[JOINT_INDEX[joint.name]], atol=1e-15)
    arm = [at[name] for name in ("left_shoulder", "left_elbow", "left_wrist")]
    for nearer, further in pairwise(arm):
        assert further[1] > nearer[1]
        np.testing.assert_allclose(further[[0, 2]], nearer[[0, 2]])


def hanging(**more_deg: float) -> dict[str, Floats]:
    arms = {f"{side}_shoulder_elevation": -90.0 for side in ("left", "right")}
    return posed(**arms, **more_deg)


def test_hanging_arms() -> None:
    at = hanging()
    for side, outwards in (("left", 1.0), ("right", -1.0)):
        wrist, shoulder = at[f"{side}_wrist"], at[f"{side}_shoulder"]
        assert wrist[2] < at[f"{side}_elbow"][2] < shoulder[2]
        assert outwards * wrist[1] > outwards * at[f"{side}_hip"][1]  # beside the body, not in it
        np.testing.assert_allclose(wrist[:2], shoulder[:2], atol=1e-12)


def test_hands_reach_behind_the_head_within_the_limits() -> None:
    """As before a throw with both hands: elbows ahead of the face, hands behind the head."""
    arm = {"shoulder_elevation": 60, "shoulder_forward": 30, "shoulder_twist": 135, "elbow_flexion": 120}
    pose_deg = {f"{side}_{name}": value for side in ("left", "right") for name, value in arm.items()}
    for name, value in pose_deg.items():
        assert LOWER[DOF_INDEX[name]] <= np.radians(value) <= UPPER[DOF_INDEX[name]]
    at = posed(**pose_deg)
    for side in ("left", "right"):
        assert at[f"{side}_elbow"][0] > at["neck"][0] + 0.1
        assert at[f"{side}_wrist"][0] < at["neck"][0] - 0.1
        assert at[f"{side}_wrist"][2] > at["neck"][2] + 0.1


@pytest.mark.parametrize("side", ["left", "right"])
class TestSigns:
    """A parameter means the same movement on both sides: `outwards` is +y on the left."""

    def moved(self, joint: str, side: str, dof: str, value_deg: float = 30.0) -> Floats:
        """How far a joint goes ahead (x), outwards (y) and up (z) from the rest pose."""
        move = posed(**{f"{side}_{dof}": value_deg})[f"{side}_{joint}"] - posed()[f"{side}_{joint}"]
        return move if side == "left" else move * MIRROR_Y

    def axes(self, segment: str, side: str, dof: str, value_deg: float = 30.0) -> Floats:
        """A segment's turned frame, in columns: ahead, outwards, up."""
        R = directions(f"{side}_{segment}", **{f"{side}_{dof}": value_deg})
        return R if side == "left" else R * np.outer(MIRROR_Y, MIRROR_Y)

    def test_shoulder_elevation_raises_the_arm(self, side: str) -> None:
        assert self.moved("wrist", side, "shoulder_elevation")[2] > 0.2

    def test_shoulder_forward_brings_the_arm_forward(self, side: str) -> None:
        assert self.moved("wrist", side, "shoulder_forward")[0] > 0.2

    def test_shoulder_twist_turns_the_palm_forward_which_is_outward_rotation(self, side: str) -> None:
        palm = -self.axes("upper_arm", side, "shoulder_twist")[:, 2]
        assert palm[0] == pytest.approx(0.5)

    def test_elbow_flexion_brings_the_wrist_forward_where_the_arm_hangs(self, side: str) -> None:
        straight, bent = hanging(), hanging(**{f"{side}_elbow_flexion": 90.0})
        forearm_m = float(np.linalg.norm(OFFSETS_M[JOINT_INDEX["left_wrist"]]))
        np.testing.assert_allclose(bent[f"{side}_elbow"], straight[f"{side}_elbow"], atol=1e-12)
        np.testing.assert_allclose(
            bent[f"{side}_wrist"] - bent[f"{side}_elbow"], [forearm_m, 0.0, 0.0], atol=1e-12
        )

    def test_wrist_flexion_bends_towards_the_palm(self, side: str) -> None:
        fingers = self.axes("hand", side, "wrist_flexion")[:, 1]
        np.testing.assert_allclose(fingers, [0.0, np.cos(np.pi / 6), -0.5], atol=1e-12)

    def test_wrist_deviation_bends_towards_the_thumb(self, side: str) -> None:
        fingers = self.axes("hand", side, "wrist_deviation")[:, 1]
        np.testing.assert_allclose(fingers, [0.5, np.cos(np.pi / 6), 0.0], atol=1e-12)

    def test_wrist_twist_turns_the_palm_forward_which_is_supination(self, side: str) -> None:
        assert -self.axes("hand", side, "wrist_twist")[0, 2] == pytest.approx(0.5)

    def test_hip_flexion_lifts_the_knee_forward(self, side: str) -> None:
        knee = self.moved("knee", side, "hip_flexion")
        assert knee[0] > 0.2
        assert knee[2] > 0.0

    def test_hip_abduction_takes_the_knee_outwards(self, side: str) -> None:
        assert self.moved("knee", side, "hip_abduction")[1] > 0.2

    def test_hip_twist_turns_the_toes_inwards(self, side: str) -> None:
        toes = self.axes("foot", side, "hip_twist")[:, 0]
        assert toes[1] == pytest.approx(-0.5)

    def test_knee_flexion_takes_the_ankle_back(self, side: str) -> None:
        ankle = self.moved("ankle", side, "knee_flexion")
        assert ankle[0] < -0.2
        assert ankle[2] > 0.0

    def test_ankle_flexion_lifts_the_toes(self, side: str) -> None:
        toes = self.axes("foot", side, "ankle_flexion")[:, 0]
        assert toes[2] == pytest.approx(0.5)

    def test_ankle_inversion_turns_the_sole_inwards(self, side: str) -> None:
        sole = -self.axes("foot", side, "ankle_inversion")[:, 2]
        assert sole[1] == pytest.approx(-0.5)


def test_signs_of_head_and_root() -> None:
    rest = posed()
    assert posed(head_pitch=30)["head_top"][0] > rest["head_top"][0] + 0.1  # a nod
    assert posed(head_lean=30)["head_top"][1] < -0.1  # to the right
    assert directions("head", head_turn=30)[1, 0] == pytest.approx(0.5)  # the nose to the left
    assert posed(root_pitch=30)["neck"][0] > 0.2  # a bow
    assert posed(root_lean=30)["neck"][1] < -0.2  # to the right
    assert directions("pelvis", root_heading=30)[1, 0] == pytest.approx(0.5)  # to the left
