"""Windows and halves of the input."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import pack, unpack
from services.mocap.energy.picture import Picture, Region
from services.mocap.types import Bytes, Mask

HEIGHT_PX, WIDTH_PX = 14, 18
SIZES_PX = np.array([[18, 14], [11, 14], [18, 9]], np.int32)
RIG = Rig(np.zeros((3, 3, 4)), SIZES_PX)


def _masks(seed: int) -> Mask:
    return np.random.default_rng(seed).random((3, HEIGHT_PX, WIDTH_PX)) < 0.5


def _ignored(picture: Picture) -> Mask:
    return unpack(picture.ignored, 3)


def test_what_lies_outside_a_cameras_picture_is_ignored() -> None:
    ignored = _ignored(Picture.whole(RIG, pack(_masks(0))))
    for mask, (width, height) in zip(ignored, SIZES_PX, strict=True):
        assert not mask[:height, :width].any()
        assert mask[height:].all()
        assert mask[:, width:].all()


def test_nothing_counts_of_cameras_that_are_left_out() -> None:
    picture = Picture.whole(RIG, pack(_masks(0)))
    assert picture.without_cameras(()) is picture
    np.testing.assert_array_equal(_ignored(picture.without_cameras((1,)))[[0, 2]], _ignored(picture)[[0, 2]])
    assert _ignored(picture.without_cameras((1,)))[1].all()


def test_another_shape_is_refused() -> None:
    with pytest.raises(ValueError, match=r"silhouettes: expected shape \(1, 14, 18\), got \(1, 14, 17\)"):
        Picture.whole(RIG, np.zeros((1, 14, 17), np.uint8))


@given(
    st.lists(st.tuples(st.integers(-30, 30), st.integers(-30, 30)), min_size=3, max_size=3), st.integers(0, 9)
)
def test_a_window_is_a_crop_and_the_rest_is_ignored(origins: list[tuple[int, int]], seed: int) -> None:
    masks = _masks(seed)
    window = Picture.whole(RIG, pack(masks)).window(np.array(origins, np.int32), 13, 12)
    for c, (x0, y0) in enumerate(origins):
        y, x = np.mgrid[y0 : y0 + 12, x0 : x0 + 13]
        inside = (x >= 0) & (y >= 0) & (x < SIZES_PX[c, 0]) & (y < SIZES_PX[c, 1])
        np.testing.assert_array_equal(_ignored(window)[c], ~inside)
        cut = masks[c][np.clip(y, 0, HEIGHT_PX - 1), np.clip(x, 0, WIDTH_PX - 1)]
        np.testing.assert_array_equal(unpack(window.silhouettes, 3)[c][inside], cut[inside])


def test_a_window_equals_a_picture_made_of_its_region() -> None:
    origin_px = np.array([[3, 2], [-4, 5], [9, -1]], np.int32)
    window = Picture.whole(RIG, pack(_masks(1))).window(origin_px, 10, 8)
    direct = Picture.of_region(RIG, Region(origin_px, 10, 8), window.silhouettes)
    np.testing.assert_array_equal(direct.ignored, window.ignored)
    np.testing.assert_array_equal(direct.region.origin_px, window.region.origin_px)


def test_a_window_of_a_window_is_a_window() -> None:
    picture = Picture.whole(RIG, pack(_masks(2)))
    outer = picture.window(np.full((3, 2), 2, np.int32), 12, 10)
    inner_px = np.array([[4, 3], [5, 4], [2, 2]], np.int32)
    np.testing.assert_array_equal(
        outer.window(inner_px, 6, 5).silhouettes, picture.window(inner_px, 6, 5).silhouettes
    )


def test_half_resolution_keeps_what_two_of_four_pixels_have() -> None:
    masks = _masks(3)
    picture = Picture.whole(RIG, pack(masks))
    half = picture.halved()
    blocks = masks.reshape(3, 7, 2, 9, 2).sum(axis=(2, 4))
    np.testing.assert_array_equal(unpack(half.silhouettes, 3), blocks >= 2)
    ignored = _ignored(picture).reshape(3, 7, 2, 9, 2).any(axis=(2, 4))
    np.testing.assert_array_equal(_ignored(half), ignored)
    assert (half.region.width_px, half.region.height_px, half.region.scale) == (9, 7, 0.5)


def test_ignoring_adds_up() -> None:
    picture = Picture.whole(RIG, pack(_masks(4)))
    more = pack(_masks(5))
    np.testing.assert_array_equal(picture.ignoring(more).ignored, picture.ignored | more)


def test_the_halved_projection_maps_four_pixels_to_their_middle(ring: Callable[[int], Rig]) -> None:
    rig = ring(2)
    planes: Bytes = np.zeros((1, *rig.shape_px), np.uint8)
    half = Picture.whole(rig, planes).halved().region
    point = np.array([0.1, -0.2, 1.0, 1.0])
    for P, P_half in zip(rig.P_px_world, half.projections(rig), strict=True):
        x, y, w = P @ point
        x_half, y_half, w_half = P_half @ point
        np.testing.assert_allclose([x_half / w_half, y_half / w_half], [(x / w - 0.5) / 2, (y / w - 0.5) / 2])
