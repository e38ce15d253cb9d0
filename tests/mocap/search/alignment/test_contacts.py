"""Arms inside the trunk or the head, legs inside each other: found, priced, and pulled out; else nothing."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, joint_transforms, segment_transforms
from services.mocap.body.skeleton import DOF_INDEX, LOWER, SEGMENT_INDEX, UPPER
from services.mocap.energy.picture import Picture
from services.mocap.search.alignment.contacts import Contacts, add_contacts, depths_m
from services.mocap.search.alignment.twists import place_twists
from services.mocap.search.chains import LIMBS
from services.mocap.search.frame import solve_frame
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Floats, Ints, Mask

BODY = build_body(Actor())
CONTACTS = Contacts.of(BODY)
FOLDED = {"shoulder_elevation": -80.0, "shoulder_twist": -62.0, "elbow_flexion": 140.0}
"""Hands in the trunk."""
STACKS = ("pelvis", "torso", "head", "left_thigh", "left_shank", "right_thigh", "right_shank")


def _random_pose(seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    return np.asarray(rng.uniform(np.maximum(LOWER, -3), np.minimum(UPPER, 3)))


def _normal_equations(pose: Floats) -> tuple[float, Floats, Floats]:
    T_world_joint = joint_transforms(pose[None], BODY.offsets_m)[0]
    twists, hessian, slope = np.zeros((N_DOF, 6)), np.zeros((N_DOF, N_DOF)), np.zeros(N_DOF)
    place_twists(pose, T_world_joint, twists)
    return add_contacts(CONTACTS, 1.0, T_world_joint, twists, hessian, slope), hessian, slope


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_a_limb_is_inside_where_a_point_of_its_axis_is_in_the_mesh(seed: int) -> None:
    pose = _random_pose(seed)
    T_world_segment = segment_transforms(pose[None], BODY.offsets_m)[0]
    T_world_joint = joint_transforms(pose[None], BODY.offsets_m)[0]
    at = T_world_joint[CONTACTS.point_joints]
    points_m = np.einsum("pij,pj->pi", at[:, :3, :3], CONTACTS.points_m) + at[:, :3, 3]
    deepest_m = np.full(4, -np.inf)
    for k, name in enumerate(STACKS):
        s = SEGMENT_INDEX[name]
        T = T_world_segment[s]
        vertices_m = BODY.vertices_m[s] @ T[:3, :3].T + T[:3, 3]
        off_m = np.linalg.norm(points_m[:, None] - vertices_m, axis=2).min(axis=1)
        off_m[~_encloses(vertices_m, BODY.faces[s], points_m)] *= -1.0
        for p in np.flatnonzero(CONTACTS.counts[:, k]):
            limb = CONTACTS.point_limbs[p]
            deepest_m[limb] = max(deepest_m[limb], off_m[p])
    found_m = depths_m(CONTACTS, BODY.offsets_m, pose[None])[0]
    assert np.all(found_m[deepest_m < -0.03] == 0.0)
    assert np.all(found_m[deepest_m > 0.03] > 0.0)


def _encloses(vertices_m: Floats, faces: Ints, points_m: Floats) -> Mask:
    """(P,) which points a closed mesh winds round, by solid angles (van Oosterom and Strackee, 1983)."""
    a, b, c = (vertices_m[faces[:, k]] - points_m[:, None] for k in range(3))
    A, B, C = (np.linalg.norm(x, axis=2) for x in (a, b, c))
    products = A * B * C + np.sum(a * b, 2) * C + np.sum(b * c, 2) * A + np.sum(c * a, 2) * B
    angles = 2.0 * np.arctan2(np.sum(a * np.cross(b, c), axis=2), products)
    return np.asarray(angles.sum(axis=1) > 2 * np.pi)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_the_normal_equations_are_those_of_the_cost(seed: int) -> None:
    """Hands in the trunk; what ellipses change with height is not in the slope."""
    rng = np.random.default_rng(seed)
    pose = np.zeros(N_DOF)
    for name, degrees in FOLDED.items():
        for side in ("left", "right"):
            pose[DOF_INDEX[f"{side}_{name}"]] = np.radians(degrees + rng.normal(0, 8))
    cost, hessian, slope = _normal_equations(pose)
    inside_m = depths_m(CONTACTS, BODY.offsets_m, pose[None])[0]
    assert (cost > 0) == bool(inside_m.any())
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-12)
    limbs = [d for limb in LIMBS.values() for d in limb.dofs]
    assert not np.any(np.delete(slope, limbs))
    if cost > 1e-4:
        downhill = pose - 1e-4 * slope / np.linalg.norm(slope)
        assert _normal_equations(downhill)[0] < cost


def test_arms_at_the_sides_or_held_out_are_outside() -> None:
    down = np.zeros(N_DOF)
    for side in ("left", "right"):
        down[DOF_INDEX[f"{side}_shoulder_elevation"]] = np.radians(-75.0)
    np.testing.assert_array_equal(depths_m(CONTACTS, BODY.offsets_m, np.stack([np.zeros(N_DOF), down])), 0.0)


def test_an_alignment_takes_hands_out_of_the_trunk(
    model: Model, standing: Callable[..., Floats], picture_of: Callable[[Floats], Picture]
) -> None:
    inside, contacts = standing(**FOLDED), Contacts.of(model.body)
    assert depths_m(contacts, model.body.offsets_m, inside[None])[0, :2].min() > 0.02
    depth_m = {}
    for contact in (0.0, SearchSettings().contact):
        told = SearchSettings(contact=contact)
        found = model.aligner(told).align(picture_of(inside), inside, told)
        depth_m[contact] = depths_m(contacts, model.body.offsets_m, found.pose[None]).max()
    assert depth_m[SearchSettings().contact] < 0.5 * depth_m[0.0]


def test_a_leg_in_the_other_ones_place_goes_back_to_its_own(
    model: Model,
    standing: Callable[..., Floats],
    picture_of: Callable[[Floats], Picture],
    joint_errors_mm: Callable[[Floats, Floats], Floats],
) -> None:
    truth = standing(shoulder_elevation=-70, left_hip_flexion=70, left_knee_flexion=60)
    start = truth.copy()
    for name, value in (("hip_flexion", 70), ("hip_abduction", -20), ("knee_flexion", 60)):
        start[DOF_INDEX[f"right_{name}"]] = np.radians(value)
    assert joint_errors_mm(start, truth).max() > 500
    assert depths_m(Contacts.of(model.body), model.body.offsets_m, start[None])[0, 2:].min() > 0.01
    found = solve_frame(model, picture_of(truth), start[None], SearchSettings(), LocalLimbs(model))
    assert joint_errors_mm(found.pose, truth).max() < 40


def test_the_price_is_of_centimetres_and_cameras(model: Model, standing: Callable[..., Floats]) -> None:
    inside, told = standing(**FOLDED), SearchSettings(contact=2.0)
    depth_cm = 100 * depths_m(Contacts.of(model.body), model.body.offsets_m, inside[None])
    np.testing.assert_allclose(model.aligner(told).contact_px(inside[None], told), 2.0 * 8 * depth_cm)
    assert not model.aligner(told).contact_px(inside[None], SearchSettings(contact=0.0)).any()


def test_a_hat_that_hangs_over_the_head_is_no_harm() -> None:
    head = SEGMENT_INDEX["head"]
    vertices_m, faces = BODY.vertices_m[head], BODY.faces[head]
    hat_m = 0.3 * vertices_m + [0.0, 0.0, 1.3 * vertices_m[:, 2].max()]
    parts, of_faces = list(BODY.vertices_m), list(BODY.faces)
    parts[head], of_faces[head] = np.vstack([vertices_m, hat_m]), np.vstack([faces, faces + len(vertices_m)])
    hatted = Contacts.of(replace(BODY, vertices_m=tuple(parts), faces=tuple(of_faces)))
    assert all(np.isfinite(numbers).all() for numbers in hatted if numbers.dtype.kind == "f")
    pose = np.zeros(N_DOF)
    assert not depths_m(hatted, BODY.offsets_m, pose[None]).any()
