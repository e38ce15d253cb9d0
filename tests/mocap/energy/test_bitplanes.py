"""Bit-planes hold masks and give them back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from services.mocap.energy.bitplanes import TriPlanes, camera_bit, count_bits, n_planes, pack, unpack
from services.mocap.types import Mask

masks = st.tuples(st.integers(1, 20), st.integers(1, 9), st.integers(1, 9)).flatmap(
    lambda shape: arrays(np.bool_, shape)
)


@given(masks)
def test_round_trip(stack: Mask) -> None:
    planes = pack(stack)
    assert planes.shape == (n_planes(len(stack)), *stack.shape[1:])
    assert planes.dtype == np.uint8
    assert count_bits(planes) == np.count_nonzero(stack)
    np.testing.assert_array_equal(unpack(planes, len(stack)), stack)
    for c, mask in enumerate(stack):
        np.testing.assert_array_equal(camera_bit(planes, c), mask)


@pytest.mark.parametrize(("cameras", "planes"), [(1, 1), (8, 1), (9, 2), (16, 2), (17, 3)])
def test_eight_cameras_a_plane(cameras: int, planes: int) -> None:
    assert n_planes(cameras) == planes


@pytest.mark.parametrize("n_cameras", [3, 8, 11])
@pytest.mark.parametrize("n_empty", [0, 1, 2, 3])
@pytest.mark.parametrize("failed", [False, True])
def test_a_camera_that_shows_nobody_or_is_white_is_unsure_where_two_others_show_somebody(
    n_cameras: int, n_empty: int, failed: bool
) -> None:
    rng = np.random.default_rng(n_cameras)
    silhouettes, unsure = rng.random((2, n_cameras, 40, 56)) < 0.4
    silhouettes[:n_empty] = failed
    unsure[:n_empty] &= not failed
    silhouettes &= ~unsure
    seen = TriPlanes(pack(silhouettes), pack(unsure))
    doubting = seen.doubting_failed(np.full((n_cameras, 2), (56, 40)))
    if n_cameras - n_empty >= 2:
        unsure[:n_empty], silhouettes[:n_empty] = True, False
    np.testing.assert_array_equal(unpack(doubting.silhouettes, n_cameras), silhouettes)
    np.testing.assert_array_equal(unpack(doubting.unsure, n_cameras), unsure)
    assert doubting is seen or n_empty
