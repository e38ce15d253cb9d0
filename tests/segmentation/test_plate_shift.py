"""A plate beside its pictures is found and moved."""

import cv2
import numpy as np
import pytest

from services.mocap.types import Bytes
from services.segmentation.plate_shift import plate_shift_px, shifted


def stage(seed: int = 0) -> Bytes:
    """A textured wall with a skirting board and panels (240, 320, 3)."""
    rng = np.random.default_rng(seed)
    picture = 130.0 + cv2.GaussianBlur(rng.normal(0, 40, (240, 320)), (0, 0), 5)
    picture[170:180] -= 50
    picture[:, ::60] -= 25
    return np.clip(picture[..., None] + np.zeros(3), 0, 255).astype(np.uint8)


def seen(picture: Bytes, gain: float = 1.0) -> Bytes:
    """What a camera makes of it, with somebody in red before it."""
    noisy = picture * gain + np.random.default_rng(1).normal(0, 2.5, picture.shape)
    noisy[60:200, 140:180] = (40, 40, 150)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("shift_px", [(1.3, -0.7), (-0.5, 0.4), (3.0, 2.0), (-4.0, 1.0)])
def test_a_shift_is_found_to_a_fifth_of_a_pixel(shift_px: tuple[float, float]) -> None:
    (moved,) = shifted([stage()], shift_px)
    found = plate_shift_px(moved, seen(stage(), gain=1.1))
    assert found == pytest.approx((-shift_px[0], -shift_px[1]), abs=0.2)


@pytest.mark.parametrize("gain", [0.9, 1.0, 1.15])
def test_a_plate_that_lies_well_stays(gain: float) -> None:
    assert plate_shift_px(stage(), seen(stage(), gain)) == (0.0, 0.0)


def test_a_stage_in_one_colour_and_another_stage_tell_of_no_shift() -> None:
    even = np.full((240, 320, 3), 120, np.uint8)
    assert plate_shift_px(even, even) == (0.0, 0.0)
    assert plate_shift_px(stage(0), stage(5)) == (0.0, 0.0)


def test_frames_that_need_no_shift_are_the_same() -> None:
    picture = stage()
    (same,) = shifted([picture], (0.0, 0.0))
    assert same is picture
