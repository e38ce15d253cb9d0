"""The shapes that people have: a proper distribution whose samples look like people."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from random_shapes import random_shape
from services.mocap.body.actor import build_body
from services.mocap.body.kinematics import N_DOF, segment_transforms
from services.mocap.body.shape_space import (
    DEVIATIONS,
    INDEX,
    LOWER,
    PARAMETERS,
    UPPER,
    actor_of,
    body_of,
    with_true_height,
    without_shoes,
)
from services.mocap.body.skeleton import SEGMENT_INDEX
from services.mocap.fit.priors import COVARIANCE, Prior
from services.mocap.types import Floats

SEEDS = st.integers(0, 2**32 - 1)


def correlation(one: str, other: str) -> float:
    i, j = INDEX[one], INDEX[other]
    return float(COVARIANCE[i, j] / (DEVIATIONS[i] * DEVIATIONS[j]))


def test_covariance_is_one_and_has_the_deviations() -> None:
    np.testing.assert_allclose(COVARIANCE, COVARIANCE.T)
    assert np.linalg.eigvalsh(COVARIANCE).min() > 1e-4
    np.testing.assert_allclose(np.sqrt(np.diag(COVARIANCE)), DEVIATIONS)


def test_in_loose_clothes_trunk_and_legs_are_held_closer_to_the_mean() -> None:
    prior = Prior(np.zeros((1, N_DOF)))
    long = [INDEX[bone] for bone in ("pelvis", "torso", "thigh", "shank")]
    for misfit, share in ((1.0, 1.0), (8.0, 1.0), (16.0, 0.5)):
        prior.misfit = misfit
        expected = np.linalg.inv(prior.shape_precision(1) / prior.shape_weight_px3)
        shares = np.sqrt(np.diag(expected)) / DEVIATIONS
        np.testing.assert_allclose(shares[long], share)
        np.testing.assert_allclose(np.delete(shares, long), 1.0)


def test_girths_go_together_and_more_so_next_to_each_other() -> None:
    assert correlation("trunk_width_waist", "leg_girth_calf") == 0.5
    assert correlation("leg_girth_knee", "leg_girth_calf") > correlation("leg_girth_knee", "leg_girth_hip")
    assert correlation("leg_girth_ankle", "foot_width") == 0.0  # next to each other in the vector only
    assert 0.0 < correlation("thigh", "upper_arm") < 0.5
    assert correlation("thigh", "torso") == 0.0


@given(SEEDS)
@settings(max_examples=20, deadline=None)
def test_random_shapes_are_of_the_height_asked_for_and_repeat(seed: int) -> None:
    x = random_shape(np.random.default_rng(seed), 1.6, 1.7)
    np.testing.assert_array_equal(x, random_shape(np.random.default_rng(seed), 1.6, 1.7))
    assert np.all((x >= LOWER) & (x <= UPPER))
    assert 1.6 - 1e-6 <= body_of(x).standing_height_m <= 1.7 + 1e-6


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_restating_the_height_changes_the_numbers_and_not_the_body(seed: int) -> None:
    x = random_shape(np.random.default_rng(seed))
    body, found = body_of(x), with_true_height(x)
    restated = actor_of(found)
    same = build_body(restated)
    assert restated.height == pytest.approx(body_of(without_shoes(found)).standing_height_m, abs=5e-4)
    assert same.standing_height_m == pytest.approx(body.standing_height_m, abs=5e-4)
    for mine, others in zip(same.vertices_m, body.vertices_m, strict=True):
        np.testing.assert_allclose(mine, others, atol=5e-3)
    # How deep the hip joints lie is stated in heights, so it changes by a share of what the height does.
    change_m = abs(restated.height - body.height_m)
    np.testing.assert_allclose(same.offsets_m, body.offsets_m, atol=0.03 * change_m + 1e-4)


def test_restating_the_generic_body_changes_nothing() -> None:
    np.testing.assert_allclose(with_true_height(np.zeros(len(PARAMETERS))), 0.0, atol=1e-12)


def half_widths_m(x: Floats) -> Floats:
    """Half the body's breadth by centimetre, from below the hips to below the armpits, standing straight."""
    body = body_of(x)
    T_world_segment = segment_transforms(np.zeros((1, N_DOF)), body.offsets_m)[0]
    points_m = np.concatenate(
        [
            body.vertices_m[s] + T_world_segment[s, :3, 3]
            for s in (SEGMENT_INDEX[name] for name in ("pelvis", "torso", "left_thigh"))
        ]
    )
    levels_m = np.arange(-0.15, 0.30, 0.01)
    return np.array([points_m[np.abs(points_m[:, 2] - z) < 0.011, 1].max() for z in levels_m])


def test_the_outline_of_hips_and_waist_has_no_step() -> None:
    """Of two hundred bodies; one of a million, far from what people are like, may have one."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        assert np.abs(np.diff(half_widths_m(random_shape(rng)), 2)).max() < 0.012
