"""The table of the body: its counts, names, limits, axes and the order that the maths rely on."""

from math import degrees, radians

import numpy as np
import pytest

from services.mocap.body.kinematics import clip_to_limits
from services.mocap.body.skeleton import (
    BODY_DOFS,
    DOF_INDEX,
    DOF_NAMES,
    DOFS,
    JOINT_INDEX,
    JOINT_NAMES,
    JOINTS,
    LOWER,
    SEGMENT_INDEX,
    SEGMENT_JOINT,
    SEGMENT_NAMES,
    TIP_JOINTS,
    UPPER,
    Dof,
    bare,
    dofs_of,
    pose_of_body,
    segments_below,
)
from services.mocap.body.skeleton_table import ROWS

PELVIS_HEIGHT = 0.513  # of the hip centres over the soles, in body heights
# What the design page fixes: how many parameters each kind of joint has.
DOFS_PER_JOINT = {
    "pelvis": 6,
    "waist": 3,
    "neck": 3,
    "shoulder": 3,
    "elbow": 1,
    "wrist": 3,
    "hip": 3,
    "knee": 1,
    "ankle": 2,
}


def offset(name: str) -> tuple[float, float, float]:
    return JOINTS[JOINT_INDEX[name]].offset_heights


def test_every_row_stands_once_or_on_both_sides() -> None:
    per_row = [(2 if row.paired else 1, row) for row in ROWS]
    assert len(SEGMENT_NAMES) == sum(n for n, _ in per_row)
    assert len(JOINTS) == sum(n * (2 if row.tip and row.tip.joint else 1) for n, row in per_row)
    assert len(DOFS) == sum(n * len(row.parameters) for n, row in per_row)


@pytest.mark.parametrize("names", [SEGMENT_NAMES, JOINT_NAMES, DOF_NAMES, tuple(dof.column for dof in DOFS)])
def test_names_are_unique(names: tuple[str, ...]) -> None:
    assert len(set(names)) == len(names)


def test_indices_say_where_names_stand() -> None:
    for names, index in ((SEGMENT_NAMES, SEGMENT_INDEX), (JOINT_NAMES, JOINT_INDEX), (DOF_NAMES, DOF_INDEX)):
        assert [index[name] for name in names] == list(range(len(names)))


def test_each_joint_has_its_number_of_parameters() -> None:
    found = {name: len(dofs_of(name)) for name in JOINT_NAMES}
    assert {name: n for name, n in found.items() if n} == {
        name: DOFS_PER_JOINT[bare(name)] for name in JOINT_NAMES if bare(name) in DOFS_PER_JOINT
    }
    assert sum(found.values()) == len(DOFS)


def test_the_published_body_has_35_parameters_and_a_rigid_trunk() -> None:
    assert BODY_DOFS["anatomical"] == tuple(range(len(DOFS)))
    assert len(BODY_DOFS["paper"]) == 35
    assert {DOFS[d].joint for d in set(BODY_DOFS["anatomical"]) - set(BODY_DOFS["paper"])} == {"waist"}


def test_a_pose_of_the_published_body_has_zeros_for_the_rest() -> None:
    poses = np.random.default_rng(0).normal(size=(3, 2, len(DOFS)))
    held = pose_of_body(poses, "paper")
    np.testing.assert_array_equal(held[..., BODY_DOFS["paper"]], poses[..., BODY_DOFS["paper"]])
    assert not held[..., dofs_of("waist")].any()
    np.testing.assert_array_equal(pose_of_body(poses[0, 0], "paper"), held[0, 0])
    np.testing.assert_array_equal(pose_of_body(poses, "anatomical"), poses)


def test_parents_stand_before_their_children() -> None:
    assert [joint.name for joint in JOINTS if joint.parent is None] == ["pelvis"]
    for i, joint in enumerate(JOINTS[1:], start=1):
        assert joint.parent is not None
        assert JOINT_INDEX[joint.parent] < i


def test_every_joint_but_the_tip_carries_one_segment() -> None:
    assert sorted([*SEGMENT_JOINT.values(), *TIP_JOINTS]) == sorted(JOINT_NAMES)


@pytest.mark.parametrize("dof", DOFS, ids=lambda dof: dof.name)
def test_limits_are_ordered_and_hold_the_rest_pose(dof: Dof) -> None:
    assert dof.lower_deg < dof.upper_deg
    assert dof.lower_deg <= 0.0 <= dof.upper_deg


def test_only_the_root_is_without_limits() -> None:
    unlimited = {dof.name for dof in DOFS if np.isinf([dof.lower_deg, dof.upper_deg]).any()}
    assert unlimited == {dof.name for dof in DOFS if dof.joint == "pelvis"}


def test_limits_stand_in_radians_in_the_arrays() -> None:
    np.testing.assert_array_equal(LOWER, [radians(dof.lower_deg) for dof in DOFS])
    np.testing.assert_array_equal(UPPER, [radians(dof.upper_deg) for dof in DOFS])
    assert degrees(UPPER[DOF_INDEX["left_knee_flexion"]]) == pytest.approx(150.0)


@pytest.mark.parametrize("dof", DOFS, ids=lambda dof: dof.name)
def test_axes_have_unit_length(dof: Dof) -> None:
    assert np.linalg.norm(dof.axis) == 1.0


@pytest.mark.parametrize("joint", JOINT_NAMES)
def test_a_joints_axes_are_perpendicular(joint: str) -> None:
    for shifts in (True, False):
        axes = np.array([DOFS[d].axis for d in dofs_of(joint) if (DOFS[d].unit == "m") == shifts]).reshape(
            -1, 3
        )
        np.testing.assert_array_equal(axes @ axes.T, np.eye(len(axes)))


@pytest.mark.parametrize("dof", [dof for dof in DOFS if dof.role == "twist"], ids=lambda dof: dof.name)
def test_twists_turn_about_the_bone(dof: Dof) -> None:
    child = next((joint for joint in JOINTS if joint.parent == dof.joint), None)
    if child is None:  # the hand: its bone goes on along the forearm's
        child = JOINTS[JOINT_INDEX[dof.joint]]
    np.testing.assert_allclose(
        np.cross(dof.axis, child.offset_heights), 0.0, atol=0.007
    )  # the head lies ahead


def test_units_and_columns() -> None:
    assert [dof.name for dof in DOFS if dof.unit == "m"] == ["root_x", "root_y", "root_z"]
    assert DOFS[DOF_INDEX["root_z"]].column == "root_z_m"
    assert DOFS[DOF_INDEX["right_hip_twist"]].column == "right_hip_twist_rad"


def test_right_mirrors_left() -> None:
    mirror_y = np.array([1.0, -1.0, 1.0])
    for joint in JOINTS:
        if joint.name.startswith("left_"):
            other = f"right_{bare(joint.name)}"
            np.testing.assert_array_equal(offset(other), offset(joint.name) * mirror_y)
    for dof in DOFS:
        if dof.name.startswith("left_"):
            twin = DOFS[DOF_INDEX[f"right_{bare(dof.name)}"]]
            # An axis of rotation is a pseudovector: its mirror image is turned round as well.
            np.testing.assert_array_equal(twin.axis, -mirror_y * dof.axis)
            assert (twin.lower_deg, twin.upper_deg, twin.role) == (dof.lower_deg, dof.upper_deg, dof.role)
            assert (twin.joint, dof.joint) == (f"right_{bare(dof.joint)}", f"left_{bare(dof.joint)}")


def test_height_is_made_of_the_bones() -> None:
    above_hips = sum(offset(name)[2] for name in ("waist", "neck", "head", "head_top"))
    assert pytest.approx(1.0, abs=1e-12) == PELVIS_HEIGHT + above_hips
    assert -(offset("left_knee")[2] + offset("left_ankle")[2]) < PELVIS_HEIGHT


@pytest.mark.parametrize(
    ("joint", "segments"),
    [
        ("pelvis", SEGMENT_NAMES),
        ("neck", ("neck", "head")),
        ("left_shoulder", ("left_upper_arm", "left_forearm", "left_hand")),
        ("right_knee", ("right_shank", "right_foot")),
        ("head_top", ()),
    ],
)
def test_segments_below(joint: str, segments: tuple[str, ...]) -> None:
    assert tuple(SEGMENT_NAMES[s] for s in segments_below(joint)) == segments


def test_the_waist_carries_all_but_pelvis_and_legs() -> None:
    kept = {"pelvis", "thigh", "shank", "foot"}
    assert {SEGMENT_NAMES[s] for s in segments_below("waist")} == {
        s for s in SEGMENT_NAMES if bare(s) not in kept
    }


def test_clipping_keeps_what_is_within_and_is_idempotent() -> None:
    poses = np.random.default_rng(1).uniform(-4.0, 4.0, (200, len(DOFS)))
    clipped = clip_to_limits(poses)
    assert np.all((clipped >= LOWER) & (clipped <= UPPER))
    np.testing.assert_array_equal(clip_to_limits(clipped), clipped)
    within = (poses >= LOWER) & (poses <= UPPER)
    np.testing.assert_array_equal(clipped[within], poses[within])
    assert np.all((clipped == poses) | (clipped == LOWER) | (clipped == UPPER))
    np.testing.assert_array_equal(clip_to_limits(poses[0]), clipped[0])
