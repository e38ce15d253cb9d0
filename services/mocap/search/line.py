"""Minimisation along a line: bracketing, then Brent's method."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

_GOLDEN = 0.3819660112501051
"""1 - 1 / golden ratio: where a golden-section step divides an interval."""
_GROWTH = 2.0
"""Growth of the step while the energy keeps falling."""

Function = Callable[[float], float]


@dataclass(frozen=True)
class Point:
    """A point on the line and its energy."""

    t: float
    energy: float


def minimise_line(
    function: Function, at_zero: float, low: float, high: float, tolerance: float, max_steps: int = 12
) -> Point:
    """A local minimum of function on [low, high] near 0, never worse than the start.

    at_zero is function(0); low <= 0 <= high may be infinite; the first step is 1; the result lies within
    about tolerance of the minimum. Press et al., Numerical Recipes, sections 10.1 and 10.2.
    """
    start = Point(0.0, at_zero)
    left, middle, right = _bracket(function, start, low, high)
    if right - left <= tolerance:
        return middle
    return _brent(function, left, middle, right, tolerance, max_steps)


def _bracket(function: Function, start: Point, low: float, high: float) -> tuple[float, Point, float]:
    """An interval that contains a minimum, and the best known point in it."""
    ahead = _step(function, start, 1.0, low, high)
    if ahead.energy < start.energy:
        return _downhill(function, start, ahead, high)
    behind = _step(function, start, -1.0, low, high)
    if behind.energy < start.energy:
        right, best, left = _downhill(function, start, behind, low)
        return left, best, right
    return behind.t, start, ahead.t


def _step(function: Function, start: Point, step: float, low: float, high: float) -> Point:
    t = min(max(start.t + step, low), high)
    return start if t == start.t else Point(t, function(t))


def _downhill(function: Function, previous: Point, best: Point, limit: float) -> tuple[float, Point, float]:
    """Continue from previous over best while the function falls; returns (before, best, beyond) in that
    order."""
    while best.t != limit:
        reach = best.t + _GROWTH * (best.t - previous.t)
        t = min(reach, limit) if limit > 0 else max(reach, limit)
        beyond = Point(t, function(t))
        if beyond.energy >= best.energy:
            return previous.t, best, beyond.t
        previous, best = best, beyond
    return previous.t, best, limit


def _brent(
    function: Function, left: float, best: Point, right: float, tolerance: float, max_steps: int
) -> Point:
    """Brent's method: parabolas through the three best points where they fit, golden sections elsewhere."""
    second = third = best
    last_move = before_last = right - left
    for _ in range(max_steps):
        middle = (left + right) / 2
        if abs(best.t - middle) <= 2 * tolerance - (right - left) / 2:
            break
        move = _parabola_move(best, second, third)
        inside = left + tolerance < best.t + move < right - tolerance
        if not inside or abs(move) >= abs(before_last) / 2:
            move = _GOLDEN * ((right if best.t < middle else left) - best.t)
        if abs(move) < tolerance:
            move = tolerance if best.t < middle else -tolerance
        before_last, last_move = last_move, move
        tried = Point(best.t + move, function(best.t + move))
        if tried.energy <= best.energy:
            left, right = (best.t, right) if move > 0 else (left, best.t)
            best, second, third = tried, best, second
        else:
            left, right = (left, tried.t) if move > 0 else (tried.t, right)
            if tried.energy <= second.energy or second is best:
                second, third = tried, second
            elif tried.energy <= third.energy or third in (best, second):
                third = tried
    return best


def _parabola_move(best: Point, second: Point, third: Point) -> float:
    """From the best point to the vertex of the parabola through three points; infinite if there is none."""
    r = (best.t - second.t) * (best.energy - third.energy)
    q = (best.t - third.t) * (best.energy - second.energy)
    denominator = 2 * (q - r)
    if denominator == 0:
        return inf
    return -((best.t - third.t) * q - (best.t - second.t) * r) / denominator
