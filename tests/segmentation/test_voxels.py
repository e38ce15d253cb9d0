"""What other cameras say of a pixel, where it is known what stands on the stage."""

from collections.abc import Sequence

import cv2
import numpy as np
import pytest
from rig_scene import BLUE, Blob, render, ring

from services.mocap.types import Bytes, Ints, Mask
from services.segmentation.lenses import Lenses
from services.segmentation.voxels import (
    ALONE,
    CLASS_PRIOR,
    DEEP,
    INSIDE,
    MISS,
    MORE_MISS,
    N_CLASSES,
    NEAR,
    ONE_MISSES,
    VoxelGrid,
)

CAMERAS = ring(6)
LENSES = Lenses.of(CAMERAS)
GRID = VoxelGrid.of(CAMERAS, LENSES, 0.0)
ALL: Ints = np.arange(6, dtype=np.int32)
BALL = Blob((0.1, -0.1, 1.0), (0.35, 0.35, 0.35), BLUE)


def misses_of(masks: Sequence[Mask]) -> Bytes:
    return np.array([np.where(mask, 0, MISS) for mask in masks], np.uint8)


@pytest.fixture(scope="module")
def balls() -> list[Mask]:
    return [render(camera, [BALL]).actor for camera in CAMERAS]


def shrunk(mask: Mask, by_px: int) -> Mask:
    return np.asarray(cv2.erode(mask.astype(np.uint8), np.ones((2 * by_px + 1,) * 2, np.uint8)) > 0)


def grown(mask: Mask, by_px: int) -> Mask:
    return ~shrunk(~mask, by_px)


def test_what_all_see_is_inside_and_what_nobody_sees_is_missed(balls: list[Mask]) -> None:
    classes = GRID.classes(misses_of(balls), ALL)
    for ball, found in zip(balls, classes, strict=True):
        assert (found[shrunk(ball, 6)] == INSIDE).all()
        assert np.isin(found[ball], [INSIDE, DEEP, NEAR]).all()
        far = found[~grown(ball, 25)]
        assert np.isin(far, [MORE_MISS, ALONE]).all()
        assert (far == MORE_MISS).any()


def test_a_pixel_is_told_by_the_others_alone(balls: list[Mask]) -> None:
    misses = misses_of(balls)
    usual = GRID.classes(misses, ALL)
    for c, ball in enumerate(balls):
        blind = misses.copy()
        blind[c] = MISS  # this camera sees nothing
        found = GRID.classes(blind, ALL)
        assert (found[c][shrunk(ball, 6)] == INSIDE).all()
        for other in range(6):
            if other != c:
                assert np.isin(found[other][shrunk(balls[other], 8)], [DEEP, ONE_MISSES]).all()
                assert (usual[other][shrunk(balls[other], 8)] == INSIDE).all()


def test_what_one_camera_alone_sees_is_missed_by_more(balls: list[Mask]) -> None:
    for c in range(6):
        alone = [balls[c] if k == c else np.zeros_like(balls[k]) for k in range(6)]
        found = GRID.classes(misses_of(alone), ALL)[c]
        assert np.isin(found, [MORE_MISS, ALONE]).all()
        assert (found[balls[c]] == MORE_MISS).all()


def test_outside_of_the_common_view_nobody_can_tell(balls: list[Mask]) -> None:
    classes = GRID.classes(misses_of(balls), ALL)
    for covered, found in zip(GRID.covered, classes, strict=True):
        np.testing.assert_array_equal(found == ALONE, ~covered)
        assert covered[90, 120]
    (apart, *_) = ring(6)
    away = [*ring(6)[:5], apart]  # a seventh of the rig would see; one that looks away does not
    away[5] = type(apart)(
        "away",
        240,
        180,
        apart.K,
        apart.distortion,
        -apart.R_camera_world,
        apart.R_camera_world @ apart.centre_world_m,
    )
    lenses = Lenses.of(away)
    grid = VoxelGrid.of(away, lenses, 0.0)
    assert grid.covered[5].mean() < grid.covered[0].mean()


def test_cameras_may_be_missing(balls: list[Mask]) -> None:
    misses = misses_of(balls)
    misses[[1, 4]] = 77  # nonsense, which nobody may look at
    there = np.array([0, 2, 3, 5], np.int32)
    found = GRID.classes(misses, there)
    misses[[1, 4]] = 3
    again = GRID.classes(misses, there)
    assert len(found) == 4
    for k, c in enumerate(there):
        assert (found[k][shrunk(balls[c], 6)] == INSIDE).all()
        np.testing.assert_array_equal(found[k], again[k])


def test_what_lies_on_the_floor_is_no_voxels() -> None:
    assert GRID.coarse_m[:, 2].min() > 0.04
    higher = VoxelGrid.of(CAMERAS, LENSES, 0.35)
    assert higher.coarse_m[:, 2].min() == pytest.approx(GRID.coarse_m[:, 2].min() + 0.35)


def test_the_more_others_see_it_the_likelier_the_actor() -> None:
    assert len(CLASS_PRIOR) == N_CLASSES
    assert CLASS_PRIOR[INSIDE] > CLASS_PRIOR[DEEP] > CLASS_PRIOR[ONE_MISSES] > CLASS_PRIOR[MORE_MISS]
    assert CLASS_PRIOR[ALONE] == 0
