"""Powell's direction-set descent within limits, and the result of every search."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from services.mocap.energy.backend import Energy
from services.mocap.search.line import minimise_line
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Floats


@dataclass(frozen=True, eq=False)
class Solution:
    """A chain's parameter values and what they cost."""

    dofs: tuple[int, ...]
    values: Floats
    """(d,)"""
    energy_px: float
    evaluations: int
    seconds: float = 0.0
    """The time to find them, if it was measured."""

    def applied_to(self, pose: Floats) -> Floats:
        """The pose (D,) with this chain's parameters replaced."""
        changed = pose.copy()
        changed[list(self.dofs)] = self.values
        return changed


@dataclass(frozen=True, eq=False)
class Box:
    """The limits (d,) of the parameters."""

    lower: Floats
    upper: Floats


def best_of(energy: Energy, points: Floats, dofs: tuple[int, ...]) -> Solution:
    """The point (of N, d) of least energy as values of these parameters; the first of equals."""
    energies = energy(points)
    best = int(np.argmin(energies))
    return Solution(dofs, points[best], float(energies[best]), len(points))


def descend(
    energy: Energy, start: Solution, box: Box, directions: Floats, settings: SearchSettings
) -> Solution:
    """Lower the energy from start by line searches along a changing set of directions (k, d).

    A direction's length is the first step of a search along it.

    Press et al., Numerical Recipes, section 10.5 (the paper, section 3): after a round over all directions
    the direction that gained most is replaced by the round's total displacement, if that is better. Ends when
    a round gains less than the share descent_tolerance of the energy. The result is never worse than start,
    within the box.
    """
    evaluations = start.evaluations

    def count(values: Floats) -> float:
        nonlocal evaluations
        evaluations += 1
        return float(energy(np.clip(values, box.lower, box.upper)[None])[0])

    values, best = start.values, start.energy_px
    directions, tolerance = directions.copy(), settings.line_tolerance
    for _ in range(settings.descent_rounds):
        round_start, round_energy = values, best
        gains = np.zeros(len(directions))
        for k, direction in enumerate(directions):
            before = best
            values, best = _line_search(count, values, best, direction, box, tolerance)
            gains[k] = before - best
        if round_energy - best <= settings.descent_tolerance * round_energy:
            break
        move, gain = values - round_start, gains.max()
        beyond = count(values + move)  # Powell's test whether the displacement should become a direction
        curvature = 2.0 * (round_energy - 2.0 * best + beyond) * (round_energy - best - gain) ** 2
        if beyond < round_energy and curvature < gain * (round_energy - beyond) ** 2:
            values, best = _line_search(count, values, best, move, box, tolerance)
            directions[gains.argmax()] = directions[-1]
            directions[-1] = move
    return Solution(start.dofs, values, best, evaluations)


def _line_search(
    energy: Callable[[Floats], float],
    values: Floats,
    energy_px: float,
    direction: Floats,
    box: Box,
    tolerance: float,
) -> tuple[Floats, float]:
    low, high = _reach(values, direction, box)
    if low == high:
        return values, energy_px
    found = minimise_line(lambda t: energy(values + t * direction), energy_px, low, high, tolerance)
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
