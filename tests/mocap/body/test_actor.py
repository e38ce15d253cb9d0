"""The actor: its file and hash, and how height and bone lengths shape the body."""

import tomllib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from services.mocap.body import shape_space
from services.mocap.body.actor import DEFAULT_HEIGHT_M, Actor, Body, _shape, build_body
from services.mocap.body.body_mesh import generic_segments
from services.mocap.body.bones import BONES, trunk_widening
from services.mocap.body.colours import COLOURED, MOST_CLASSES, QUARTERS
from services.mocap.body.garments import Hat, Skirt
from services.mocap.body.kinematics import N_DOF, joint_positions, segment_transforms
from services.mocap.body.profiles import FACTOR_RANGE, MOST_CONTROLS, SECTIONS, Profile
from services.mocap.body.skeleton import (
    JOINT_INDEX,
    JOINTS,
    LOWER,
    SEGMENT_INDEX,
    SEGMENT_JOINT,
    SEGMENT_NAMES,
    TRUNK,
    UPPER,
)
from services.mocap.types import Floats

PELVIS_HEIGHT = 0.513  # of the hip centres over the soles, in body heights
HEIGHT_M = 1.8
MIRROR_Y = np.array([1.0, -1.0, 1.0])
FACTORS = st.lists(st.floats(*FACTOR_RANGE), min_size=1, max_size=MOST_CONTROLS).map(tuple)
ACTORS = st.builds(
    Actor,
    height=st.floats(0.5, 2.5),
    bone_lengths=st.dictionaries(st.sampled_from(list(BONES)), st.floats(0.01, 1.0)),
    hip_depth=st.floats(0.5, 2.0),
    profiles=st.dictionaries(
        st.sampled_from(list(SECTIONS)), st.builds(Profile, width=FACTORS, depth=FACTORS), max_size=3
    ),
    skirt=st.none() | st.builds(Skirt, length=st.floats(0.05, 0.5), flare=st.floats(0.0, 0.2)),
    hat=st.none()
    | st.builds(
        Hat,
        brim=st.floats(1.0, 3.0),
        peak=st.floats(1.0, 3.0),
        rim=st.floats(0.0, 0.08),
        crown=st.floats(0.0, 0.15),
    ),
    colours=st.dictionaries(
        st.sampled_from(COLOURED), st.tuples(*[st.integers(0, MOST_CLASSES)] * QUARTERS), max_size=3
    ),
)
TRUNK_WIDTHS = {"hip_width", "shoulder_width"}  # they widen the trunk between them
# Two joints whose distance along an axis is the bone's length, where it has such.
ENDS = {
    "hip_width": ("left_hip", "right_hip", 1),
    "pelvis": ("waist", "pelvis", 2),
    "torso": ("neck", "waist", 2),
    "shoulder_width": ("left_shoulder", "right_shoulder", 1),
    "neck": ("head", "neck", 2),
    "head": ("head_top", "head", 2),
    "upper_arm": ("left_elbow", "left_shoulder", 1),
    "forearm": ("left_wrist", "left_elbow", 1),
    "thigh": ("left_hip", "left_knee", 2),
    "shank": ("left_knee", "left_ankle", 2),
}
# Bones between two joints of which nothing but the bone makes the distance, and which bend nowhere.
STRAIGHT = ("hip_width", "pelvis", "torso", "shoulder_width", "upper_arm", "forearm", "thigh", "shank")


def bare(name: str) -> str:
    return name.removeprefix("left_").removeprefix("right_")


def rest(body: Body) -> Floats:
    joints_m: Floats = joint_positions(np.zeros((1, N_DOF)), body.offsets_m)[0]
    return joints_m


def changed_coordinates(body: Body, other: Body) -> tuple[set[tuple[str, str]], set[tuple[str, str]]]:
    """(joint, axis) of the offsets and (segment, axis) of the meshes in which two bodies differ."""
    joints = {
        (joint.name, axis)
        for j, joint in enumerate(JOINTS)
        for k, axis in enumerate("xyz")
        if body.offsets_m[j, k] != other.offsets_m[j, k]
    }
    segments = {
        (name, axis)
        for name, one, two in zip(SEGMENT_NAMES, body.vertices_m, other.vertices_m, strict=True)
        for k, axis in enumerate("xyz")
        if not np.array_equal(one[:, k], two[:, k])
    }
    return joints, segments


@given(ACTORS)
@settings(deadline=None)
def test_toml_round_trip(actor: Actor) -> None:
    assert Actor.from_toml(actor.to_toml()) == actor
    assert Actor.from_toml(actor.to_toml()).content_hash == actor.content_hash
    unset = {name for name in ("mesh", "profiles", "skirt", "hat", "colours") if not getattr(actor, name)}
    unset |= {"hip_depth"} if actor.hip_depth == 1.0 else set()
    fields = set(Actor.model_fields) - unset
    assert set(tomllib.loads(actor.to_toml())) == fields


@given(ACTORS, ACTORS)
@settings(deadline=None)
def test_actors_have_the_same_hash_only_where_they_are_equal(one: Actor, other: Actor) -> None:
    assert (one.content_hash == other.content_hash) == (one == other)


def test_hash_does_not_depend_on_the_order_of_bones() -> None:
    one = Actor(bone_lengths={"thigh": 0.4, "head": 0.2})
    assert one.content_hash == Actor(bone_lengths={"head": 0.2, "thigh": 0.4}).content_hash


def test_hash_is_the_same_in_every_process_and_version() -> None:
    # It names content on the wire and in journals: whoever changes it must mean to.
    actor = Actor(height=1.75, bone_lengths={"thigh": 0.41})
    assert actor.to_toml() == "height = 1.75\n\n[bone_lengths]\nthigh = 0.41\n"
    assert actor.content_hash == "bd1acfc51b40e14022183d773b4ce3caaba6b46ccd58eadc2c62dd342b9a4687"


def test_an_empty_file_is_the_default_actor() -> None:
    assert Actor.from_toml("") == Actor() == Actor(height=DEFAULT_HEIGHT_M, bone_lengths={})


def test_an_unknown_bone_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValidationError, match=r"femur is not a bone; known are hip_width, pelvis, torso"):
        Actor(bone_lengths={"femur": 0.4})


@pytest.mark.parametrize("length_m", [0.0, -0.4, 1.01, 41.0, float("nan"), float("inf")])
def test_implausible_lengths_are_refused(length_m: float) -> None:
    with pytest.raises(ValidationError, match=r"thigh = .*: expected metres from 0\.01 to 1"):
        Actor(bone_lengths={"thigh": length_m})


@pytest.mark.parametrize(
    "text", ["height = 175", "height = nan", "height = 'tall'", "weight = 70", "height ="]
)
def test_bad_files_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"height|weight|Invalid"):  # both TOML's and pydantic's are such
        Actor.from_toml(text)


def test_height_scales_everything() -> None:
    body = build_body(Actor(height=HEIGHT_M))
    offsets_heights = np.array([joint.offset_heights for joint in JOINTS])
    np.testing.assert_allclose(body.offsets_m, HEIGHT_M * offsets_heights, rtol=1e-15)
    for vertices_m, mesh in zip(body.vertices_m, generic_segments(), strict=True):
        np.testing.assert_allclose(vertices_m, HEIGHT_M * mesh.vertices_heights, rtol=1e-15)
    assert body.height_m == HEIGHT_M
    assert body.pelvis_height_m == pytest.approx(PELVIS_HEIGHT * HEIGHT_M, abs=1e-3)


def test_meshes_keep_their_faces() -> None:
    body = build_body(Actor(height=HEIGHT_M, bone_lengths={"thigh": 0.5}))
    assert len(body.vertices_m) == len(body.faces) == len(SEGMENT_NAMES)
    for faces, mesh in zip(body.faces, generic_segments(), strict=True):
        np.testing.assert_array_equal(faces, mesh.faces)


def test_a_body_does_not_depend_on_those_built_before_or_on_what_was_done_to_them() -> None:
    """Shapes of segments are kept and shared by bodies that have them in common."""
    rng, spread = np.random.default_rng(3), shape_space.DEVIATIONS
    vectors = shape_space.clip_to_bounds(spread * rng.normal(size=(6, len(spread))))
    vectors[3:] = vectors[:3]
    vectors[3:, shape_space.INDEX["leg_girth_knee"]] += 0.05
    alone = []
    for x in vectors:
        _shape.cache_clear()
        alone.append([vertices_m.copy() for vertices_m in shape_space.body_of(x).vertices_m])
    for x, expected in [*zip(vectors, alone, strict=True), *zip(vectors[::-1], alone[::-1], strict=True)]:
        body = shape_space.body_of(x)
        for vertices_m, of_alone in zip(body.vertices_m, expected, strict=True):
            np.testing.assert_array_equal(vertices_m, of_alone)
            vertices_m += 1.0


def test_standing_height_is_the_actors() -> None:
    body = build_body(Actor(height=HEIGHT_M))
    pose = np.zeros(N_DOF)
    pose[2] = body.pelvis_height_m
    assert body.lowest_point_m(pose) == pytest.approx(0.0, abs=1e-12)
    head_top_m = joint_positions(pose[None], body.offsets_m)[0, JOINT_INDEX["head_top"], 2]
    assert head_top_m == pytest.approx(HEIGHT_M, abs=2e-3)


@given(ACTORS)
@settings(max_examples=15, deadline=None)
def test_standing_height_is_that_of_the_mesh(actor: Actor) -> None:
    body = build_body(actor)
    pose = np.zeros(N_DOF)
    T_world_segment = segment_transforms(pose[None], body.offsets_m)[0]
    z_m = {
        name: vertices_m @ T[2, :3] + T[2, 3]
        for name, vertices_m, T in zip(SEGMENT_NAMES, body.vertices_m, T_world_segment, strict=True)
    }
    lowest_m = min(float(heights.min()) for heights in z_m.values())
    assert body.standing_height_m == pytest.approx(z_m["head"].max() - lowest_m)


def test_the_generic_body_stands_as_tall_as_it_says() -> None:
    assert build_body(Actor(height=HEIGHT_M)).standing_height_m == pytest.approx(HEIGHT_M, abs=1e-3)


def test_lowest_point_follows_the_pose() -> None:
    body = build_body(Actor(height=HEIGHT_M))
    pose = np.zeros(N_DOF)
    pose[4] = np.pi  # upside down
    arm_reach_m = max(float(vertices[:, 2].max()) for vertices in body.vertices_m)
    head_top_m = rest(body)[JOINT_INDEX["head_top"], 2]
    assert body.lowest_point_m(pose) == pytest.approx(-head_top_m, abs=0.02)
    assert arm_reach_m < head_top_m


def test_centres_are_mean_vertices() -> None:
    body = build_body(Actor())
    for centre_m, vertices_m in zip(body.centres_m, body.vertices_m, strict=True):
        np.testing.assert_allclose(centre_m, vertices_m.mean(axis=0))


@pytest.mark.parametrize("bone", sorted(set(BONES) - TRUNK_WIDTHS))
def test_a_bone_changes_exactly_what_its_table_names(bone: str) -> None:
    length_m = 1.1 * BONES[bone].length_heights * HEIGHT_M
    body, other = (
        build_body(Actor(height=HEIGHT_M)),
        build_body(Actor(height=HEIGHT_M, bone_lengths={bone: length_m})),
    )
    joints, segments = changed_coordinates(body, other)
    assert joints == {
        (joint.name, "xyz"[BONES[bone].joints[bare(joint.name)]])
        for joint in JOINTS
        if bare(joint.name) in BONES[bone].joints
    }
    assert segments == {
        (name, axis) for name in SEGMENT_NAMES for axis in BONES[bone].segments.get(bare(name), "")
    }
    for j, axis in joints:
        k = "xyz".index(axis)
        assert other.offsets_m[JOINT_INDEX[j], k] == pytest.approx(1.1 * body.offsets_m[JOINT_INDEX[j], k])
    for s, axis in segments:
        k, i = "xyz".index(axis), SEGMENT_INDEX[s]
        np.testing.assert_allclose(other.vertices_m[i][:, k], 1.1 * body.vertices_m[i][:, k])


@pytest.mark.parametrize(("bone", "joint"), [("hip_width", "hip"), ("shoulder_width", "shoulder")])
def test_the_trunk_widens_with_hips_below_and_shoulders_above(bone: str, joint: str) -> None:
    length_m = 1.1 * BONES[bone].length_heights * HEIGHT_M
    body, other = (
        build_body(Actor(height=HEIGHT_M)),
        build_body(Actor(height=HEIGHT_M, bone_lengths={bone: length_m})),
    )
    joints, segments = changed_coordinates(body, other)
    assert joints == {(f"{side}_{joint}", "y") for side in ("left", "right")}
    assert segments == {("pelvis", "y"), ("torso", "y")}
    for segment, waist_m in (("pelvis", 0.0), ("torso", body.offsets_m[JOINT_INDEX["waist"], 2])):
        before, after = (b.vertices_m[SEGMENT_INDEX[segment]] for b in (body, other))
        factors = after[before[:, 1] != 0, 1] / before[before[:, 1] != 0, 1]
        share = before[before[:, 1] != 0, 2] + waist_m
        share /= body.offsets_m[JOINT_INDEX["left_shoulder"], 2] + body.offsets_m[JOINT_INDEX["waist"], 2]
        order = np.argsort(share)
        rises = 1 if bone == "shoulder_width" else -1
        assert np.all(rises * np.diff(factors[order]) > -1e-12)
        np.testing.assert_allclose(factors[share <= 0.0], 1.0536 if bone == "hip_width" else 1.0)
        np.testing.assert_allclose(factors[share >= 1.0], 1.0 if bone == "hip_width" else 1.1)


def test_deeper_hips_leave_the_outline_of_the_thighs_at_the_hips() -> None:
    body, other = (build_body(Actor(height=HEIGHT_M, hip_depth=depth)) for depth in (1.0, 1.3))
    joints, segments = changed_coordinates(body, other)
    assert joints == {("waist", "x")}
    assert segments == {("pelvis", "x"), ("left_thigh", "x"), ("right_thigh", "x")}
    waist, thigh = JOINT_INDEX["waist"], SEGMENT_INDEX["left_thigh"]
    setback_m = other.offsets_m[waist, 0] - body.offsets_m[waist, 0]
    front_m = body.vertices_m[thigh][body.vertices_m[thigh][:, 2] > -0.02, 0].max()
    assert setback_m == pytest.approx(0.3 * front_m, rel=0.1)
    forward_m = np.array([setback_m, 0.0, 0.0])
    pelvis, moved = (b.vertices_m[SEGMENT_INDEX["pelvis"]] for b in (body, other))
    np.testing.assert_allclose(moved, pelvis + forward_m, atol=1e-12)
    before, after = (b.vertices_m[thigh] for b in (body, other))
    z_m, knee_m = body.vertices_m[thigh][:, 2], body.offsets_m[JOINT_INDEX["left_knee"], 2]
    at_hip, at_knee = z_m > 0.0, z_m < knee_m
    np.testing.assert_allclose(after[at_hip], before[at_hip] + forward_m, atol=1e-12)
    np.testing.assert_allclose(after[at_knee], before[at_knee], atol=1e-12)


@pytest.mark.parametrize("bone", BONES)
def test_generic_lengths_change_nothing(bone: str) -> None:
    length_m = BONES[bone].length_heights * HEIGHT_M
    body, same = (
        build_body(Actor(height=HEIGHT_M)),
        build_body(Actor(height=HEIGHT_M, bone_lengths={bone: length_m})),
    )
    np.testing.assert_allclose(same.offsets_m, body.offsets_m, rtol=1e-15)
    for mine, others in zip(same.vertices_m, body.vertices_m, strict=True):
        np.testing.assert_allclose(mine, others, rtol=1e-15)


@pytest.mark.parametrize("bone", ENDS)
def test_generic_lengths_are_the_skeletons(bone: str) -> None:
    end, start, axis = ENDS[bone]
    at = rest(build_body(Actor(height=1.0)))
    assert BONES[bone].length_heights == pytest.approx((at[JOINT_INDEX[end]] - at[JOINT_INDEX[start]])[axis])


def test_generic_lengths_of_hand_and_foot_are_their_meshes() -> None:
    body = build_body(Actor(height=1.0))
    fingertip = body.vertices_m[SEGMENT_INDEX["left_hand"]][:, 1].max()  # from the wrist
    sole = np.ptp(body.vertices_m[SEGMENT_INDEX["left_foot"]][:, 0])  # from heel to toe
    assert BONES["hand"].length_heights == pytest.approx(fingertip)
    assert BONES["foot"].length_heights == pytest.approx(sole)


def test_every_joint_and_segment_has_its_bone() -> None:
    joints = {name for bone in BONES.values() for name in bone.joints}
    segments = {name for bone in BONES.values() for name in bone.segments}
    assert joints == {bare(joint.name) for joint in JOINTS} - {"pelvis"}
    assert segments == {bare(name) for name in SEGMENT_NAMES}


@given(st.integers(0, 2**32 - 1), st.sampled_from(STRAIGHT), st.floats(0.05, 0.9))
@settings(max_examples=30, deadline=None)
def test_a_given_length_is_the_joints_distance_in_any_pose(seed: int, bone: str, length_m: float) -> None:
    body = build_body(Actor(height=HEIGHT_M, bone_lengths={bone: length_m}))
    pose = np.random.default_rng(seed).uniform(np.maximum(LOWER, -3.0), np.minimum(UPPER, 3.0))
    at = joint_positions(pose[None], body.offsets_m)[0]
    end, start, _ = ENDS[bone]
    assert np.linalg.norm(at[JOINT_INDEX[end]] - at[JOINT_INDEX[start]]) == pytest.approx(length_m)


@given(ACTORS)
@settings(max_examples=15, deadline=None)
def test_left_and_right_stay_mirror_images(actor: Actor) -> None:
    body = build_body(actor)
    for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"):
        left, right = (
            body.offsets_m[JOINT_INDEX[f"left_{name}"]],
            body.offsets_m[JOINT_INDEX[f"right_{name}"]],
        )
        np.testing.assert_array_equal(right, left * MIRROR_Y)
    for name in ("upper_arm", "forearm", "hand", "thigh", "shank", "foot"):
        left, right = (body.vertices_m[SEGMENT_INDEX[f"{side}_{name}"]] for side in ("left", "right"))
        np.testing.assert_array_equal(right, left * MIRROR_Y)


@pytest.mark.parametrize("segment", TRUNK)
def test_the_trunk_reaches_the_shoulders_width_at_their_height(segment: str) -> None:
    offsets_heights = np.array([joint.offset_heights for joint in JOINTS])
    up = dict(zip(JOINT_INDEX, joint_positions(np.zeros((1, N_DOF)), offsets_heights)[0, :, 2], strict=True))
    shoulders = up["left_shoulder"] - up[SEGMENT_JOINT[segment]]
    below, at, above = trunk_widening(segment, shoulders + np.array([-0.05, 0.0, 0.05]), 1.0, 1.3)
    assert below < at == above == pytest.approx(1.3)
