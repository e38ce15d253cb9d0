"""Colours are looked at only where they may matter, and the same points are found."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.mocap.search.limb import best_apart
from services.mocap.search.stages import ColouredEnergy
from services.mocap.types import Floats

STEPS = np.array([0.24, 0.24, 0.48, 0.24])


def grid(seed: int) -> tuple[Floats, Floats, Floats]:
    """Points (N, 4), and what they cost by silhouettes and by colours (N,)."""
    rng = np.random.default_rng(seed)
    axes = [np.arange(n) * 0.16 for n in (5, 5, 3, 5)]
    points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    quick = np.round(1000 * np.linalg.norm(points - rng.uniform(0, 0.64, 4), axis=1))
    return points, quick, rng.integers(0, 400, len(points)).astype(float)


def chosen_of_all(points: Floats, energies: Floats) -> list[Floats]:
    chosen: list[Floats] = []
    for k in np.argsort(energies, kind="stable"):
        if len(chosen) < 4 and all(np.any(np.abs(points[k] - other) > STEPS) for other in chosen):
            chosen.append(points[k])
    return chosen


@given(seed=st.integers(0, 10_000), has_colours=st.booleans())
def test_the_points_are_those_of_a_search_that_looks_at_all_colours(seed: int, has_colours: bool) -> None:
    points, quick_px, colours_px = grid(seed)

    def rows(values: Floats) -> list[int]:
        return [int(np.flatnonzero((points == value).all(axis=1))[0]) for value in values]

    energy = ColouredEnergy(
        lambda values: quick_px[rows(values)],
        (lambda values: colours_px[rows(values)]) if has_colours else None,
    )
    whole_px = quick_px + colours_px if has_colours else quick_px
    np.testing.assert_array_equal(energy(points), whole_px)
    np.testing.assert_array_equal(best_apart(energy, points, STEPS), chosen_of_all(points, whole_px))


@pytest.mark.parametrize(("dearest_px", "most_looked_at"), [(0.0, 128), (1e6, 375)])
def test_colours_are_looked_at_where_they_may_matter(dearest_px: float, most_looked_at: int) -> None:
    points, quick_px, colours_px = grid(1)
    looked_at = list[int]()

    def colours(values: Floats) -> Floats:
        looked_at.append(len(values))
        return np.minimum(colours_px[: len(values)], dearest_px)

    best_apart(ColouredEnergy(lambda _: quick_px, colours), points, STEPS)
    assert 32 <= sum(looked_at) <= most_looked_at
