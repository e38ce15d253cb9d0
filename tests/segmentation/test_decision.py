"""Labels of a grid by messages: exact on rows and columns, close to the least energy on small grids."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from services.mocap.types import Bytes
from services.segmentation.decision import beliefs, prices
from services.segmentation.pixels import MEAN_STEPS, Levels

ROUNDS = 3
seeds = st.integers(0, 2**32 - 1)


def problem(seed: int, height: int, width: int, price: float = 3.0) -> tuple[Levels, Levels, Levels]:
    """Evidence and prices (h, w) by lot."""
    rng = np.random.default_rng(seed)
    evidence = rng.uniform(-4, 4, (height, width)).astype(np.float32)
    across, down = rng.uniform(0, price, (2, height, width)).astype(np.float32)
    return evidence, across, down


def energy(labels: NDArray[np.bool_], evidence: Levels, across: Levels, down: Levels) -> NDArray[np.float64]:
    """(…,) of labelings (…, h, w): evidence against what each pixel is called, and prices of unlike ones."""
    own = np.where(labels, -evidence, 0.0).sum(axis=(-2, -1))
    beside = (across[:, :-1] * (labels[..., :, 1:] != labels[..., :, :-1])).sum(axis=(-2, -1))
    below = (down[:-1] * (labels[..., 1:, :] != labels[..., :-1, :])).sum(axis=(-2, -1))
    total: NDArray[np.float64] = own + beside + below
    return total


def all_labelings(height: int, width: int) -> NDArray[np.bool_]:
    numbers = np.arange(2 ** (height * width), dtype=np.int64)
    bits = (numbers[:, None] >> np.arange(height * width)) & 1
    return np.asarray(bits.astype(bool).reshape(-1, height, width))


@given(seeds)
def test_without_prices_everybody_believes_the_own_evidence(seed: int) -> None:
    evidence, across, _ = problem(seed, 6, 7)
    free = np.zeros_like(across)
    np.testing.assert_array_equal(beliefs(evidence, free, free, ROUNDS), evidence)


@given(seeds, st.integers(1, 12), st.booleans())
def test_a_single_row_or_column_is_exact(seed: int, length: int, upright: bool) -> None:
    shape = (length, 1) if upright else (1, length)
    evidence, across, down = problem(seed, *shape)
    found = beliefs(evidence, across, down, 1)
    labelings = all_labelings(*shape)
    energies = energy(labelings, evidence, across, down)
    for place in np.ndindex(*shape):  # the belief is the difference of the least energies with either label
        on = labelings[(slice(None), *place)]
        assert found[place] == pytest.approx(energies[~on].min() - energies[on].min(), abs=1e-4)


def test_on_small_grids_the_energy_is_close_to_the_least() -> None:
    labelings, over = all_labelings(4, 4), list[float]()
    for seed in range(60):
        evidence, across, down = problem(seed, 4, 4)
        energies = energy(labelings, evidence, across, down)
        found = energy(beliefs(evidence, across, down, ROUNDS) > 0, evidence, across, down)
        over.append(float((found - energies.min()) / (np.median(energies) - energies.min())))
    assert min(over) > -1e-5
    assert np.mean(np.array(over) < 1e-5) > 0.85  # evidence and prices by lot are harder than pictures
    assert np.mean(over) < 0.03


@given(seeds)
def test_the_two_labels_are_alike(seed: int) -> None:
    evidence, across, down = problem(seed, 5, 6)
    one, other = beliefs(evidence, across, down, ROUNDS), beliefs(-evidence, across, down, ROUNDS)
    np.testing.assert_allclose(one, -other, atol=1e-5)


@given(seeds, st.integers(0, 2))
def test_more_evidence_somewhere_never_makes_anybody_believe_less(seed: int, row: int) -> None:
    evidence, across, down = problem(seed, 3, 5)
    more = evidence.copy()
    more[row, 2] += 2
    assert (beliefs(more, across, down, ROUNDS) >= beliefs(evidence, across, down, ROUNDS) - 1e-5).all()


def test_a_hole_in_much_evidence_is_filled_and_a_lone_pixel_goes() -> None:
    evidence = np.full((7, 7), 3.0, np.float32)
    evidence[3, 3] = -2.0
    price = np.full_like(evidence, 1.5)
    assert (beliefs(evidence, price, price, ROUNDS) > 0).all()
    assert (beliefs(-evidence, price, price, ROUNDS) < 0).all()


def prices_of(picture: Bytes, plate: Bytes, noise2: float = 4.0) -> tuple[Levels, Levels]:
    channels = np.ascontiguousarray(picture.transpose(2, 0, 1))
    expected = (plate.transpose(2, 0, 1).astype(np.int16) * np.int16(MEAN_STEPS)).copy()
    across, down = np.zeros((2, *picture.shape[:2]), np.float32)
    prices(channels, expected, noise2, (0, 0), across, down)
    return across, down


def test_only_what_is_no_outline_of_the_stage_makes_neighbours_cheap() -> None:
    plate = np.full((8, 10, 3), 100, np.uint8)
    plate[:, 5:] = 160
    across, down = prices_of(plate, plate)
    assert np.unique(across).size == np.unique(down).size == 1  # the stage's own outline costs as much
    picture = plate.copy()
    picture[:, 3:] = 40
    across_edge, down_edge = prices_of(picture, picture * 0 + 100)
    assert across_edge[:, 2] == pytest.approx(0.15 * 3.0, rel=0.1)
    assert across_edge[:, 4] == pytest.approx(3.0)
    assert down_edge == pytest.approx(3.0)


@settings(max_examples=20)
@given(seeds)
def test_prices_are_those_of_the_transposed_picture(seed: int) -> None:
    rng = np.random.default_rng(seed)
    picture, plate = rng.integers(0, 256, (2, 6, 6, 3), dtype=np.uint8)
    across, down = prices_of(picture, plate)
    turned_across, turned_down = prices_of(
        np.ascontiguousarray(picture.transpose(1, 0, 2)), np.ascontiguousarray(plate.transpose(1, 0, 2))
    )
    np.testing.assert_allclose(across[:, :-1], turned_down.T[:, :-1], rtol=1e-5)
    np.testing.assert_allclose(down[:-1], turned_across.T[:-1], rtol=1e-5)


@pytest.mark.parametrize("height", [1, 2])
def test_all_labelings_are_there(height: int) -> None:
    labelings = all_labelings(height, 3)
    assert {tuple(one.ravel()) for one in labelings} == set(product([False, True], repeat=3 * height))
