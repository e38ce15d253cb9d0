"""The table of typical poses: within the limits, with mirror images, and made of medoids."""

from pathlib import Path

import numpy as np

from bench.typical_poses import mirror_images, typical, write_typical
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import clip_to_limits, joint_positions
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX
from services.mocap.search.typical_poses import TABLE, TOLD, typical_poses

_ROUNDING_RAD = 0.006


def test_all_are_within_the_limits_and_the_first_is_the_t_pose() -> None:
    poses = typical_poses()
    np.testing.assert_allclose(clip_to_limits(poses), poses, atol=_ROUNDING_RAD)
    assert not poses[0].any()


def test_every_pose_comes_with_its_mirror_image() -> None:
    first, images = np.split(typical_poses()[1:], 2)
    np.testing.assert_array_equal(mirror_images(first), images)


def test_a_mirror_image_has_its_joints_on_the_other_side() -> None:
    body = build_body(Actor(height=1.75))
    poses = typical_poses()
    joints_m, images_m = (joint_positions(each, body.offsets_m) for each in (poses, mirror_images(poses)))
    for name, index in JOINT_INDEX.items():
        other = JOINT_INDEX[
            name.replace("left_", "right_") if name.startswith("left_") else name.replace("right_", "left_")
        ]
        np.testing.assert_allclose(images_m[:, other], joints_m[:, index] * [1.0, -1.0, 1.0], atol=1e-9)


def test_medoids_are_of_the_poses_and_near_them() -> None:
    """Poses about three, one of them the mirror image of another, have two medoids and their images."""
    rng = np.random.default_rng(3)
    kicking, bending = np.zeros((2, len(DOF_INDEX)))
    kicking[DOF_INDEX["left_hip_flexion"]], bending[DOF_INDEX["waist_pitch"]] = 1.5, 1.0
    kinds = np.stack([kicking, mirror_images(kicking[None])[0], bending])
    poses = np.repeat(kinds, 20, axis=0)
    poses[:, TOLD] += rng.normal(scale=0.02, size=(60, len(TOLD)))
    found, mean_m = typical(poses, 2)
    assert {tuple(pose) for pose in found[:2]} <= {tuple(pose) for pose in poses}
    assert sorted(found[:2, DOF_INDEX["waist_pitch"]].round()) == [0, 1]
    assert mean_m < 0.03


def test_the_table_is_written_as_it_is_read(tmp_path: Path) -> None:
    write_typical(typical_poses()[1:], tmp_path / "typical.csv")
    assert (tmp_path / "typical.csv").read_bytes() == TABLE.read_bytes()
