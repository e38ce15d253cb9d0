"""A codec's errors near what moves: measured on made-up pictures of a grey wall, and expected as noise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.types import Bytes
from services.segmentation.codec_errors import CodecErrors
from services.segmentation.comparison import Comparison
from services.segmentation.pixels import WHITENING_STEPS
from services.segmentation.plate import Plate

HEIGHT, WIDTH, BLOCK_PX = 160, 240, 8
ACTOR = np.s_[60:110, 90:120]
RNG = np.random.default_rng(3)


def wall(n: int) -> list[Bytes]:
    """Pictures of the empty stage under a sensor's noise."""
    noisy = 120 + RNG.normal(0, 2, (n, HEIGHT, WIDTH, 3))
    return list(np.rint(noisy).astype(np.uint8))


def with_errors(pictures: list[Bytes], levels: float, near_px: int) -> list[Bytes]:
    """An actor in each, and about the actor, so near, blocks that are off by a deviation."""
    rows, columns = ACTOR
    around = np.zeros((HEIGHT, WIDTH), bool)
    around[rows.start - near_px : rows.stop + near_px, columns.start - near_px : columns.stop + near_px] = 1
    seen = []
    for picture in pictures:
        blocks = RNG.normal(0, levels, (HEIGHT // BLOCK_PX, WIDTH // BLOCK_PX))
        errors = np.kron(blocks, np.ones((BLOCK_PX, BLOCK_PX))) * around
        spoilt = np.rint(picture + errors[..., None]).clip(0, 255).astype(np.uint8)
        spoilt[ACTOR] = 40
        seen.append(spoilt)
    return seen


def measured(pictures: list[Bytes], plate: Plate) -> CodecErrors:
    """What pictures tell."""
    errors, compared = CodecErrors(plate), Comparison(plate)
    for picture in pictures:
        compared.look(picture)
        errors.add(compared)
    return errors


@pytest.mark.parametrize("levels", [1.2, 1.6, 1.8])
def test_errors_of_patches_beyond_usual_ones_count_three_times_as_much(levels: float) -> None:
    """A little less, because the light field takes part of them for light."""
    found = measured(with_errors(wall(12), levels, 24), Plate.learn(wall(12))).levels
    assert 0.6 < found / (3 * np.sqrt(levels**2 - 0.8**2)) < 1.1


def test_usual_errors_count_for_nothing() -> None:
    assert measured(with_errors(wall(12), 0.6, 24), Plate.learn(wall(12))).levels == 0.0


def test_large_errors_are_bounded() -> None:
    assert measured(with_errors(wall(12), 6.0, 24), Plate.learn(wall(12))).levels == 5.0


def test_noise_that_is_everywhere_alike_is_no_error() -> None:
    assert measured(with_errors(wall(12), 0.0, 24), Plate.learn(wall(12))).levels == 0.0


def test_nothing_is_told_of_an_empty_stage_or_a_few_pixels() -> None:
    plate = Plate.learn(wall(12))
    assert measured(wall(12), plate).levels == 0.0
    assert CodecErrors(plate).levels == 0.0


def test_without_errors_the_plate_stays_as_it_is() -> None:
    plate = Plate.learn(wall(12))
    same = CodecErrors(plate).plate
    for name in ("whitening", "noise2", "turn_noise", "slack", "log_slack", "log_span", "log_peak"):
        np.testing.assert_array_equal(getattr(same, name), getattr(plate, name), name)


@settings(max_examples=20)
@given(st.floats(0.0, 6.0))
def test_further_noise_adds_to_the_variance(levels: float) -> None:
    """Of a single picture, whose noise is assumed to be alike in all channels, all follows from its size."""
    plate = Plate.learn(wall(1))
    noisier = plate.with_noise(levels)
    known = np.sqrt(plate.noise2 + levels**2)
    np.testing.assert_allclose(noisier.noise2, known**2, rtol=1e-5)
    np.testing.assert_allclose(noisier.turn_noise, known, rtol=1e-5)
    for diagonal in (0, 2, 5):
        np.testing.assert_allclose(noisier.whitening[diagonal] / WHITENING_STEPS, 1 / known, rtol=1e-3)
    np.testing.assert_allclose(noisier.log_peak, -3 * np.log(known) - 1.5 * np.log(2 * np.pi), atol=1e-3)
    np.testing.assert_allclose(noisier.log_slack, 1.5 * np.log(noisier.slack), atol=1e-5)
    lost = plate.noise2 * (1 - plate.slack) / plate.slack  # what a shift by a fraction of a pixel changes
    np.testing.assert_allclose(noisier.slack, known**2 / (known**2 + lost), rtol=1e-4)
