"""Contours are found where they are, between pixels, and only those that face the same way."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.energy.bitplanes import pack
from services.mocap.search.alignment.contour import distance_to_contour
from services.mocap.types import Bytes

SIZE = 80
X, Y = np.meshgrid(np.arange(SIZE), np.arange(SIZE))


def _half_plane(nx: float, ny: float, offset_px: float, camera: int) -> Bytes:
    """All that lies before the line n . x = offset is set, in one camera; the others hold its opposite."""
    before = X * nx + Y * ny < offset_px
    return pack(np.array([before if c == camera else ~before for c in range(10)]))


@settings(max_examples=100, deadline=None)
@given(st.floats(0, 6.28), st.floats(-7, 7), st.sampled_from([0, 5, 9]))
def test_a_straight_contour_is_found_between_pixels(angle: float, away_px: float, camera: int) -> None:
    nx, ny = np.cos(angle), np.sin(angle)
    middle = SIZE / 2
    planes = _half_plane(nx, ny, middle * (nx + ny) + away_px, camera)
    found = distance_to_contour(planes, camera, middle, middle, nx, ny, 10)
    assert found == pytest.approx(away_px, abs=0.6)


def test_on_average_a_contour_is_where_it_is() -> None:
    rng, off = np.random.default_rng(0), []
    for _ in range(1000):
        angle, away_px = rng.uniform(0, 2 * np.pi), rng.uniform(-5, 5)
        nx, ny = np.cos(angle), np.sin(angle)
        planes = _half_plane(nx, ny, 40.0 * (nx + ny) + away_px, 0)
        off.append(distance_to_contour(planes, 0, 40.0, 40.0, nx, ny, 10) - away_px)
    assert abs(np.mean(off)) < 0.02
    assert np.std(off) < 0.25


def test_contours_that_face_the_other_way_are_passed_over() -> None:
    bars = pack(((X > 20) & (X < 30) | (X > 40) & (X < 50))[None])
    # From the gap outwards comes the left edge of a bar first, which faces the other way, then its right one.
    assert distance_to_contour(bars, 0, 37.0, 40.0, 1.0, 0.0, 20) == pytest.approx(-7.5, abs=0.1)
    assert distance_to_contour(bars, 0, 37.0, 40.0, -1.0, 0.0, 20) == pytest.approx(-3.5, abs=0.1)
    assert distance_to_contour(bars, 0, 37.0, 40.0, 1.0, 0.0, 7) != distance_to_contour(
        bars, 0, 37.0, 40.0, 1.0, 0.0, 8
    )


def test_nothing_in_reach_is_not_a_number() -> None:
    blank, full = np.zeros((1, SIZE, SIZE), np.uint8), np.full((1, SIZE, SIZE), 255, np.uint8)
    for planes in (blank, full):  # the picture's edge is no contour
        assert np.isnan(distance_to_contour(planes, 0, 3.0, 3.0, -1.0, 0.0, 30))
