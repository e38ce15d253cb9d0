"""The prior of limbs' poses: what it costs, how it pulls, and what it is made of."""

from pathlib import Path

import numpy as np
import pytest

from bench.pose_prior import write_prior
from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.search.chains import LIMBS
from services.mocap.search.model import Model
from services.mocap.search.pose_prior import PARAMETERS, TABLE, add_pose_prior, pose_prior, surprises
from services.mocap.search.settings import SearchSettings
from services.mocap.search.typical_poses import typical_poses
from services.mocap.take.csv_columns import read_columns
from services.mocap.types import Floats


def usual_pose() -> Floats:
    """(D,) every limb as the prior has it most likely."""
    pose, prior = np.zeros(N_DOF), pose_prior()
    for dofs, means in zip(prior.dofs, prior.means, strict=True):
        pose[dofs] = means
    return pose


def test_the_likeliest_pose_costs_nothing_and_both_sides_cost_the_same() -> None:
    usual = usual_pose()
    np.testing.assert_array_equal(surprises(usual[None]), 0.0)
    np.testing.assert_array_equal(clip_to_limits(usual), usual)
    first, images = np.split(typical_poses()[1:], 2)
    np.testing.assert_allclose(surprises(images), surprises(first)[:, [1, 0, 3, 2]])


def test_crossed_legs_and_arms_behind_the_back_are_less_likely_than_what_people_do() -> None:
    usual = np.quantile(surprises(typical_poses()), 0.9, axis=0)
    crossed, behind = usual_pose(), usual_pose()
    crossed[DOF_INDEX["left_hip_abduction"]] = np.radians(-35.0)
    behind[DOF_INDEX["left_shoulder_forward"]] = np.radians(-80.0)
    legs, arms = surprises(crossed[None])[0], surprises(behind[None])[0]
    assert legs[2] > usual[2]
    assert arms[0] > usual[0]
    np.testing.assert_array_equal(legs[[0, 1, 3]], 0.0)
    np.testing.assert_array_equal(arms[1:], 0.0)


def test_the_slope_is_that_of_the_price() -> None:
    pose = typical_poses()[5].copy()
    hessian, slope, step = np.zeros((N_DOF, N_DOF)), np.zeros(N_DOF), 1e-6
    add_pose_prior(pose_prior(), 3.0, pose, hessian, slope)
    moved = np.concatenate([pose + step * np.eye(N_DOF), pose - step * np.eye(N_DOF)])
    ahead, behind = np.split(3.0 * surprises(moved).sum(axis=1), 2)
    # As for all prices, a cost of k x² has the slope k x and the curvature k.
    np.testing.assert_allclose(slope, (ahead - behind) / (4 * step), atol=1e-6)
    assert np.linalg.eigvalsh(hessian).min() > -1e-9


def test_the_price_is_of_cameras(model: Model) -> None:
    pose = np.zeros(N_DOF)
    settings = SearchSettings(pose_prior=2.0, contact=0.0)
    priced = model.aligner(settings).prices_px(pose[None], settings)
    np.testing.assert_allclose(priced, 2.0 * 8 * surprises(pose[None]).sum(axis=1))
    free = SearchSettings(pose_prior=0.0, contact=0.0)
    assert not model.aligner(free).prices_px(pose[None], free).any()


def test_the_table_has_means_and_covariances_of_both_sides(tmp_path: Path) -> None:
    rng, poses = np.random.default_rng(2), np.zeros((400, N_DOF))
    for name, limb in LIMBS.items():
        middle = 0.3 if name.endswith("leg") else -0.2
        poses[:, list(limb.main.dofs)] = rng.normal(middle, 0.5, (400, 4))
    path = tmp_path / TABLE.name
    write_prior(poses, path)
    table = read_columns(path, [], allow_extra=True)
    assert [*table.cells["parameter"]] == PARAMETERS["arm"] + PARAMETERS["leg"]
    assert table.numbers("mean_rad") == pytest.approx([-0.2] * 4 + [0.3] * 4, abs=0.08)
    covariances = np.array([table.numbers(f"with_{k}") for k in range(1, 5)]).T.reshape(2, 4, 4)
    np.testing.assert_allclose(covariances, np.tile(0.27 * np.eye(4), (2, 1, 1)), atol=0.05)
