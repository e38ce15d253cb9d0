"""Grids: the centre first, all within the box, shards that make up the whole."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from services.mocap.search.descent import Box, best_of
from services.mocap.search.limb import grid_points
from services.mocap.types import Floats

AXIS = st.tuples(
    st.floats(-2.0, 2.0), st.integers(1, 6), st.floats(0.01, 1.0), st.floats(-2.0, 0.0), st.floats(0.1, 2.0)
)


def grid_of(
    axes: list[tuple[float, int, float, float, float]],
) -> tuple[Floats, Box, Floats, tuple[int, ...]]:
    """The points, the box, the centre and the counts of axes (centre, count, step, lower, upper)."""
    centre, counts, steps, lower, upper = (np.array(column) for column in zip(*axes, strict=True))
    box = Box(lower, upper)
    return grid_points(centre, tuple(counts), steps, box), box, centre, tuple(counts)


@given(st.lists(AXIS, min_size=1, max_size=4))
def test_centre_first_and_all_within_the_box(axes: list[tuple[float, int, float, float, float]]) -> None:
    points, box, centre, counts = grid_of(axes)
    np.testing.assert_array_equal(points[0], np.clip(centre, box.lower, box.upper))
    assert np.all((points >= box.lower) & (points <= box.upper))
    assert 2 <= len(points) <= 1 + np.prod(counts)
    assert len(np.unique(points[1:], axis=0)) == len(points) - 1  # what the box pushes together counts once


@given(st.lists(AXIS, min_size=1, max_size=4), st.integers(1, 9))
def test_shards_make_up_the_whole(axes: list[tuple[float, int, float, float, float]], n: int) -> None:
    points = grid_of(axes)[0]
    shards = np.concatenate([points[k::n] for k in range(n)])
    assert sorted(map(tuple, shards)) == sorted(map(tuple, points))


def test_points_are_evenly_spaced_about_the_centre() -> None:
    box = Box(np.full(2, -9.0), np.full(2, 9.0))
    points = grid_points(np.array([1.0, -2.0]), (3, 2), np.array([0.5, 0.2]), box)
    expected = [(1.0, -2.0)] + [(x, y) for x in (0.5, 1.0, 1.5) for y in (-2.1, -1.9)]
    np.testing.assert_allclose(points, expected)


def test_best_of_takes_the_first_of_equals() -> None:
    points = np.array([[3.0], [1.0], [-1.0], [2.0]])
    best = best_of(lambda values: np.abs(values[:, 0]), points, (0,))
    assert (best.values[0], best.energy_px, best.evaluations) == (1.0, 1.0, 4)
