"""The turntable picture can be read like a ruler."""

import numpy as np
import pytest

from services.mocap.body.actor import Actor, build_body
from services.mocap.export.turntable import N_VIEWS, draw_turntable
from services.mocap.types import Bytes, Mask

_ROWS, _COLUMNS, _PX_PER_M = 2, 4, 300


def _tiles(picture: Bytes) -> list[Bytes]:
    return [tile for row in np.split(picture, _ROWS) for tile in np.split(row, _COLUMNS, axis=1)]


def _on_body(tile: Bytes) -> Mask:
    """Colours: lines, paper and ink are grey."""
    return np.ptp(tile.astype(int), axis=2) > 12


@pytest.fixture(scope="module")
def tiles() -> list[Bytes]:
    return _tiles(draw_turntable(build_body(Actor(height=1.80))))


def test_every_view_shows_the_body_in_its_height(tiles: list[Bytes]) -> None:
    assert len(tiles) == N_VIEWS
    for tile in tiles:
        rows = np.flatnonzero(_on_body(tile).any(axis=1))
        assert (rows[-1] - rows[0]) / _PX_PER_M == pytest.approx(1.80, abs=0.03)  # legs apart, head full


def test_opposite_views_are_mirror_images(tiles: list[Bytes]) -> None:
    for view in range(N_VIEWS // 2):
        front, back = _on_body(tiles[view]), _on_body(tiles[view + N_VIEWS // 2])[:, ::-1]
        assert np.count_nonzero(front & back) / np.count_nonzero(front | back) > 0.95


def test_the_actors_left_is_right_in_the_picture_from_the_front(tiles: list[Bytes]) -> None:
    front = tiles[0].astype(int)
    orange = front[..., 2] - front[..., 0] > 30  # the left side's colour
    assert orange[:, : front.shape[1] // 2].sum() == 0 < orange.sum()


def test_the_toes_point_left_when_seen_from_the_left(tiles: list[Bytes]) -> None:
    left = _on_body(tiles[2])
    soles = np.flatnonzero(left[np.flatnonzero(left.any(axis=1))[-6]])
    middle = left.shape[1] / 2
    assert middle - soles[0] > soles[-1] - middle
