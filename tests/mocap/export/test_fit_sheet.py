"""The picture of a fit shows every differing pixel of every camera."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.camera.camera import Camera
from services.mocap.energy.bitplanes import trimap_of
from services.mocap.export.fit_sheet import Seen, Shown, draw_fit
from services.mocap.types import ACTOR, Bytes, Mask

_MISSED, _BEYOND = np.array([0, 235, 255]), np.array([255, 0, 255])


def _close_to(sheet: Bytes, colour: Bytes) -> Mask:
    return np.abs(sheet.astype(int) - colour).max(axis=2) < 40


@pytest.fixture
def seen(small_cameras: Callable[[int], list[Camera]], ball_silhouette: Callable[..., Mask]) -> list[Seen]:
    return [
        Seen(camera, np.full((*camera.shape_px, 3), 90, np.uint8), trimap_of(ball_silhouette(camera, 0)))
        for camera in small_cameras(3)
    ]


def _shown(seen: list[Seen], dx_px: int = 0) -> Shown:
    masks = [np.roll(one.trimap // ACTOR, dx_px, axis=1) for one in seen]
    return Shown("a title", masks, np.full(len(seen), 0.5))


def test_a_perfect_fit_shows_no_difference(seen: list[Seen]) -> None:
    tiles = draw_fit(seen, [_shown(seen)])[34:]  # below the legend
    assert not _close_to(tiles, _MISSED).any()
    assert not _close_to(tiles, _BEYOND).any()


def test_both_kinds_of_difference_are_shown(seen: list[Seen]) -> None:
    tiles = draw_fit(seen, [_shown(seen, 1)])[34:]
    missed, beyond = _close_to(tiles, _MISSED).sum(), _close_to(tiles, _BEYOND).sum()
    assert missed > 100
    assert missed == pytest.approx(beyond, rel=0.2)


def test_states_stand_one_below_the_other(seen: list[Seen]) -> None:
    one, two = draw_fit(seen, [_shown(seen)]), draw_fit(seen, [_shown(seen), _shown(seen)])
    assert two.shape[1] == one.shape[1]
    assert np.array_equal(two[: one.shape[0]][34:], one[34:])
    assert two.shape[0] > 2 * one.shape[0]


def test_an_empty_camera_is_shown_whole(seen: list[Seen]) -> None:
    nobody = [Seen(one.camera, one.picture, np.zeros_like(one.trimap)) for one in seen]
    sheet = draw_fit(nobody, [_shown(nobody)])
    assert (np.abs(sheet[34:].astype(int) - 90).max(axis=2) == 0).mean() > 0.5
