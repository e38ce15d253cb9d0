"""Every price of poses in its two forms: pixels for the search, normal equations for the alignment."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.kinematics import N_DOF, joint_transforms
from services.mocap.search.alignment.contacts import Contacts
from services.mocap.search.alignment.pose_prices import PosePrices, add_prices
from services.mocap.search.alignment.twists import place_twists
from services.mocap.search.chains import LIMBS
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Floats

PRICES = ("contact", "pose_prior")
"""The settings of the prices."""
LIMB_DOFS = [d for limb in LIMBS.values() for d in limb.dofs]


def only(price: str) -> SearchSettings:
    """The default settings, in which one price at most is not 0."""
    default = SearchSettings()
    return default.model_copy(update={name: 0.0 for name in PRICES if name != price})


@pytest.fixture
def pose(standing: Callable[..., Floats]) -> Floats:
    """(D,) with both hands in the trunk, which few people do."""
    return standing(shoulder_elevation=-80.0, shoulder_twist=-62.0, elbow_flexion=140.0)


def added(model: Model, pose: Floats, settings: SearchSettings) -> tuple[Floats, Floats]:
    """What the prices add to the normal equations (D, D) and (D,)."""
    T_world_joint = joint_transforms(pose[None], model.body.offsets_m)[0]
    twists, hessian, slope = np.zeros((N_DOF, 6)), np.zeros((N_DOF, N_DOF)), np.zeros(N_DOF)
    place_twists(pose, T_world_joint, twists)
    prices = PosePrices.of(Contacts.of(model.body), model.rig, settings)
    add_prices(prices, pose, T_world_joint, twists, hessian, slope)
    return hessian, slope


def numerical_slope(model: Model, pose: Floats, settings: SearchSettings) -> Floats:
    """(D,) of the price in pixels."""
    step = 1e-6
    moved = np.concatenate([pose + step * np.eye(N_DOF), pose - step * np.eye(N_DOF)])
    ahead_px, behind_px = np.split(model.aligner(settings).prices_px(moved, settings), 2)
    return np.asarray((ahead_px - behind_px) / (2 * step))


@pytest.mark.parametrize("price", PRICES)
def test_the_alignment_goes_where_the_price_falls(model: Model, pose: Floats, price: str) -> None:
    settings = only(price)
    hessian, slope = added(model, pose, settings)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-9 * np.abs(hessian).max())
    assert np.linalg.eigvalsh(hessian).min() > -1e-9 * np.abs(hessian).max()
    assert not np.delete(slope, LIMB_DOFS).any()  # the trunk stays where the contours put it
    numerical = numerical_slope(model, pose, settings)[LIMB_DOFS]
    cosine = numerical @ slope[LIMB_DOFS] / (np.linalg.norm(numerical) * np.linalg.norm(slope))
    assert cosine > 0.95


def test_without_the_prices_a_pose_costs_nothing(model: Model, pose: Floats) -> None:
    settings = only("")
    assert not model.aligner(settings).prices_px(pose[None], settings).any()
    for equations in added(model, pose, settings):
        assert not equations.any()
