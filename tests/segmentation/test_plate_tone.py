"""A clean plate of another contrast than the pictures."""

from collections.abc import Callable

import numpy as np
import pytest
from wall_scene import COLOURS, HEIGHT, WIDTH, disc, exposed, plate_frames, wall

from services.mocap.types import Bytes, Floats
from services.segmentation.pixels import MEAN_STEPS, Levels
from services.segmentation.plate import Plate
from services.segmentation.plate_tone import plate_tone

CURVES: dict[str, Callable[[Floats], Floats]] = {
    "less contrast": lambda levels: 50 + 0.6 * levels,
    "limited to full range": lambda levels: (levels - 16) / 0.859,
    "gamma 0.8": lambda levels: 255 * (levels.clip(0) / 255) ** 0.8,
    "gamma 1.25": lambda levels: 255 * (levels.clip(0) / 255) ** 1.25,
    "half the light": lambda levels: 0.5 * levels,
    "a brighter day": lambda levels: 1.5 * levels,
}


def shown() -> Floats:
    """The wall with somebody before a fifth of it."""
    scene = wall()
    scene[disc(70)] = COLOURS["navy"]
    return scene


def picture(scene: Floats, noise: float = 2.0) -> Bytes:
    return exposed(scene, np.random.default_rng(1), noise=noise)


def plate_mean() -> Levels:
    return np.moveaxis(np.mean(plate_frames(12), axis=0), 2, 0).astype(np.float32)


@pytest.mark.parametrize("name", CURVES)
def test_the_curve_between_plate_and_picture_is_found(name: str) -> None:
    curve = CURVES[name]
    tone = plate_tone(plate_mean(), picture(curve(shown())))
    assert tone is not None
    found, slopes = tone.of(plate_mean())
    expected = np.moveaxis(curve(wall()), 2, 0)
    is_usual = np.abs(wall().mean(axis=2) - 125) < 40
    assert np.abs(found - expected)[:, is_usual].mean() < 2.0
    assert np.all(slopes > 0)


@pytest.mark.parametrize("gains", [(1.0, 1.0, 1.0), (0.7, 0.7, 0.7), (1.2, 1.0, 0.9)])
@pytest.mark.parametrize("noise", [1.0, 9.0])
def test_exposure_and_white_balance_are_no_tone(gains: tuple[float, float, float], noise: float) -> None:
    assert plate_tone(plate_mean(), picture(shown() * np.array(gains), noise)) is None


def test_light_from_one_side_is_no_tone() -> None:
    side = np.linspace(0.9, 1.1, WIDTH)[None, :, None]
    assert plate_tone(plate_mean(), picture(shown() * side)) is None


@pytest.mark.parametrize("level", [0, 90, 255])
def test_a_stage_of_one_level_has_no_tone(level: int) -> None:
    flat = np.full((HEIGHT, WIDTH, 3), level, np.uint8)
    assert plate_tone(np.moveaxis(flat, 2, 0).astype(np.float32), picture(shown())) is None


def test_a_plate_takes_the_contrast_of_the_pictures() -> None:
    frames = [np.rint(16 + 0.859 * frame).astype(np.uint8) for frame in plate_frames(12)]
    plain, adapted = Plate.learn(plate_frames(12)), Plate.learn(frames, picture=picture(shown()))
    assert (plain.has_other_tone, adapted.has_other_tone) == (False, True)
    gain = np.median(adapted.mean / plain.mean)
    assert np.percentile(np.abs(adapted.mean - gain * plain.mean) / MEAN_STEPS, 90) < 2.5
