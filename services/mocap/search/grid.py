"""Grid sampling of a neighbourhood, to find the right basin before a descent."""

from dataclasses import dataclass

import numpy as np

from services.mocap.energy.backend import Energy
from services.mocap.search.descent import Box, Solution
from services.mocap.types import Floats


def grid_points(centre: Floats, counts: tuple[int, ...], steps: Floats, box: Box) -> Floats:
    """All combinations (N, d) of counts[k] values spaced by steps[k] about centre (d,), within the box.

    The centre is the first point, whatever the counts.
    """
    axes = [
        np.unique(np.clip(c + step * (np.arange(n) - (n - 1) / 2), low, high))
        for c, n, step, low, high in zip(centre, counts, steps, box.lower, box.upper, strict=True)
    ]
    points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    return np.concatenate([np.clip(centre, box.lower, box.upper)[None], points])


def best_of(energy: Energy, points: Floats, dofs: tuple[int, ...]) -> Solution:
    """The point (of N, d) of least energy as values of these parameters; the first of equals."""
    energies = energy(points)
    best = int(np.argmin(energies))
    return Solution(dofs, points[best], float(energies[best]), len(points))


@dataclass(frozen=True, eq=False)
class Tried:
    """Points (N, d) and their energies (N,)."""

    points: Floats
    energies: Floats

    def best_apart(self, n: int, steps: Floats) -> list[Floats]:
        """At most n points of least energy, each farther than steps (d,) from those before in a parameter."""
        chosen: list[Floats] = []
        for k in np.argsort(self.energies, kind="stable"):
            if len(chosen) == n:
                break
            if all(np.any(np.abs(self.points[k] - other) > steps) for other in chosen):
                chosen.append(self.points[k])
        return chosen
