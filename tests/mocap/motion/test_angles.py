"""Anatomical angles: known poses give known angles, and the movements are those that the table says."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from services.mocap.body.kinematics import joint_transforms
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, JOINTS, LOWER, SIDES, UPPER
from services.mocap.motion.angles import ANGLES, joint_angles_deg
from services.mocap.motion.motion import rest_pose, rest_rotations, turns_from_rest
from services.mocap.types import Floats

OFFSETS_M: Floats = 1.78 * np.array([joint.offset_heights for joint in JOINTS])
# A parameter of the pose, by so much from hanging arms, and the angles that are then not zero, in degrees.
KNOWN = [
    ("root_heading", 30, {"pelvis_rotation": 30}),
    ("root_lean", 20, {"pelvis_list": 20}),
    ("root_pitch", 25, {"pelvis_tilt": 25}),
    ("head_pitch", 40, {"neck_flexion": 40}),
    ("head_lean", -15, {"neck_lateral_bending": -15}),
    ("head_turn", 60, {"neck_rotation": 60}),
    ("shoulder_elevation", 90, {"shoulder_adduction": -90, "shoulder_elevation": 90}),
    ("shoulder_elevation", 150, {"shoulder_elevation": 150, "shoulder_adduction": -150}),
    ("elbow_flexion", 120, {"elbow_flexion": 120}),
    ("wrist_flexion", 50, {"wrist_flexion": 50}),
    ("wrist_deviation", -20, {"wrist_deviation": 20}),
    ("wrist_twist", 60, {"forearm_pronation": -60}),
    ("hip_flexion", 100, {"hip_flexion": 100}),
    ("hip_abduction", 40, {"hip_adduction": -40}),
    ("hip_twist", 30, {"hip_rotation": 30}),
    ("knee_flexion", 130, {"knee_flexion": 130}),
    ("ankle_flexion", 20, {"ankle_dorsiflexion": 20}),
    ("ankle_inversion", 25, {"ankle_inversion": 25}),
]


def angles_of(*poses: Floats) -> dict[str, Floats]:
    return joint_angles_deg(joint_transforms(np.array(poses), OFFSETS_M))


def places_m(pose: Floats) -> dict[str, Floats]:
    T = joint_transforms(pose[None], OFFSETS_M)[0]
    return {joint.name: T[j, :3, 3] for j, joint in enumerate(JOINTS)}


def changed(**by_deg: float) -> Floats:
    """Hanging arms, and some parameters changed by degrees."""
    pose = rest_pose("hanging")
    for name, angle_deg in by_deg.items():
        pose[DOF_INDEX[name]] += np.radians(angle_deg)
    return pose


def test_the_neutral_pose_is_zero() -> None:
    for name, value in angles_of(rest_pose("hanging")).items():
        assert value == pytest.approx(0.0, abs=1e-9), name


@pytest.mark.parametrize(("parameter", "by_deg", "expected"), KNOWN)
@pytest.mark.parametrize("side", SIDES)
def test_one_parameter_gives_one_angle(
    parameter: str, by_deg: float, expected: dict[str, float], side: str
) -> None:
    sided = parameter not in DOF_INDEX
    found = angles_of(changed(**{f"{side}_{parameter}" if sided else parameter: by_deg}))
    expected = {f"{side}_{name}" if sided else name: value for name, value in expected.items()}
    for name, value in found.items():
        assert value == pytest.approx(expected.get(name, 0.0), abs=1e-7), name


@pytest.mark.parametrize("side", SIDES)
def test_the_movements_are_what_their_names_say(side: str) -> None:
    """Seen from where joints go; x is forward, y to the left, z up."""
    outward = 1.0 if side == "left" else -1.0
    rest = places_m(changed())

    def moved(joint: str, **by_deg: float) -> Floats:
        """How a joint moves from the neutral pose: forward, outward, up."""
        named = {f"{side}_{name}": value for name, value in by_deg.items()}
        shift: Floats = places_m(changed(**named))[f"{side}_{joint}"] - rest[f"{side}_{joint}"]
        return shift * [1.0, outward, 1.0]

    assert moved("wrist", elbow_flexion=40)[0] > 0.1  # the hand goes forward
    assert moved("knee", hip_flexion=40)[0] > 0.1
    assert moved("ankle", knee_flexion=40)[0] < -0.1
    assert moved("knee", hip_abduction=20)[1] > 0.1
    assert moved("wrist", shoulder_elevation=30)[1] > 0.1


@pytest.mark.parametrize("side", SIDES)
def test_turns_about_the_bones_are_what_their_names_say(side: str) -> None:
    outward = 1.0 if side == "left" else -1.0

    def direction(joint: str, axis: list[float], **by_deg: float) -> Floats:
        """Where a direction of the T pose at a joint points: forward, outward, up."""
        named = {f"{side}_{name}": value for name, value in by_deg.items()}
        R = joint_transforms(changed(**named)[None], OFFSETS_M)[0, JOINT_INDEX[f"{side}_{joint}"], :3, :3]
        pointing: Floats = R @ (np.array(axis) * [1.0, outward, 1.0]) * [1.0, outward, 1.0]
        return pointing

    thumb, fingers, toes, sole = [1.0, 0, 0], [0, 1.0, 0], [1.0, 0, 0], [0, 0, -1.0]
    np.testing.assert_allclose(direction("wrist", thumb), [1, 0, 0], atol=1e-9)
    assert direction("wrist", thumb, wrist_twist=-30)[1] < -0.4  # pronation: inward
    assert direction("wrist", fingers, wrist_flexion=30)[1] < -0.4  # to the palm, which faces the thigh
    assert direction("wrist", fingers, wrist_deviation=-30)[0] < -0.4  # away from the thumb
    assert direction("ankle", toes, hip_twist=30)[1] < -0.4
    assert direction("ankle", toes, ankle_flexion=30)[2] > 0.4
    assert direction("ankle", sole, ankle_inversion=30)[1] < -0.4


@pytest.mark.parametrize("side", SIDES)
def test_raising_an_arm_forward_is_flexion_in_the_forward_plane(side: str) -> None:
    pose = rest_pose("hanging")
    # The arm hangs by a swing of -90° about x; forward by 60° of it is another swing, found from its matrix.
    hanging = rest_rotations("hanging")[JOINT_INDEX[f"{side}_shoulder"]]
    swing = (Rotation.from_euler("y", -60, degrees=True) * Rotation.from_matrix(hanging)).as_matrix()
    T = joint_transforms(pose[None], OFFSETS_M)
    for joint in ("shoulder", "elbow", "wrist"):
        j = JOINT_INDEX[f"{side}_{joint}"]
        T[0, j, :3, :3] = swing
    found = joint_angles_deg(T)
    expected = {"flexion": 60, "adduction": 0, "rotation": 0, "plane_of_elevation": 90, "elevation": 60}
    for name, value in expected.items():
        assert found[f"{side}_shoulder_{name}"] == pytest.approx(value, abs=1e-7), name
    assert found[f"{side}_shoulder_axial_rotation"] == pytest.approx(-90, abs=1e-7)


def random_pose(seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    free = np.isinf(LOWER)
    pose: Floats = rng.uniform(np.where(free, -1.4, LOWER), np.where(free, 1.4, UPPER))
    return pose


@given(st.integers(0, 2**32 - 1))
def test_the_angles_tell_every_turn_whole(seed: int) -> None:
    """Turning about the axes that the table names, by its angles, gives the joint's turn back."""
    T = joint_transforms(random_pose(seed)[None], OFFSETS_M)
    found = joint_angles_deg(T)
    turns = turns_from_rest(T, rest_rotations("hanging"))[0]
    basis = {"X": [1.0, 0.0, 0.0], "Y": [0.0, 0.0, 1.0], "Z": [0.0, -1.0, 0.0]}
    for side in ("", *SIDES):
        for joint, order in {(a.joint, a.order) for a in ANGLES if a.is_sided == bool(side)}:
            R = Rotation.identity()
            for place, axis in enumerate(order):
                match = [a for a in ANGLES if (a.joint, a.order, a.place) == (joint, order, place)]
                if match:  # else a hinge, which does not turn so
                    named = f"{side}_{match[0].name}".removeprefix("_")
                    # On the left, x and y turn the other way: the sagittal plane is a mirror.
                    mirror = -1.0 if side == "left" and axis != "Z" else 1.0
                    turn_deg = mirror * match[0].sign * found[named][0]
                    R = R * Rotation.from_rotvec(turn_deg * np.array(basis[axis]), degrees=True)
            expected = turns[JOINT_INDEX[f"{side}_{joint}".removeprefix("_")]]
            np.testing.assert_allclose(R.as_matrix(), expected, atol=1e-9, err_msg=f"{side} {joint} {order}")


@given(st.integers(0, 2**32 - 1))
def test_both_sides_speak_alike(seed: int) -> None:
    pose = random_pose(seed)
    pose[[d for name, d in DOF_INDEX.items() if not name.startswith(SIDES)]] = 0.0
    mirrored = pose.copy()
    for name, d in DOF_INDEX.items():
        if name.startswith(SIDES):
            side = name.split("_")[0]
            other = "right" if side == "left" else "left"
            mirrored[DOF_INDEX[name.replace(side, other, 1)]] = pose[d]
    found, other_way = angles_of(pose), angles_of(mirrored)
    for name, value in found.items():
        if name.startswith("left_"):
            assert value == pytest.approx(other_way[name.replace("left_", "right_", 1)], abs=1e-7), name


def test_spins_go_on_and_arms_over_the_head_do_not_jump() -> None:
    turns = np.linspace(0, 720, 100)
    found = angles_of(*(changed(root_heading=t, left_shoulder_elevation=150 * t / 720) for t in turns))
    np.testing.assert_allclose(found["pelvis_rotation"], turns, atol=1e-7)
    np.testing.assert_allclose(found["left_shoulder_adduction"], -150 * turns / 720, atol=1e-6)


def test_names_are_unique_and_meanings_are_told() -> None:
    found = angles_of(rest_pose("T"))
    assert len(found) == sum(2 if angle.is_sided else 1 for angle in ANGLES) == 43
    assert all(angle.meaning for angle in ANGLES)
    assert found["right_shoulder_elevation"] == pytest.approx(90)
