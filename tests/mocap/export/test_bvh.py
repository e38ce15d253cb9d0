"""The BVH writer against an independent reader that does forward kinematics straight from the file."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.garments import Skirt
from services.mocap.body.humanoid_names import Naming, bone_names, matched_joints
from services.mocap.body.kinematics import N_DOF, joint_positions
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, JOINT_NAMES, JOINTS, LOWER, UPPER
from services.mocap.export.bvh import write_bvh
from services.mocap.motion.motion import Rest, rest_pose
from services.mocap.types import Floats

OFFSETS_M: Floats = 1.78 * np.array([joint.offset_heights for joint in JOINTS])


@dataclass
class Node:
    """A joint of the file; tips are called after their joint, with _end."""

    name: str
    parent: int
    offset: Floats
    channels: list[str] = field(default_factory=list)


@dataclass
class Bvh:
    """A file read back: what stands in it, nothing reckoned."""

    nodes: list[Node]
    frame_time_s: float
    motion: Floats

    def positions(self) -> dict[str, Floats]:
        """Every node's world positions (N, 3), in the file's axes and unit."""
        T_world: list[Floats] = []
        column = 0
        for node in self.nodes:
            T = np.tile(np.eye(4), (len(self.motion), 1, 1))
            T[:, :3, 3] = node.offset
            for channel in node.channels:
                T = T @ _channel_transform(channel, self.motion[:, column])
                column += 1
            T_world.append(T if node.parent < 0 else T_world[node.parent] @ T)
        assert column == self.motion.shape[1]
        return {node.name: T[:, :3, 3] for node, T in zip(self.nodes, T_world, strict=True)}

    def angles_deg(self, name: str) -> Floats:
        """A joint's three rotation columns (N, 3), in the file's order."""
        column = 0
        for node in self.nodes:
            column += len(node.channels)
            if node.name == name:
                return self.motion[:, column - 3 : column]
        raise KeyError(name)


def _channel_transform(channel: str, values: Floats) -> Floats:
    axis = "XYZ".index(channel[0])
    T = np.tile(np.eye(4), (len(values), 1, 1))
    if channel[1:] == "position":
        T[:, axis, 3] = values
        return T
    assert channel[1:] == "rotation"
    i, j = (axis + 1) % 3, (axis + 2) % 3
    T[:, i, i] = T[:, j, j] = np.cos(np.radians(values))
    T[:, j, i] = np.sin(np.radians(values))
    T[:, i, j] = -T[:, j, i]
    return T


def read_bvh(path: Path) -> Bvh:
    """Read a BVH file by its published grammar."""
    head, motion = path.read_text("ascii").split("MOTION\n")
    words = iter(head.split())
    assert [next(words), next(words)] == ["HIERARCHY", "ROOT"]
    nodes: list[Node] = []
    _read_node(words, next(words), -1, nodes)
    assert next(words, None) is None
    frames, frame_time, *rows = motion.splitlines()
    data = np.array([row.split() for row in rows], float)
    assert frames == f"Frames: {len(data)}"
    return Bvh(nodes, float(frame_time.removeprefix("Frame Time: ")), data)


def _read_node(words: Iterator[str], name: str, parent: int, nodes: list[Node]) -> None:
    assert [next(words), next(words)] == ["{", "OFFSET"]
    index = len(nodes)
    nodes.append(Node(name, parent, np.array([float(next(words)) for _ in range(3)])))
    while (word := next(words)) != "}":
        if word == "CHANNELS":
            nodes[index].channels = [next(words) for _ in range(int(next(words)))]
        elif word == "JOINT":
            _read_node(words, next(words), index, nodes)
        else:
            assert [word, next(words)] == ["End", "Site"]
            _read_node(words, f"{name}_end", index, nodes)


def written(
    folder: Path,
    poses: Floats,
    fps: float = 30.0,
    unit: Literal["m", "cm"] = "m",
    rest: Rest = "T",
    naming: Naming = "xormocap",
) -> Bvh:
    write_bvh(folder / "motion.bvh", poses, OFFSETS_M, fps, unit=unit, rest=rest, naming=naming)
    assert [file.name for file in folder.iterdir()] == ["motion.bvh"]
    return read_bvh(folder / "motion.bvh")


def random_poses(seed: int, count: int) -> Floats:
    """Poses anywhere within the limits; the root anywhere, in any orientation, turned many times."""
    free = np.isinf(LOWER)
    rng = np.random.default_rng(seed)
    return rng.uniform(np.where(free, -10.0, LOWER), np.where(free, 10.0, UPPER), (count, len(LOWER)))


def pose_of(**parameters: float) -> Floats:
    pose = np.zeros(len(LOWER))
    for name, value in parameters.items():
        pose[DOF_INDEX[name]] = value
    return pose


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 12),
    st.sampled_from(("m", "cm")),
    st.sampled_from(get_args(Rest)),
)
def test_every_joint_is_where_the_kinematics_put_it(
    seed: int, count: int, unit: Literal["m", "cm"], rest: Rest
) -> None:
    poses = random_poses(seed, count)
    expected_m = joint_positions(poses, OFFSETS_M)[..., [1, 2, 0]]
    with TemporaryDirectory() as folder:
        positions = written(Path(folder), poses, unit=unit, rest=rest).positions()
    positions["head_top"] = positions.pop("head_end")
    read_m = np.stack([positions[name] for name in JOINT_NAMES], axis=1) / {"m": 1.0, "cm": 100.0}[unit]
    np.testing.assert_allclose(read_m, expected_m, rtol=0, atol=1e-6)


def test_gimbal_lock_loses_nothing(tmp_path: Path) -> None:
    quarter = np.pi / 2
    poses = np.stack(
        [
            pose_of(root_pitch=angle, root_heading=heading, root_lean=0.3, left_knee_flexion=quarter)
            for angle in (quarter, -quarter, quarter - 1e-7, quarter - 1e-8, quarter + 1e-6)
            for heading in (0.0, 1.0, 4.0)
        ]
    )
    positions = written(tmp_path, poses).positions()
    expected_m = joint_positions(poses, OFFSETS_M)[..., [1, 2, 0]]
    for name in ("left_wrist", "left_ankle", "right_ankle"):
        np.testing.assert_allclose(positions[name], expected_m[:, JOINT_INDEX[name]], rtol=0, atol=1e-6)


def test_stands_upright_and_faces_z(tmp_path: Path) -> None:
    positions = {
        name: place[0] for name, place in written(tmp_path, pose_of(root_z=0.91314)[None]).positions().items()
    }
    assert positions["head_end"][1] > 1.7 and abs(positions["head_end"][0]) < 1e-9
    assert positions["left_ankle_end"][1] == pytest.approx(positions["right_ankle_end"][1], abs=1e-6)
    assert positions["left_ankle_end"][1] == pytest.approx(0.0, abs=1e-6)  # the toes touch the floor
    assert positions["left_ankle_end"][2] - positions["left_ankle"][2] == pytest.approx(0.201, abs=0.005)
    hand = positions["left_wrist_end"] - positions["left_wrist"]
    np.testing.assert_allclose(hand, [0.192, 0.0, 0.0], atol=0.005)
    assert positions["left_wrist"][0] > 0.7 and positions["right_wrist"][0] < -0.7


def test_a_step_forward_and_left(tmp_path: Path) -> None:
    stand, step = written(
        tmp_path, np.stack([pose_of(), pose_of(root_x=1.0, root_y=0.25, root_z=0.5)])
    ).positions()["pelvis"]
    np.testing.assert_allclose(step - stand, [0.25, 0.5, 1.0], atol=1e-9)


def test_heading_turns_about_y_without_jumps(tmp_path: Path) -> None:
    heading = np.linspace(0.0, np.radians(720.0), 145)
    bvh = written(tmp_path, np.stack([pose_of(root_heading=angle) for angle in heading]))
    np.testing.assert_allclose(bvh.angles_deg("pelvis")[:, 2], np.degrees(heading), atol=1e-6)
    np.testing.assert_allclose(bvh.angles_deg("pelvis")[:, :2], 0.0, atol=1e-6)


def test_spin_with_all_limbs_moving_has_no_jumps(tmp_path: Path) -> None:
    phase = np.linspace(0.0, 1.0, 289)
    poses = np.stack(
        [
            pose_of(
                root_heading=np.radians(720.0) * p,
                root_lean=0.2 * np.sin(20 * p),
                root_pitch=0.4 * np.sin(15 * p),
                left_knee_flexion=np.radians(75.0) * (1.0 - np.cos(12 * p)),
                right_hip_flexion=np.radians(120.0) * np.sin(np.pi * p),
                left_shoulder_elevation=-1.3 * np.sin(9 * p) ** 2,
                right_elbow_flexion=np.radians(150.0) * p,
                head_turn=np.sin(8 * p),
            )
            for p in phase
        ]
    )
    motion = written(tmp_path, poses).motion
    assert np.abs(np.diff(motion[:, 3:], axis=0)).max() < 10.0


def test_somersault_over_the_pole_has_no_jumps(tmp_path: Path) -> None:
    """Exactly through gimbal lock, four times."""
    pitch = np.radians(np.arange(0.0, 721.0, 5.0))
    bvh = written(tmp_path, np.stack([pose_of(root_pitch=angle) for angle in pitch]))
    np.testing.assert_allclose(bvh.angles_deg("pelvis")[:, 1], np.degrees(pitch), atol=1e-5)
    np.testing.assert_allclose(bvh.angles_deg("pelvis")[:, [0, 2]], 0.0, atol=1e-5)


def test_twist_stays_while_the_thigh_lifts_through_gimbal_lock(tmp_path: Path) -> None:
    flexion = np.radians(np.arange(60.0, 121.0, 10.0))
    bvh = written(tmp_path, np.stack([pose_of(left_hip_flexion=f, left_hip_twist=0.4) for f in flexion]))
    expected_deg = [[0.0, -np.degrees(f), -np.degrees(0.4)] for f in flexion]
    np.testing.assert_allclose(bvh.angles_deg("left_hip"), expected_deg, atol=1e-5)


def test_a_knee_is_a_hinge_beyond_a_right_angle_from_the_first_frame(tmp_path: Path) -> None:
    bvh = written(tmp_path, pose_of(left_knee_flexion=np.radians(140.0))[None])
    np.testing.assert_allclose(bvh.angles_deg("left_knee"), [[0.0, 140.0, 0.0]], atol=1e-6)


def test_names_channels_and_time(tmp_path: Path) -> None:
    bvh = written(tmp_path, random_poses(0, 7), fps=29.97)
    joints = [node for node in bvh.nodes if node.channels]
    assert {node.name for node in joints} == set(JOINT_NAMES) - {"head_top"}
    rotations = ["Zrotation", "Xrotation", "Yrotation"]
    assert joints[0].channels == ["Xposition", "Yposition", "Zposition", *rotations]
    assert all(node.channels == rotations for node in joints[1:])
    tips = {f"{name}_end" for name in ("head", "left_wrist", "right_wrist", "left_ankle", "right_ankle")}
    assert {node.name for node in bvh.nodes if not node.channels} == tips
    for node in joints[1:]:
        parent = JOINTS[JOINT_INDEX[node.name]].parent
        assert bvh.nodes[node.parent].name == parent
    assert bvh.frame_time_s == pytest.approx(1 / 29.97, abs=1e-9)
    assert bvh.motion.shape == (7, 51)


@pytest.mark.parametrize("naming", get_args(Naming))
def test_joints_have_the_names_asked_for_in_the_same_order(tmp_path: Path, naming: Naming) -> None:
    poses, names = random_poses(1, 3), bone_names(naming)
    ours, theirs = written(tmp_path, poses), written(tmp_path, poses, naming=naming)
    expected = [names.get(node.name.removesuffix("_end")) for node in ours.nodes]
    assert [node.name.removesuffix("_end") for node in theirs.nodes] == expected
    np.testing.assert_array_equal(theirs.motion, ours.motion)
    assert matched_joints(names.values()) == names


def test_who_stands_in_the_rest_pose_has_no_angles(tmp_path: Path) -> None:
    for rest in get_args(Rest):
        bvh = written(tmp_path, rest_pose(rest)[None], rest=rest)
        np.testing.assert_allclose(bvh.motion, 0.0, atol=1e-6)
    hand = bvh.positions()["left_wrist_end"] - bvh.positions()["left_shoulder"]  # in the A pose
    np.testing.assert_allclose(hand[0, 0], -hand[0, 1], atol=1e-5)
    assert hand[0, 0] > 0.3


def test_a_skirt_changes_nothing(tmp_path: Path) -> None:
    poses = random_poses(2, 3)
    for name, skirt in (("bare", None), ("skirted", Skirt(length=0.3, flare=0.05))):
        write_bvh(tmp_path / name, poses, build_body(Actor(skirt=skirt)).offsets_m, 30.0)
    assert (tmp_path / "skirted").read_bytes() == (tmp_path / "bare").read_bytes()


@pytest.mark.parametrize(
    "poses", [np.zeros((0, N_DOF)), np.full((2, N_DOF), np.nan), np.zeros((2, N_DOF - 1))]
)
def test_bad_poses_leave_no_file(tmp_path: Path, poses: Floats) -> None:
    with pytest.raises(ValueError, match="poses: expected"):
        write_bvh(tmp_path / "motion.bvh", poses, OFFSETS_M, 30.0)
    assert not list(tmp_path.iterdir())
