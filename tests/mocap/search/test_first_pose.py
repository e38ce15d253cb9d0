"""The first pose: heading and joints from the model's own silhouettes, and when a heading is ambiguous."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX, LOWER, UPPER
from services.mocap.energy.bitplanes import count_bits, unpack
from services.mocap.energy.picture import Picture
from services.mocap.search.first_pose import FirstPose, find_first_pose, standing_pose
from services.mocap.search.found import FrameSolution
from services.mocap.search.hull import Hull, carve
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Floats

Poser = Callable[..., Floats]
PictureOf = Callable[[Floats], Picture]
Errors = Callable[[Floats, Floats], Floats]
HEADING = DOF_INDEX["root_heading"]


def hull_of(model: Model, picture: Picture) -> Hull:
    return carve(model.rig, unpack(picture.silhouettes, model.rig.n_cameras))


def off_rad(heading_rad: float, true_rad: float) -> float:
    """The angle between two headings, however often round."""
    return abs(float(np.angle(np.exp(1j * (heading_rad - true_rad)))))


@pytest.mark.parametrize(
    "stance",
    [
        {"root_heading": 25, "shoulder_elevation": -40, "hip_abduction": 5},
        {"root_heading": -140, "shoulder_elevation": -85, "elbow_flexion": 10},
        {"root_heading": 80, "shoulder_elevation": -3},
        {
            "root_heading": 170,
            "shoulder_elevation": -78,
            "left_hip_flexion": 24,
            "left_knee_flexion": 8,
            "right_hip_flexion": -14,
            "right_knee_flexion": 18,
            "left_shoulder_forward": -25,
            "right_shoulder_forward": 20,
        },
    ],
    ids=["A", "hanging", "T", "walking"],
)
def test_finds_heading_and_joints(
    model: Model, standing: Poser, picture_of: PictureOf, joint_errors_mm: Errors, stance: dict[str, float]
) -> None:
    truth = standing(**stance)
    picture, limbs = picture_of(truth), LocalLimbs(model)
    found = find_first_pose(model, picture, hull_of(model, picture), limbs, SearchSettings())
    pose = found.solution.pose
    assert off_rad(pose[HEADING], truth[HEADING]) < np.radians(15)
    assert joint_errors_mm(pose, truth).mean() < 40
    assert np.all((pose >= LOWER) & (pose <= UPPER))
    assert not found.ambiguous
    assert found.opposite is not None
    assert found.opposite.energy_px > 1.5 * found.solution.energy_px


def test_a_given_facing_narrows_the_search(model: Model, standing: Poser, picture_of: PictureOf) -> None:
    """Told the opposite of the truth it looks there, and nowhere else."""
    truth = standing(root_heading=25, shoulder_elevation=-40)
    picture = picture_of(truth)
    wrong_rad = float(truth[HEADING]) + np.pi
    found = find_first_pose(
        model, picture, hull_of(model, picture), LocalLimbs(model), SearchSettings(), facing_rad=wrong_rad
    )
    assert off_rad(found.solution.pose[HEADING], wrong_rad) < np.radians(45)
    assert found.opposite is None
    assert not found.ambiguous


def test_a_camera_of_weight_0_has_no_say(
    model: Model, standing: Poser, picture_of: PictureOf, joint_errors_mm: Errors
) -> None:
    truth = standing(root_heading=-60, shoulder_elevation=-40)
    picture = picture_of(truth)
    hull = hull_of(model, picture)
    white = Picture.whole(model.rig, picture.silhouettes | np.uint8(1 << 2))
    weights = SearchSettings(camera_weights=tuple(float(c != 2) for c in range(8)))
    found = find_first_pose(model, white, hull, LocalLimbs(model), weights)
    assert joint_errors_mm(found.solution.pose, truth).mean() < 40
    assert found.solution.energy_px < 0.2 * count_bits(picture.silhouettes)


def test_stands_on_the_hull(model: Model) -> None:
    hull = Hull(np.array([[1.0, 2.0, 0.5], [1.0, 2.0, 2.0]]), np.ones(2, bool))
    pose = standing_pose(model, hull)
    np.testing.assert_array_equal(pose[:2], [1.0, 2.0])
    assert model.body.lowest_point_m(pose) == pytest.approx(hull.bottom_m)
    assert not pose[3:].any()


@pytest.mark.parametrize(
    ("opposite_px", "ambiguous"), [(None, False), (1000.0, True), (1049.0, True), (1051.0, False)]
)
def test_ambiguous_where_the_opposite_fits_nearly_as_well(opposite_px: float | None, ambiguous: bool) -> None:
    best = FrameSolution(np.zeros(N_DOF), 1000.0)
    opposite = None if opposite_px is None else FrameSolution(np.zeros(N_DOF), opposite_px)
    assert FirstPose(best, opposite).ambiguous is ambiguous
