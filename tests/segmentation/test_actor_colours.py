"""The histogram of the actor's colours."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.types import Bytes
from services.segmentation.learnt import BIN_SHIFT, BINS, ActorColours
from services.segmentation.pixels import Levels

BIN_VOLUME = float((256 // BINS) ** 3)


def colours_of(
    *about: tuple[int, int, int], n: int = 2000, spread: float = 6.0, seed: int = 0
) -> ActorColours:
    rng = np.random.default_rng(seed)
    found = ActorColours()
    for colour in about:
        pixels = np.clip(np.rint(rng.normal(colour, spread, (n, 3))), 0, 255)
        found.add(pixels.astype(np.uint8))
    return found


def at(log_density: Levels, colour: tuple[int, int, int]) -> float:
    blue, green, red = (level >> BIN_SHIFT for level in colour)
    return float(log_density[blue, green, red])


colour = st.tuples(*[st.integers(40, 215)] * 3)


@settings(max_examples=20)
@given(st.lists(colour, min_size=1, max_size=4), colour, st.integers(0, 100))
def test_densities_sum_to_one(
    own: list[tuple[int, int, int]], other: tuple[int, int, int], seed: int
) -> None:
    camera = colours_of(*own, seed=seed)
    pooled = ActorColours(camera.counts + colours_of(other, seed=seed).counts)
    for of_all in (camera, pooled):
        total = float(np.exp(camera.log_density(of_all).astype(np.float64)).sum() * BIN_VOLUME)
        assert total == pytest.approx(1, abs=0.08)  # colours that were never seen reach a little too far


def test_before_anything_was_seen_all_colours_are_alike() -> None:
    nothing = ActorColours()
    density = nothing.log_density(nothing)
    assert np.unique(density).size == 1
    assert nothing.n_pixels == 0
    few = colours_of((50, 60, 70), n=20)
    assert np.array_equal(few.log_density(few), density)


def test_what_was_seen_is_likelier_than_what_was_not() -> None:
    seen = colours_of((150, 60, 40))
    density = seen.log_density(seen)
    assert seen.n_pixels == 2000
    assert at(density, (150, 60, 40)) > at(density, (40, 150, 60)) + 5


def test_a_colour_that_another_camera_saw_is_likely_too() -> None:
    one, other = colours_of((150, 60, 40)), colours_of((40, 150, 60))
    of_all = ActorColours(one.counts + other.counts)
    alone, together = one.log_density(one), one.log_density(of_all)
    assert at(together, (40, 150, 60)) > at(alone, (40, 150, 60)) + 4
    assert at(together, (150, 60, 40)) > at(together, (40, 150, 60))  # its own counts more
    assert at(together, (200, 200, 20)) == pytest.approx(at(alone, (200, 200, 20)))


@given(st.integers(0, 100), st.integers(1, 400))
def test_pixels_may_come_in_parts(seed: int, cut: int) -> None:
    pixels: Bytes = np.random.default_rng(seed).integers(0, 256, (400, 3), dtype=np.uint8)
    whole, parts = ActorColours(), ActorColours()
    whole.add(pixels)
    parts.add(pixels[:cut])
    parts.add(pixels[cut:])
    np.testing.assert_array_equal(whole.counts, parts.counts)
    assert whole.n_pixels == 400
    blue, green, red = (pixels[0] >> BIN_SHIFT).tolist()
    assert whole.counts[blue, green, red] > 0
