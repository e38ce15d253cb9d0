"""Unsure pixels pull no limb, put nobody in doubt and refuse no first frame; what they hide is not judged."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.skeleton import DOF_INDEX, SEGMENT_INDEX
from services.mocap.energy.bitplanes import TriPlanes, pack, unpack
from services.mocap.energy.picture import Picture, Region
from services.mocap.errors import TakeError
from services.mocap.search.alignment.matching import KNOWN, ON, UNSURE
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.contour_search import solve_by_contours
from services.mocap.search.hull import carve
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.lost_probability import evidence_of
from services.mocap.search.model import Model
from services.mocap.search.part_confidence import confidences
from services.mocap.search.plausibility import look_first
from services.mocap.search.settings import SearchSettings
from services.mocap.search.single_person import uncovered_share
from services.mocap.search.usual_differences import UsualDifferences, differences
from services.mocap.take.marks import PARTS
from services.mocap.types import Bytes, Floats

SETTINGS = SearchSettings(pose_prior=0.0)  # which would pull what nothing else pulls
Maker = Callable[..., Floats]
BENT = {"shoulder_elevation": -50.0, "elbow_flexion": 40.0, "hip_flexion": 25.0, "hip_abduction": 12.0}
SHANK = (SEGMENT_INDEX["left_shank"], SEGMENT_INDEX["left_foot"])


def about(model: Model, pose: Floats, segments: tuple[int, ...], margin_px: int = 6) -> Bytes:
    """Planes (P, H, W) of segments and of what is so near to them in the pictures."""
    planes = model.backend.coverage(pose[None], segments, Region.whole(model.rig))[0]
    masks = unpack(planes, model.rig.n_cameras)
    for _ in range(margin_px):
        for axis in (1, 2):
            masks |= np.roll(masks, 1, axis) | np.roll(masks, -1, axis)
    return pack(masks)


@pytest.fixture(scope="module")
def truth(standing: Maker) -> Floats:
    return standing(**BENT)


@pytest.fixture(scope="module")
def half_leg(model: Model, truth: Floats, silhouettes_of: Callable[[Floats], Bytes]) -> TriPlanes:
    """Everything but the left shank and foot, of which nobody is sure."""
    unsure = about(model, truth, SHANK)
    return TriPlanes(silhouettes_of(truth) & ~unsure, unsure)


@pytest.fixture(scope="module")
def start(truth: Floats) -> Floats:
    """A few degrees and centimetres away."""
    away = truth.copy()
    away[:3] += 0.02, -0.02, 0.01
    for name in ("left_knee_flexion", "right_knee_flexion", "left_hip_flexion"):
        away[DOF_INDEX[name]] += 0.05
    return away


def test_half_a_leg_that_is_unsure_pulls_nothing(
    model: Model,
    truth: Floats,
    start: Floats,
    half_leg: TriPlanes,
    joint_errors_mm: Callable[[Floats, Floats], Floats],
) -> None:
    aligner = model.aligner(SETTINGS)
    kept = aligner.align(Picture.whole(model.rig, half_leg.silhouettes, half_leg.unsure), start, SETTINGS)
    pulled = aligner.align(Picture.whole(model.rig, half_leg.silhouettes), start, SETTINGS)
    assert joint_errors_mm(kept.pose, truth).max() < 30
    assert joint_errors_mm(pulled.pose, truth).max() > 2 * joint_errors_mm(kept.pose, truth).max()
    assert kept.rim.lengths_px[list(SHANK), UNSURE].sum() > 5 * kept.rim.lengths_px[list(SHANK), KNOWN].sum()
    assert kept.rim.lengths_px[:, ON].sum() > 0.95 * kept.rim.lengths_px[:, KNOWN].sum()


def test_a_leg_that_is_unsure_is_not_judged_and_the_others_are_trusted(
    model: Model, truth: Floats, start: Floats, half_leg: TriPlanes
) -> None:
    whole_leg = about(model, truth, (*SHANK, SEGMENT_INDEX["left_thigh"]))
    picture = Picture.whole(model.rig, half_leg.silhouettes, half_leg.unsure | whole_leg)
    aligned = model.aligner(SETTINGS).align(picture, start, SETTINGS)
    covered = model.backend.coverage(aligned.pose[None], ALL_SURFACES, picture.region)[0]
    found = differences(model, picture, aligned.pose, covered)
    confidence = confidences(evidence_of(aligned.rim, found.nearest_px, aligned.pose), aligned.rim)
    assert "left_leg" not in confidence
    assert min(confidence[part] for part in ("torso", "head", "right_arm", "right_leg")) > 0.9


def test_nobody_is_in_doubt_for_unsure_pixels(model: Model, truth: Floats, half_leg: TriPlanes) -> None:
    picture, trust = (
        Picture.whole(model.rig, half_leg.silhouettes, half_leg.unsure),
        UsualDifferences(model.rig, 30.0),
    )
    found = solve_by_contours(model, picture, truth[None], SETTINGS, LocalLimbs(model), trust)
    assert found.passes == 0
    assert found.distrusted == []
    assert found.measured["part_px"][PARTS.index("left_leg")] < 30
    assert min(found.measured["iou"]) > 0.97


def test_a_little_that_is_sure_is_not_taken_for_all(model: Model, truth: Floats) -> None:
    covered = model.backend.coverage(truth[None], ALL_SURFACES, Region.whole(model.rig))[0]
    unsure = about(model, truth, ALL_SURFACES, 2)
    elsewhere = np.zeros_like(covered)
    elsewhere[:, 5:17, 5:17] = 255  # something small in every camera
    picture = Picture.whole(model.rig, elsewhere, unsure)
    assert differences(model, picture, truth, covered).share < 0.1
    assert uncovered_share(model, picture, truth, SETTINGS) < 0.2
    assert uncovered_share(model, Picture.whole(model.rig, elsewhere), truth, SETTINGS) == 1.0


def test_a_first_frame_is_not_refused_for_unsure_pixels(
    model: Model, standing: Maker, silhouettes_of: Callable[[Floats], Bytes]
) -> None:
    pose = standing(shoulder_elevation=-45)
    planes = silhouettes_of(pose)
    sure, rng = unpack(planes, model.rig.n_cameras), np.random.default_rng(0)
    unsure = np.zeros_like(sure)
    unsure[:, 225:] = True  # the floor down to the pictures' edge, all across
    unsure[:3, :, 40:120] = True  # somebody else, perhaps
    feet = unpack(about(model, pose, (SEGMENT_INDEX["left_foot"], SEGMENT_INDEX["right_foot"])), len(sure))
    unsure |= feet
    unsure |= rng.random(sure.shape) < 0.1
    seen = sure & ~unsure
    look = look_first(model.rig, seen, (), seen | unsure)
    assert look.left_out == ()
    hull, exact = carve(model.rig, seen, seen | unsure), carve(model.rig, sure)
    assert hull.height_m == pytest.approx(exact.height_m, abs=0.25)
    np.testing.assert_allclose(hull.axis_world_m, exact.axis_world_m, atol=0.05)
    assert hull.may_be(0.9 * exact.height_m, 1.1 * exact.height_m)


def test_nothing_but_unsure_pixels_is_said(model: Model, truth: Floats) -> None:
    nothing = np.zeros((model.rig.n_cameras, *model.rig.shape_px), bool)
    possible = unpack(about(model, truth, ALL_SURFACES, 1), model.rig.n_cameras)
    with pytest.raises(TakeError, match=r"what 8 of 8 cameras show of the actor .* is all unsure"):
        look_first(model.rig, nothing, (), possible)
