"""An object that hides the actor in one place hides whoever is behind the rest of it."""

import cv2
import numpy as np
import pytest

from services.mocap.search.whole_objects import whole_object
from services.mocap.types import Bytes, Ints, Mask

BOX, SHADED, KNOWN = np.s_[140:240, 60:200], np.s_[140:240, 180:200], np.s_[150:190, 90:140]
WALL_BGR, BOX_BGR, SHADED_BGR = (150, 160, 165), (50, 90, 95), (35, 70, 75)


@pytest.fixture
def stage() -> Bytes:
    """(240, 320, 3) a noisy wall, and before it a box with a darker side."""
    picture = np.full((240, 320, 3), WALL_BGR, np.float64)
    picture[BOX], picture[SHADED] = BOX_BGR, SHADED_BGR
    noise = np.random.default_rng(0).normal(0, 1, picture.shape)
    return np.asarray((picture + noise).clip(0, 255), np.uint8)


@pytest.fixture
def known() -> Mask:
    """(240, 320) where the actor was behind the box."""
    mask = np.zeros((240, 320), bool)
    mask[KNOWN] = True
    return mask


NOBODY: Ints = np.zeros((240, 320), np.int32)


def box(part: tuple[slice, slice] = BOX) -> Mask:
    mask = np.zeros((240, 320), bool)
    mask[part] = True
    return mask


def test_the_known_side_is_found_to_its_edges(stage: Bytes, known: Mask) -> None:
    np.testing.assert_array_equal(whole_object(known, stage, NOBODY), box() & ~box(SHADED))


def test_both_sides_are_found_where_the_actor_was_behind_both(stage: Bytes, known: Mask) -> None:
    known[150:160, 90:195] = True
    np.testing.assert_array_equal(whole_object(known, stage, NOBODY), box())


def test_an_object_of_the_same_colour_elsewhere_is_another_one(stage: Bytes, known: Mask) -> None:
    stage[20:60, 250:300] = BOX_BGR
    np.testing.assert_array_equal(whole_object(known, stage, NOBODY), box() & ~box(SHADED))


def test_a_wall_in_the_objects_colour_before_which_the_actor_walks_is_not_part_of_it(
    stage: Bytes, known: Mask
) -> None:
    stage[:] = BOX_BGR
    stage[:, 160:] = WALL_BGR  # else it would be too large
    n_seen = NOBODY.copy()
    n_seen[40:140, 20:120] = 10
    assert whole_object(known, stage, NOBODY).mean() == pytest.approx(0.5)
    assert not whole_object(known, stage, n_seen).any()


def test_what_fills_most_of_the_picture_is_no_object(stage: Bytes, known: Mask) -> None:
    stage[:] = BOX_BGR
    assert not whole_object(known, stage, NOBODY).any()


def test_a_textured_object_is_found_as_far_as_its_colours_are_known(stage: Bytes, known: Mask) -> None:
    stage[BOX][::8] = (60, 60, 160)  # stripes: known in the known part, so the same everywhere
    found = whole_object(known, stage, NOBODY)
    assert found[140:240, 60:179].mean() > 0.95
    assert not found[:135].any()
    assert cv2.connectedComponents(found.view(np.uint8))[0] == 2
