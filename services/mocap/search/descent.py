"""Powell's direction-set descent within limits."""

from dataclasses import dataclass

import numpy as np

from services.mocap.energy.backend import Energy
from services.mocap.search.line import minimise_line
from services.mocap.types import Floats


@dataclass(frozen=True, eq=False)
class Minimum:
    """The result of a search."""

    values: Floats
    """(d,) parameter values."""
    energy_px: float
    evaluations: int


@dataclass(frozen=True, eq=False)
class Box:
    """The limits (d,) of the parameters."""

    lower: Floats
    upper: Floats


class _Counter:
    """The energy along lines, counting evaluations."""

    def __init__(self, energy: Energy, box: Box) -> None:
        self._energy, self._box = energy, box
        self.evaluations = 0

    def __call__(self, values: Floats) -> float:
        self.evaluations += 1
        inside = np.clip(values, self._box.lower, self._box.upper)
        return float(self._energy(inside[None])[0])


def descend(
    energy: Energy,
    start: Minimum,
    box: Box,
    directions: Floats,
    line_tolerance: float,
    tolerance: float,
    max_rounds: int,
) -> Minimum:
    """Lower the energy from start by line searches along a changing set of directions (k, d).

    A direction's length is the first step of a search along it.

    Press et al., Numerical Recipes, section 10.5 (the paper, section 3): after a round over all directions
    the direction that gained most is replaced by the round's total displacement, if that is better. Ends when
    a round gains less than the share tolerance of the energy. The result is never worse than start, within
    the box.
    """
    count = _Counter(energy, box)
    values, best = start.values, start.energy_px
    directions = directions.copy()
    for _ in range(max_rounds):
        round_start, round_energy = values, best
        gains = np.zeros(len(directions))
        for k, direction in enumerate(directions):
            before = best
            values, best = _line_search(count, values, best, direction, box, line_tolerance)
            gains[k] = before - best
        if round_energy - best <= tolerance * round_energy:
            break
        move = values - round_start
        if _worth_keeping(count, values, move, round_energy, best, gains.max()):
            values, best = _line_search(count, values, best, move, box, line_tolerance)
            directions[gains.argmax()] = directions[-1]
            directions[-1] = move
    return Minimum(values, best, start.evaluations + count.evaluations)


def _line_search(
    count: _Counter, values: Floats, energy_px: float, direction: Floats, box: Box, tolerance: float
) -> tuple[Floats, float]:
    low, high = _reach(values, direction, box)
    if low == high:
        return values, energy_px
    found = minimise_line(lambda t: count(values + t * direction), energy_px, low, high, tolerance)
    return np.clip(values + found.t * direction, box.lower, box.upper), found.energy


def _reach(values: Floats, direction: Floats, box: Box) -> tuple[float, float]:
    """The range along direction, backwards (<= 0) and forwards (>= 0), until all moving parameters are at
    their limits; a parameter that reaches its limit earlier stays there.
    """
    moving = direction != 0
    if not moving.any():
        return 0.0, 0.0
    ends = np.stack([box.lower - values, box.upper - values])[:, moving] / direction[moving]
    return min(float(ends.min()), 0.0), max(float(ends.max()), 0.0)


def _worth_keeping(
    count: _Counter, values: Floats, move: Floats, round_energy: float, best: float, largest_gain: float
) -> bool:
    """Powell's test whether the round's total displacement should become a direction."""
    extrapolated = count(values + move)
    if extrapolated >= round_energy:
        return False
    curvature = 2.0 * (round_energy - 2.0 * best + extrapolated) * (round_energy - best - largest_gain) ** 2
    return curvature < largest_gain * (round_energy - extrapolated) ** 2
