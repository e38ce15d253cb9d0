"""Minimising along a line: near the minimum, within the limits, never worse than the start."""

from collections.abc import Callable
from math import exp, floor, inf

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from services.mocap.search.line import minimise_line

ANY = st.floats(-50.0, 50.0)
LOW = st.one_of(st.floats(-30.0, 0.0), st.just(-inf))
HIGH = st.one_of(st.floats(0.0, 30.0), st.just(inf))


class Watched:
    """A function that remembers where it was asked."""

    def __init__(self, function: Callable[[float], float]) -> None:
        self._function = function
        self.asked: list[float] = []

    def __call__(self, t: float) -> float:
        self.asked.append(t)
        return self._function(t)


@given(centre=ANY, curvature=st.floats(1e-3, 1e3), low=LOW, high=HIGH)
@example(centre=0.0, curvature=1.0, low=-inf, high=inf)
@example(centre=5.0, curvature=1.0, low=0.0, high=0.0)
@example(centre=5.0, curvature=1.0, low=-1.0, high=0.0)
def test_finds_the_minimum_of_a_parabola(centre: float, curvature: float, low: float, high: float) -> None:
    parabola = Watched(lambda t: curvature * (t - centre) ** 2)
    found = minimise_line(parabola, curvature * centre**2, low, high, tolerance=0.05)
    assert found.t == pytest.approx(min(max(centre, low), high), abs=0.06)
    assert found.energy == curvature * (found.t - centre) ** 2
    assert all(low <= t <= high for t in parabola.asked)


def bumpy(seed: int, plateau: float) -> Callable[[float], float]:
    """A step function with valleys and flat places, as counted pixels are."""
    slope, ripple, phase = 1 + seed % 7, 1 + seed % 5, seed % 11
    return lambda t: floor(abs(t - phase) * slope / plateau) + ripple * floor((t * ripple) % 3)


@given(
    seed=st.integers(0, 10_000), plateau=st.floats(0.05, 5.0), low=LOW, high=HIGH, steps=st.integers(0, 20)
)
def test_never_worse_never_outside_and_never_long(
    seed: int, plateau: float, low: float, high: float, steps: int
) -> None:
    function = Watched(bumpy(seed, plateau))
    found = minimise_line(function, bumpy(seed, plateau)(0.0), low, high, 0.05, max_steps=steps)
    assert found.energy == bumpy(seed, plateau)(found.t) <= bumpy(seed, plateau)(0.0)
    assert found.energy <= min(map(bumpy(seed, plateau), function.asked), default=inf)
    assert low <= found.t <= high
    assert all(low <= t <= high for t in function.asked)


@pytest.mark.parametrize(("low", "high"), [(-3.0, 3.0), (0.0, 3.0), (-3.0, 0.0), (-inf, inf), (0.0, 0.0)])
def test_a_plateau_keeps_its_energy_and_ends(low: float, high: float) -> None:
    flat = Watched(lambda _: 7.0)
    found = minimise_line(flat, 7.0, low, high, 0.05)
    assert found.energy == 7.0
    assert len(flat.asked) <= 2 + 12


def test_no_room_asks_nothing() -> None:
    function = Watched(lambda t: t)
    assert minimise_line(function, 0.0, 0.0, 0.0, 0.05).t == 0.0
    assert function.asked == []


@pytest.mark.parametrize("slope", [1.0, -1.0])
def test_a_slope_ends_at_its_limit(slope: float) -> None:
    found = minimise_line(lambda t: slope * t, 0.0, -7.3, 7.3, 0.05)
    assert found.t == pytest.approx(-slope * 7.3, abs=0.1)


def test_an_endless_descent_ends() -> None:
    assert minimise_line(lambda t: exp(-t), 1.0, -inf, inf, 0.05).energy < 1e-3
    assert minimise_line(lambda t: -t, 0.0, 0.0, inf, 0.05).energy < -1e3


def test_the_nearer_valley_is_taken() -> None:
    # Valleys at 1.5 and at -20, the further one deeper: a line search is to stay where it starts.
    found = minimise_line(lambda t: min((t - 1.5) ** 2, (t + 20) ** 2 - 5), 2.25, -30, 30, 0.05)
    assert found.t == pytest.approx(1.5, abs=0.06)


def test_parabolas_cost_few_evaluations() -> None:
    parabola = Watched(lambda t: (t - 0.7) ** 2)
    minimise_line(parabola, 0.49, -10.0, 10.0, 0.01)
    assert len(parabola.asked) <= 10
