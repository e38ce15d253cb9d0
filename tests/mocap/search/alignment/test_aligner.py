"""An alignment brings a body back to where its silhouettes were drawn, and moves nothing else."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.garments import Skirt
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX, LOWER, SEGMENT_INDEX, SEGMENTS, UPPER
from services.mocap.camera.rig import Rig
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.search.alignment.aligner import Aligned, Aligner
from services.mocap.search.alignment.matching import KNOWN, ON
from services.mocap.search.chains import ALL_SURFACES, LIMBS
from services.mocap.search.limb import limb_picture
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.synth.studio import studio_cameras
from services.mocap.types import Bytes, Floats

SETTINGS = SearchSettings()
Maker = Callable[..., Floats]
BENT = {"shoulder_elevation": -50.0, "elbow_flexion": 40.0, "hip_flexion": 25.0, "hip_abduction": 12.0}
"""Legs apart: where they touch, a leg may slip onto the other, which is for the search of limbs to mend."""


def _nearby(pose: Floats, seed: int) -> Floats:
    """A few centimetres and degrees away."""
    rng = np.random.default_rng(seed)
    off = rng.normal(0, 0.05, N_DOF)
    off[:3] = rng.normal(0, 0.03, 3)
    return np.clip(pose + off, LOWER, UPPER)


@pytest.mark.parametrize("seed", range(6))
def test_it_finds_back(
    model: Model,
    standing: Maker,
    picture_of: Callable[[Floats], Picture],
    joint_errors_mm: Callable[[Floats, Floats], Floats],
    seed: int,
) -> None:
    truth = standing(**BENT)
    start = _nearby(truth, seed)
    found = model.aligner(SETTINGS).align(picture_of(truth), start, SETTINGS)
    assert joint_errors_mm(start, truth).mean() > 25
    assert joint_errors_mm(found.pose, truth).mean() < 5
    assert joint_errors_mm(found.pose, truth).max() < 25
    assert np.all((found.pose >= LOWER) & (found.pose <= UPPER))
    shown, on, unsure = found.rim.lengths_px.sum(axis=0)
    assert on > 0.98 * shown
    assert unsure == 0.0


def test_legs_that_swing_a_skirt_are_found_back(
    model: Model, standing: Maker, joint_errors_mm: Callable[[Floats, Floats], Floats]
) -> None:
    body = build_body(Actor(height=1.75, skirt=Skirt(length=0.33, flare=0.03)))
    dressed = Model(body, model.rig, CpuBackend(body, model.rig))
    truth = standing(shoulder_elevation=-50.0, hip_abduction=8.0, left_hip_flexion=45.0)
    region = Region.whole(model.rig)
    picture = Picture.whole(model.rig, dressed.backend.coverage(truth[None], ALL_SURFACES, region)[0])
    start = _nearby(truth, 0)
    found = dressed.aligner(SETTINGS).align(picture, start, SETTINGS)
    assert joint_errors_mm(start, truth).mean() > 25
    assert joint_errors_mm(found.pose, truth).mean() < 10
    cloth_px = found.rim.lengths_px[len(SEGMENTS) :].sum(axis=0)
    assert cloth_px[ON] > 0.9 * cloth_px[KNOWN] > 100.0


def test_the_full_meshes_do_as_well(
    model: Model,
    standing: Maker,
    picture_of: Callable[[Floats], Picture],
    joint_errors_mm: Callable[[Floats, Floats], Floats],
) -> None:
    truth, full = standing(**BENT), SearchSettings(detail_px=0.0)
    found = model.aligner(full).align(picture_of(truth), _nearby(truth, 1), full)
    assert joint_errors_mm(found.pose, truth).mean() < 5


def test_nothing_pulls_where_the_model_covers_just_what_is_seen(
    model: Model, standing: Maker, picture_of: Callable[[Floats], Picture]
) -> None:
    truth, full = standing(**BENT), SearchSettings(detail_px=0.0, rest=0.0, pose_prior=0.0)
    found = model.aligner(full).align(picture_of(truth), truth, full)
    np.testing.assert_array_equal(found.pose, truth)
    known_px, on_px, _ = found.rim.lengths_px.T
    assert known_px.sum() > 100.0
    np.testing.assert_array_equal(on_px, known_px)


def test_cameras_that_face_each_other_do_not_tell_how_far_away_a_hand_is(
    model: Model, standing: Maker, picture_of: Callable[[Floats], Picture]
) -> None:
    P_px_world, truth = model.rig.P_px_world, standing(shoulder_elevation=-20.0)
    centres_m = -np.linalg.solve(P_px_world[:, :, :3], P_px_world[:, :, 3:])[:, :, 0]
    flat_m = (centres_m - centres_m.mean(axis=0))[:, :2]
    opposite = int(np.argmin(flat_m @ flat_m[0]))
    facing = tuple(float(c in (0, opposite)) for c in range(model.rig.n_cameras))
    between, told = flat_m[0] / np.linalg.norm(flat_m[0]), []
    for weights in ((), facing):
        settings = SearchSettings(camera_weights=weights)
        found = model.aligner(settings).align(picture_of(truth), truth, settings)
        lower = np.tril(found.rim.place_normals[SEGMENT_INDEX["left_forearm"]])
        normal = lower + np.tril(lower, -1).T
        told.append(between @ normal[:2, :2] @ between / np.trace(normal))
    assert told[1] < 0.2 * told[0]


def test_the_last_steps_are_the_fine_ones(
    model: Model,
    standing: Maker,
    picture_of: Callable[[Floats], Picture],
    joint_errors_mm: Callable[[Floats, Floats], Floats],
) -> None:
    truth = standing(**BENT)
    few, free = SearchSettings(contour_steps=2, rest=0.0, pose_prior=0.0), SearchSettings(rest=0.0)
    near = model.aligner(few).align(picture_of(truth), truth, few)
    found = model.aligner(free).align(picture_of(truth), _nearby(truth, 1), free)
    assert joint_errors_mm(near.pose, truth).max() < 1.0
    assert joint_errors_mm(found.pose, truth).mean() < 1.5


def test_a_limb_is_aligned_in_its_window_and_nothing_else_moves(
    model: Model,
    standing: Maker,
    picture_of: Callable[[Floats], Picture],
    joint_errors_mm: Callable[[Floats, Floats], Floats],
) -> None:
    truth, limb = standing(**BENT), LIMBS["left_arm"]
    start = truth.copy()
    start[list(limb.main.dofs)] += 0.12
    window = limb_picture(model, "left_arm", picture_of(truth), start, SETTINGS)
    found = model.aligner(SETTINGS).align(window, start, SETTINGS, limb.dofs, limb.main.segments).pose
    others = [d for d in range(N_DOF) if d not in limb.dofs]
    np.testing.assert_array_equal(found[others], start[others])
    assert joint_errors_mm(found, truth).max() < 12


def test_a_camera_of_no_weight_has_no_say(
    model: Model, standing: Maker, silhouettes_of: Callable[[Floats], Bytes]
) -> None:
    truth = standing(**BENT)
    weights = tuple(0.0 if c == 2 else 1.0 for c in range(model.rig.n_cameras))
    settings = SearchSettings(camera_weights=weights)
    clean, soiled = silhouettes_of(truth), silhouettes_of(truth)
    soiled ^= np.random.default_rng(0).integers(0, 2, soiled.shape, np.uint8) << 2
    a, b = (
        model.aligner(settings).align(Picture.whole(model.rig, planes), _nearby(truth, 0), settings)
        for planes in (clean, soiled)
    )
    np.testing.assert_array_equal(a.pose, b.pose)


def _unseen(model: Model, start: Floats, settings: SearchSettings) -> Aligned:
    """A pose aligned with pictures that show nobody."""
    blank = Picture.whole(model.rig, np.zeros((1, *model.rig.shape_px), np.uint8))
    return model.aligner(settings).align(blank, start, settings)


def test_what_nothing_tells_stays_as_it_was(model: Model, standing: Maker) -> None:
    start = standing(**BENT)
    found = _unseen(model, start, SearchSettings(rest=0.0, pose_prior=0.0))
    np.testing.assert_array_equal(found.pose, start)
    assert found.anchor_cost == 0.0


def test_hands_feet_and_twists_that_nothing_tells_are_drawn_to_rest(model: Model, standing: Maker) -> None:
    start = standing(wrist_flexion=20.0, wrist_twist=-30.0, ankle_inversion=10.0, elbow_flexion=40.0)
    found = _unseen(model, start, SearchSettings(steadiness=100.0, rest=300.0, pose_prior=0.0))
    kept = {"wrist_flexion": 1 / 4, "wrist_twist": 10 / 13, "ankle_inversion": 10 / 19, "elbow_flexion": 1.0}
    for name, share in kept.items():
        for side in ("left", "right"):
            d = DOF_INDEX[f"{side}_{name}"]
            assert found.pose[d] == pytest.approx(share * start[d], abs=1e-4)


def test_a_joint_at_its_limit_stays_there(
    model: Model, standing: Maker, picture_of: Callable[[Floats], Picture]
) -> None:
    truth = standing(shoulder_elevation=-50.0, elbow_flexion=0.0)
    beyond = truth.copy()
    elbow = DOF_INDEX["left_elbow_flexion"]
    beyond[elbow] = np.radians(-12)  # what the limits do not allow, drawn all the same
    found = model.aligner(SETTINGS).align(picture_of(beyond), truth, SETTINGS).pose
    assert found[elbow] == LOWER[elbow]


@pytest.mark.parametrize("n_cameras", [4, 12])
def test_any_number_of_cameras(n_cameras: int, standing: Maker) -> None:
    body, rig = build_body(Actor(height=1.75)), Rig.of(studio_cameras(n_cameras))
    truth = standing(**BENT)
    drawn = CpuBackend(body, rig).coverage(truth[None], ALL_SURFACES, Region.whole(rig))[0]
    found = Aligner(body, rig).align(Picture.whole(rig, drawn), _nearby(truth, 3), SETTINGS).pose
    np.testing.assert_allclose(found[:6], truth[:6], atol=0.03)
