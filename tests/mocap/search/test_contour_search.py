"""A frame by contours: limbs that jumped are found by XOR, and what cannot be explained is marked."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.body.garments import Skirt
from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.search.best_path import apart_m
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.frame import solve_frame
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.lost_probability import LOST_M
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.usual_differences import UsualDifferences
from services.mocap.take.marks import PARTS, Part
from services.mocap.types import Bytes, Floats

Maker = Callable[..., Floats]
Errors = Callable[[Floats, Floats], Floats]


def _lost(pose: Floats, truth: Floats, body: Body) -> set[Part]:
    """The parts that a pose has more than 15 cm from the true one."""
    apart = apart_m(pose, truth, body.offsets_m)
    return {part for part, off_m in zip(PARTS, apart, strict=True) if off_m > LOST_M}


def test_an_easy_frame_needs_no_limb_search(
    model: Model, standing: Maker, picture_of: Callable[[Floats], Picture], joint_errors_mm: Errors
) -> None:
    truth = standing(shoulder_elevation=-40, elbow_flexion=30)
    found = solve_frame(model, picture_of(truth), (truth + 0.03)[None], SearchSettings(), LocalLimbs(model))
    assert found.passes == 0
    assert found.distrusted == []
    assert joint_errors_mm(found.pose, truth).mean() < 5
    assert min(found.confidence.values()) > 0.9
    covered = model.backend.coverage(found.pose[None], ALL_SURFACES, picture_of(truth).region)[0]
    assert found.energy_px == np.bitwise_count(covered ^ picture_of(truth).silhouettes).sum()


@pytest.mark.parametrize("parameter", ["left_shoulder_elevation", "right_shoulder_forward"])
def test_an_arm_that_jumped_is_found(
    model: Model,
    standing: Maker,
    picture_of: Callable[[Floats], Picture],
    joint_errors_mm: Errors,
    parameter: str,
) -> None:
    truth = standing(shoulder_elevation=-20, elbow_flexion=20)
    start = truth.copy()
    start[DOF_INDEX[parameter]] -= 1.0
    found = solve_frame(model, picture_of(truth), start[None], SearchSettings(), LocalLimbs(model))
    assert found.passes >= 1
    assert joint_errors_mm(start, truth).max() > 300
    assert joint_errors_mm(found.pose, truth).max() < 30
    assert found.distrusted == []
    assert set(found.limb_seconds) >= {parameter.split("_")[0] + "_arm"}


@pytest.mark.parametrize(
    "far_off",
    [
        {"left_hip_flexion": 120, "left_knee_flexion": 20},
        {"right_shoulder_elevation": 80, "right_elbow_flexion": 90},
    ],
)
def test_a_limb_far_from_where_it_was_is_found(
    model: Model,
    standing: Maker,
    picture_of: Callable[[Floats], Picture],
    joint_errors_mm: Errors,
    far_off: dict[str, float],
) -> None:
    truth = standing(shoulder_elevation=-75, elbow_flexion=15, knee_flexion=5)
    start = standing(shoulder_elevation=-75, elbow_flexion=15, knee_flexion=5)
    for name, angle in far_off.items():
        start[DOF_INDEX[name]] = np.radians(angle)
    found = solve_frame(model, picture_of(truth), start[None], SearchSettings(), LocalLimbs(model))
    assert joint_errors_mm(start, truth).max() > 700
    assert joint_errors_mm(found.pose, truth).max() < 40


@pytest.mark.parametrize("seed", range(4))
def test_legs_that_slip_onto_each_other_are_parted(
    model: Model, standing: Maker, picture_of: Callable[[Floats], Picture], joint_errors_mm: Errors, seed: int
) -> None:
    truth = standing(shoulder_elevation=-50, elbow_flexion=40, knee_flexion=30, hip_flexion=25)
    start = clip_to_limits(truth + np.random.default_rng(seed).normal(0, 0.06, N_DOF))
    found = solve_frame(model, picture_of(truth), start[None], SearchSettings(), LocalLimbs(model))
    assert joint_errors_mm(found.pose, truth).mean() < 6
    assert joint_errors_mm(found.pose, truth).max() < 40


def test_what_no_pose_explains_is_marked(
    model: Model, standing: Maker, silhouettes_of: Callable[[Floats], Bytes]
) -> None:
    truth = standing(shoulder_elevation=-40)
    planes = silhouettes_of(truth)
    trust = UsualDifferences(model.rig, SearchSettings().doubt_px)
    args = (SearchSettings(), LocalLimbs(model))
    clean = solve_frame(model, Picture.whole(model.rig, planes), truth[None], *args, trust=trust)
    without_arms = planes.copy()
    rows = np.flatnonzero(planes.any(axis=(0, 2)))
    upper = slice(rows[0] + 25, rows[0] + 60)
    without_arms[:, upper] = 0  # a belt of the picture is lost in all cameras
    found = solve_frame(model, Picture.whole(model.rig, without_arms), truth[None], *args, trust=trust)
    assert clean.distrusted == []
    assert set(found.distrusted) == {"torso", *_lost(found.pose, truth, model.body)}


@pytest.mark.parametrize("flexion", [110, 120])
def test_what_is_lost_in_a_skirt_is_marked_and_nothing_else(
    model: Model, standing: Maker, flexion: int
) -> None:
    body = build_body(Actor(height=1.75, skirt=Skirt(length=0.45, flare=0.08)))
    dressed = Model(body, model.rig, CpuBackend(body, model.rig))
    truth = standing(shoulder_elevation=-50, right_hip_flexion=35, right_knee_flexion=70)
    picture = Picture.whole(
        model.rig, dressed.backend.coverage(truth[None], ALL_SURFACES, Region.whole(model.rig))[0]
    )
    start = standing(shoulder_elevation=-50, right_hip_flexion=20, right_knee_flexion=flexion)
    trust = UsualDifferences(model.rig, SearchSettings().doubt_px)
    found = solve_frame(dressed, picture, start[None], SearchSettings(), LocalLimbs(dressed), trust=trust)
    assert set(found.distrusted) == _lost(found.pose, truth, body)


def test_searching_always_searches_all(
    model: Model, standing: Maker, picture_of: Callable[[Floats], Picture]
) -> None:
    small = {"arm_grid": (1, 1, 1, 1), "leg_grid": (1, 1, 1, 1), "max_passes": 1}
    settings = SearchSettings.model_validate({"search_limbs": "always", **small})
    truth = standing()
    found = solve_frame(model, picture_of(truth), truth[None], settings, LocalLimbs(model))
    assert set(found.limb_seconds) == {"left_arm", "right_arm", "left_leg", "right_leg"}
