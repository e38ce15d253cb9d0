"""What a limb would cost elsewhere tells whether it is lost."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import LIMBS
from services.mocap.search.elsewhere import look_elsewhere, price_elsewhere
from services.mocap.search.frame import align_alone
from services.mocap.search.lost_probability import lost_at_price
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Bytes, Floats

SETTINGS = SearchSettings()


@pytest.fixture(scope="module")
def raised(standing: Callable[..., Floats]) -> Floats:
    return standing(shoulder_elevation=-10.0, hip_flexion=20.0)


@pytest.mark.parametrize("limb", ["left_arm", "right_leg"])
def test_of_a_limb_that_is_right_any_other_pose_costs_more(
    model: Model, raised: Floats, picture_of: Callable[[Floats], Picture], limb: str
) -> None:
    assert price_elsewhere(model, limb, picture_of(raised), raised, SETTINGS) > 1.0


def test_of_a_limb_that_is_lost_another_pose_costs_less(
    model: Model,
    raised: Floats,
    standing: Callable[..., Floats],
    picture_of: Callable[[Floats], Picture],
) -> None:
    """It is aligned with the contours: the best point of the grid has -0.72."""
    lost, dofs = raised.copy(), list(LIMBS["left_arm"].dofs)
    lost[dofs] = standing(shoulder_elevation=-80.0)[dofs]
    price = price_elsewhere(model, "left_arm", picture_of(raised), lost, SETTINGS)
    assert -1.0 < price < -0.8
    assert price_elsewhere(model, "right_leg", picture_of(raised), lost, SETTINGS) > 0.2


def test_a_limb_that_nothing_shows_costs_nothing_elsewhere(
    model: Model, raised: Floats, silhouettes_of: Callable[[Floats], Bytes]
) -> None:
    """Every pixel is unsure."""
    seen = TriPlanes(silhouettes_of(raised) * 0, np.full_like(silhouettes_of(raised), 255))
    assert price_elsewhere(model, "left_arm", Picture.of_frame(model.rig, seen), raised, SETTINGS) < 0.01


def test_only_limbs_that_are_not_sure_are_looked_at(
    model: Model, raised: Floats, picture_of: Callable[[Floats], Picture]
) -> None:
    picture = picture_of(raised)
    solution = align_alone(model, picture, raised, SETTINGS)
    solution.confidence.update(left_arm=0.9, right_arm=0.99)
    sure = dict(solution.confidence)
    look_elsewhere(model, picture, solution, SETTINGS)
    assert solution.confidence["left_arm"] > 0.98
    assert {**solution.confidence, "left_arm": 0.9} == sure


@pytest.mark.parametrize("lost", [0.02, 0.1, 0.5])
def test_the_dearer_elsewhere_the_less_likely_it_is_lost(lost: float) -> None:
    at_prices = [lost_at_price(lost, price) for price in (-0.5, 0.0, 0.05, 0.3, 1.0)]
    assert at_prices[0] == at_prices[1]
    assert all(np.diff(at_prices[1:]) < 0)
    assert lost_at_price(0.05, 0.1) < lost_at_price(0.1, 0.1)
