"""Powell's descent: down correlated bowls, within the box, never worse than the start, every call counted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.search.descent import Box, Solution, descend
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Floats


class Bowl:
    """A quadratic with its axes anywhere; remembers what it was asked."""

    def __init__(self, seed: int, d: int, floor: float = 1.0) -> None:
        rng = np.random.default_rng(seed)
        axes, _ = np.linalg.qr(rng.normal(size=(d, d)))
        self.H = axes @ np.diag(rng.uniform(1.0, 20.0, d)) @ axes.T
        self.centre = rng.uniform(-1.0, 1.0, d)
        self.start = rng.uniform(-1.0, 1.0, d)
        self.floor = floor
        self.asked: list[Floats] = []

    def __call__(self, values: Floats) -> Floats:
        self.asked.extend(values)
        off = values - self.centre
        energies: Floats = np.einsum("ni,ij,nj->n", off, self.H, off) + self.floor
        return energies

    def minimum_at_start(self) -> Solution:
        return Solution(tuple(range(len(self.start))), self.start, float(self(self.start[None])[0]), 1)


def box(d: int, half: float = 5.0) -> Box:
    return Box(np.full(d, -half), np.full(d, half))


def within(line_tolerance: float, tolerance: float, rounds: int) -> SearchSettings:
    return SearchSettings(line_tolerance=line_tolerance, descent_tolerance=tolerance, descent_rounds=rounds)


def axes(d: int, step: float = 0.2) -> Floats:
    return step * np.eye(d)


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
@settings(max_examples=60, deadline=None)
def test_finds_the_bottom_of_a_correlated_bowl(seed: int, d: int) -> None:
    bowl = Bowl(seed, d)
    found = descend(bowl, bowl.minimum_at_start(), box(d), axes(d), within(0.01, 1e-6, 100))
    np.testing.assert_allclose(found.values, bowl.centre, atol=0.02)
    assert found.energy_px == pytest.approx(1.0, abs=1e-3)
    assert found.evaluations == len(bowl.asked)


@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 6),
    st.floats(0.05, 1.0),
    st.floats(0.01, 3.0),
    st.integers(1, 4),
)
@settings(max_examples=60, deadline=None)
def test_stays_in_the_box_and_never_gets_worse(
    seed: int, d: int, half: float, step: float, rounds: int
) -> None:
    bowl = Bowl(seed, d)
    bowl.start *= half
    limits = box(d, half)
    start = bowl.minimum_at_start()
    found = descend(bowl, start, limits, axes(d, step), within(0.05, 0.004, rounds))
    asked = np.array(bowl.asked)
    assert np.all((asked >= limits.lower) & (asked <= limits.upper))
    assert np.all((found.values >= limits.lower) & (found.values <= limits.upper))
    assert found.energy_px == bowl(found.values[None])[0] <= start.energy_px
    assert found.evaluations == len(asked)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_rounded_energies_never_get_worse(seed: int) -> None:
    """Counted pixels are whole numbers: flat between steps."""
    bowl = Bowl(seed, 4)
    start = Solution((0, 1, 2, 3), bowl.start, float(np.floor(bowl(bowl.start[None]))[0]), 1)
    found = descend(lambda values: np.floor(bowl(values)), start, box(4), axes(4), within(0.05, 0.004, 4))
    assert found.energy_px == np.floor(bowl(found.values[None]))[0] <= start.energy_px


def test_a_bottom_outside_the_box_is_met_at_its_wall() -> None:
    bowl = Bowl(1, 2)
    bowl.H, bowl.centre, bowl.start = np.diag([1.0, 3.0]), np.array([9.0, 0.3]), np.zeros(2)
    found = descend(bowl, bowl.minimum_at_start(), box(2, half=1.0), axes(2), within(0.01, 1e-6, 20))
    np.testing.assert_allclose(found.values, [1.0, 0.3], atol=0.01)


def test_a_side_without_limits_is_searched() -> None:
    bowl = Bowl(2, 2)
    bowl.centre = np.array([40.0, -30.0])
    endless = Box(np.full(2, -np.inf), np.full(2, np.inf))
    found = descend(bowl, bowl.minimum_at_start(), endless, axes(2), within(0.01, 1e-8, 100))
    np.testing.assert_allclose(found.values, bowl.centre, atol=0.05)


def test_a_box_without_room_returns_the_start() -> None:
    bowl = Bowl(3, 3)
    start = bowl.minimum_at_start()
    found = descend(bowl, start, Box(bowl.start, bowl.start), axes(3), within(0.05, 0.004, 4))
    np.testing.assert_array_equal(found.values, bowl.start)
    assert (found.energy_px, found.evaluations) == (start.energy_px, 1)


def test_nothing_to_gain_ends_after_one_round() -> None:
    bowl = Bowl(4, 3, floor=0.0)
    bowl.start = bowl.centre
    found = descend(bowl, bowl.minimum_at_start(), box(3), axes(3), within(0.05, 0.004, 100))
    assert found.energy_px == 0.0
    assert found.evaluations == len(bowl.asked) < 1 + 3 * 16


def test_start_and_directions_are_not_written_to() -> None:
    bowl, directions = Bowl(5, 3), axes(3)
    start = bowl.minimum_at_start()
    before = start.values.copy()
    descend(bowl, start, box(3), directions, within(0.01, 1e-6, 10))
    np.testing.assert_array_equal(start.values, before)
    np.testing.assert_array_equal(directions, axes(3))


def test_what_no_direction_moves_stays() -> None:
    bowl = Bowl(6, 3)
    found = descend(bowl, bowl.minimum_at_start(), box(3), axes(3)[:2], within(0.01, 1e-6, 20))
    assert found.values[2] == bowl.start[2]
    assert found.energy_px < bowl(bowl.start[None])[0]


def test_a_direction_along_a_narrow_valley_is_worth_more_than_axes() -> None:
    valley = np.array([1.0, 1.0]) / np.sqrt(2)

    def energy(values: Floats) -> Floats:
        along = values @ valley
        across = np.abs(values @ np.array([1.0, -1.0]))
        energies: Floats = (along - 3.0) ** 2 + 1e6 * across**2
        return energies

    start = Solution((0, 1), np.zeros(2), float(energy(np.zeros((1, 2)))[0]), 1)
    by_axes = descend(energy, start, box(2), axes(2), within(0.05, 0.004, 2))
    more = np.vstack([axes(2), 0.2 * valley])
    by_valley = descend(energy, start, box(2), more, within(0.05, 0.004, 2))
    assert by_axes.energy_px > 8.0
    assert by_valley.energy_px < 0.1


def test_a_parameter_at_its_limit_lets_the_others_go_on() -> None:
    def energy(values: Floats) -> Floats:
        return np.abs(values[:, 1] - 4.0)

    narrow = Box(np.array([-0.5, -5.0]), np.array([0.5, 5.0]))
    start = Solution((0, 1), np.zeros(2), 4.0, 1)
    found = descend(energy, start, narrow, np.array([[0.2, 0.2]]), within(0.01, 1e-6, 10))
    np.testing.assert_allclose(found.values, [0.5, 4.0], atol=0.02)
