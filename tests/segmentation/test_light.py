"""The light over the picture, and who must not be taken for it."""

from functools import cache

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.types import Bytes, Floats
from services.segmentation.light import light_field
from services.segmentation.pixels import MEAN_STEPS, Levels

HEIGHT, WIDTH = 240, 320
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH] / np.array([HEIGHT, WIDTH])[:, None, None]


def stage() -> Floats:
    """(H, W, 3) with texture."""
    return _stage().copy()


@cache
def _stage() -> Floats:
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.normal(0, 60, (HEIGHT, WIDTH)), (0, 0), 6) + rng.normal(
        0, 3, (HEIGHT, WIDTH)
    )
    return np.asarray((125 + texture)[..., None] * [1.04, 1.0, 0.96])


def field(picture: Floats | Bytes, plate: Floats, gains: tuple[float, float, float] = (1, 1, 1)) -> Levels:
    channels = np.clip(np.rint(np.moveaxis(picture, 2, 0)), 0, 255).astype(np.uint8)
    mean = np.rint(np.moveaxis(plate, 2, 0) * MEAN_STEPS).astype(np.int16)
    found = light_field(channels, mean, np.array(gains, np.float32))
    assert found.shape[0] >= plate.shape[0] and found.shape[1] >= plate.shape[1]
    return found[: plate.shape[0], : plate.shape[1]]


@settings(max_examples=10)
@given(st.floats(0.83, 1.2))
def test_light_that_is_the_same_everywhere_is_found(light: float) -> None:
    assert field(stage() * light, stage()) == pytest.approx(light, abs=0.006)


def test_gains_count_before_the_light() -> None:
    gains = (1.1, 0.95, 0.9)
    assert field(stage() * gains, stage(), gains) == pytest.approx(1.0, abs=0.005)


@pytest.mark.parametrize("height", [-0.15, 0.15])
def test_a_bright_or_dark_patch_keeps_its_top(height: float) -> None:
    light = 1 + height * np.sin(2.5 * np.pi * COLUMNS) * np.sin(1.5 * np.pi * ROWS)
    rng = np.random.default_rng(1)
    found = field(stage() * light[..., None] + rng.normal(0, 2, (HEIGHT, WIDTH, 1)), stage())
    inner = (slice(32, -32), slice(32, -32))
    np.testing.assert_allclose(found[inner], light[inner], atol=0.02)


@settings(max_examples=10)
@given(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15))
def test_light_that_changes_smoothly_is_found(across: float, down: float) -> None:
    light = 1 + across * (COLUMNS - 0.5) + down * (ROWS - 0.5)
    rng = np.random.default_rng(1)
    found = field(stage() * light[..., None] + rng.normal(0, 2, (HEIGHT, WIDTH, 1)), stage())
    inner = (slice(32, -32), slice(32, -32))
    np.testing.assert_allclose(found[inner], light[inner], atol=0.012)
    np.testing.assert_allclose(found, light, atol=0.03)


@pytest.mark.parametrize("colour", [(30, 25, 160), (95, 45, 35), (18, 18, 20), (245, 250, 240), (60, 50, 55)])
def test_somebody_who_covers_a_fifth_of_the_picture_is_not_light(colour: tuple[int, int, int]) -> None:
    light = 1 + 0.1 * (COLUMNS - 0.5)
    picture = stage() * light[..., None]
    picture[30:210, 120:205] = colour
    found = field(picture, stage())
    np.testing.assert_allclose(found[:, :104], light[:, :104], atol=0.02)
    np.testing.assert_allclose(found[:, 221:], light[:, 221:], atol=0.02)


@pytest.mark.parametrize("colour", [(95, 45, 35), (18, 18, 20), (60, 50, 55)])
def test_there_is_light_on_somebody_far_darker_than_the_stage(colour: tuple[int, int, int]) -> None:
    light = 1 + 0.1 * (COLUMNS - 0.5)
    picture = stage() * light[..., None]
    picture[30:210, 120:205] = colour
    np.testing.assert_allclose(field(picture, stage()), light, atol=0.05)


def far_floor() -> Floats:
    """(H, W) light that drifts over a floor seen at a grazing angle: it changes within a few rows."""
    tilt = 0.06 * (COLUMNS - 0.5) + 0.1 * (ROWS - 0.5)
    return np.asarray(1 + tilt + 0.09 * np.exp(-(((ROWS - 0.6) * HEIGHT / 6) ** 2)))


@pytest.mark.parametrize("size", [(320, 240), (272, 480), (320, 180)])
def test_a_narrow_band_of_light_on_the_far_floor_is_found(size: tuple[int, int]) -> None:
    light, plate = (cv2.resize(picture, size) for picture in (far_floor(), stage()))
    rng = np.random.default_rng(1)
    found = field(plate * light[..., None] + rng.normal(0, 2, (*light.shape, 1)), plate)
    assert np.abs(found - light)[8:-8, 16:-16].max() < 0.04
    assert np.abs(found - light).mean() < 0.006


@pytest.mark.parametrize("cloth", [0.9, 0.95, 1.06, 1.12])
def test_legs_hardly_brighter_or_darker_than_the_stage_are_no_band(cloth: float) -> None:
    light = far_floor()
    picture = stage() * light[..., None]
    legs = np.zeros((HEIGHT, WIDTH), np.bool_)
    legs[90:210, 144:160] = legs[90:210, 176:192] = True
    picture[legs] *= cloth
    off = np.abs(field(picture, stage()) - light)[legs]
    assert off.mean() < 0.015
    assert off.max() < 0.05


@pytest.mark.parametrize("cloth", [0.85, 0.93, 1.1, 1.18])
@pytest.mark.parametrize("part", [np.s_[80:91, 85:235], np.s_[150:175, 90:230]], ids=["arms", "lying"])
def test_arms_and_who_lies_on_the_floor_are_no_band(cloth: float, part: tuple[slice, slice]) -> None:
    light = 1 + 0.08 * (COLUMNS - 0.5)
    picture = stage() * light[..., None]
    picture[part] *= cloth
    found = field(picture, stage())
    # Half of what tells the cloth from the stage must be left.
    assert np.abs(found - light)[part].mean() < 0.5 * abs(cloth - 1)


def test_a_cast_shadow_is_not_light() -> None:
    picture = stage()
    picture[180:205, 60:230] *= 0.6
    np.testing.assert_allclose(field(picture, stage()), 1, atol=0.01)


def test_a_picture_too_small_for_tiles_is_in_even_light() -> None:
    assert (field(stage()[:30, :33] * 1.1, stage()[:30, :33]) == 1).all()


def test_a_black_stage_tells_nothing_of_the_light() -> None:
    black = np.zeros((HEIGHT, WIDTH, 3))
    assert (field(black + 30, black) == 1).all()
