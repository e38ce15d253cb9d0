"""Which body is searched: one whose waist bends, or the published one, whose trunk is rigid."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.skeleton import BODY_DOFS, DOF_INDEX, BodyName, dofs_of, pose_of_body
from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import HEAD, LIMBS, TORSO
from services.mocap.search.first_pose import find_first_pose
from services.mocap.search.frame import solve_frame
from services.mocap.search.hull import carve
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import Model
from services.mocap.search.settings import PRESETS, Preset, SearchSettings
from services.mocap.search.stages import descend_stage
from services.mocap.types import Floats

PictureOf = Callable[[Floats], Picture]
Errors = Callable[[Floats, Floats], Floats]
WAIST = list(dofs_of("waist"))
QUICK = {"arm_grid": (3, 3, 1, 3), "leg_grid": (3, 1, 1, 3), "max_passes": 1}


@pytest.fixture(scope="module")
def bowing(standing: Callable[..., Floats]) -> Floats:
    return standing(shoulder_elevation=-40, elbow_flexion=30, waist_pitch=35, waist_lean=12, waist_turn=20)


def test_the_published_torso_has_the_root_alone() -> None:
    assert TORSO.of("paper").dofs == dofs_of("pelvis")
    assert TORSO.of("anatomical") == TORSO
    assert TORSO.of("paper").segments == TORSO.segments


def test_limbs_and_head_are_the_same_in_both_bodies() -> None:
    """A limb's result on the wire has all parameters of the limb, whatever the body."""
    for stage in (HEAD, *(stage for limb in LIMBS.values() for stage in (limb.main, limb.extremity))):
        assert stage.of("paper") == stage


def test_a_waist_that_bends_is_found(
    model: Model, bowing: Floats, picture_of: PictureOf, joint_errors_mm: Errors
) -> None:
    start = pose_of_body(bowing, "paper")
    found = solve_frame(model, picture_of(bowing), start[None], SearchSettings(), LocalLimbs(model))
    assert joint_errors_mm(start, bowing).max() > 150
    assert joint_errors_mm(found.pose, bowing).mean() < 10
    np.testing.assert_allclose(found.pose[WAIST], bowing[WAIST], atol=np.radians(4))
    assert found.distrusted == []


def test_the_papers_torso_stage_finds_the_waist_of_a_body_that_has_one(
    model: Model, bowing: Floats, picture_of: PictureOf, joint_errors_mm: Errors
) -> None:
    start = pose_of_body(bowing, "paper")
    coarse = picture_of(bowing).halved()
    found = descend_stage(model, TORSO, coarse, start, SearchSettings(method="paper"))
    assert found.dofs == TORSO.dofs
    before_mm, after_mm = (joint_errors_mm(p, bowing).mean() for p in (start, found.applied_to(start)))
    assert after_mm < 0.4 * before_mm
    rigid = descend_stage(model, TORSO.of("paper"), coarse, start, PRESETS["paper"])
    assert rigid.dofs == TORSO.of("paper").dofs
    assert rigid.energy_px > 2 * found.energy_px


@pytest.mark.parametrize("preset", PRESETS)
def test_the_published_body_is_never_bent(
    model: Model, bowing: Floats, picture_of: PictureOf, preset: Preset
) -> None:
    """Not even from a start that bends."""
    settings = SearchSettings.model_validate(PRESETS[preset].model_dump() | {"body": "paper"} | QUICK)
    starts = np.stack([bowing, bowing + 0.02])
    found = solve_frame(model, picture_of(bowing), starts, settings, LocalLimbs(model))
    np.testing.assert_array_equal(found.pose[WAIST], 0.0)
    assert np.abs(found.pose - bowing)[list(BODY_DOFS["paper"])].max() > 0.01


@pytest.mark.parametrize("body", ["anatomical", "paper"])
def test_the_first_pose_is_of_the_body(
    model: Model,
    standing: Callable[..., Floats],
    picture_of: PictureOf,
    joint_errors_mm: Errors,
    body: BodyName,
) -> None:
    truth = standing(root_heading=40, shoulder_elevation=-60, elbow_flexion=15, waist_pitch=20, waist_turn=15)
    picture, facing_rad = picture_of(truth), float(truth[DOF_INDEX["root_heading"]])
    hull = carve(model.rig, unpack(picture.silhouettes, model.rig.n_cameras))
    settings = SearchSettings(body=body)
    pose = find_first_pose(model, picture, hull, LocalLimbs(model), settings, facing_rad).solution.pose
    if body == "paper":
        np.testing.assert_array_equal(pose[WAIST], 0.0)
    else:
        assert joint_errors_mm(pose, truth).mean() < 20
        assert pose[DOF_INDEX["waist_pitch"]] > np.radians(12)
