"""Specks, holes, gaps and edges of masks."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from services.mocap.types import Mask
from services.segmentation import edges
from services.segmentation.cleanup import cleanup, drop_unconfirmed
from services.segmentation.pixels import MEAN_STEPS, Levels

SHAPE = (240, 320)
# On the small masks below: specks under 6 px, holes under 4 px.
COARSE_PPM = 6e6 / (24 * 32), 4e6 / (24 * 32)
SMALL_MASKS = arrays(np.bool_, (24, 32), elements=st.booleans())


def settle_edges(
    mask: Mask, picture: Levels, background: Levels, width_permille: float = edges.EDGE_WIDTH_PERMILLE
) -> Mask:
    part = mask.astype(np.uint8)
    channels = np.ascontiguousarray(np.moveaxis(np.rint(picture).clip(0, 255), 2, 0).astype(np.uint8))
    mean = np.ascontiguousarray(np.rint(np.moveaxis(background, 2, 0) * MEAN_STEPS).astype(np.int16))
    rim_px = width_permille * 1e-3 * mask.shape[1]
    edges.settle_edges(part, (0, 0), channels, mean, rim_px)
    return part > 0


def blank() -> Mask:
    return np.zeros(SHAPE, np.bool_)


def standing_actor() -> Mask:
    """A body with two legs open at the bottom, an arm akimbo, and a thin forearm with a 3 px hand."""
    mask = blank()
    mask[60:130, 140:180] = True
    mask[130:220, 140:156] = mask[130:220, 164:180] = True
    mask[70:74, 110:140] = mask[74:100, 110:114] = mask[100:104, 110:140] = True
    mask[80:83, 180:215] = True
    return mask


@given(SMALL_MASKS)
def test_cleaning_twice_changes_nothing_more(mask: Mask) -> None:
    once = cleanup(mask, *COARSE_PPM)
    assert np.array_equal(cleanup(once, *COARSE_PPM), once)


@given(SMALL_MASKS, SMALL_MASKS)
def test_a_larger_mask_never_gives_a_smaller_silhouette(mask: Mask, more: Mask) -> None:
    assert not np.any(cleanup(mask, *COARSE_PPM) & ~cleanup(mask | more, *COARSE_PPM))


@given(SMALL_MASKS)
def test_mirroring_and_turning_commute_with_cleaning(mask: Mask) -> None:
    cleaned = cleanup(mask, *COARSE_PPM)
    assert np.array_equal(cleanup(mask[:, ::-1], *COARSE_PPM), cleaned[:, ::-1])
    assert np.array_equal(cleanup(mask.T, *COARSE_PPM), cleaned.T)


@given(SMALL_MASKS)
def test_no_speck_and_no_small_hole_is_left(mask: Mask) -> None:
    cleaned = cleanup(mask, *COARSE_PPM)
    _, _, patches, _ = cv2.connectedComponentsWithStats(cleaned.view(np.uint8), connectivity=8)
    assert np.all(patches[1:, cv2.CC_STAT_AREA] >= 6)
    # Ringed by a border of background, every hole that touched the picture's border is one patch with it.
    padded = np.pad(~cleaned, 1, constant_values=True)
    _, _, gaps, _ = cv2.connectedComponentsWithStats(padded.view(np.uint8), connectivity=4)
    assert np.all(gaps[1:, cv2.CC_STAT_AREA] >= 4)


@given(SMALL_MASKS, st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_patches_stay_where_enough_of_another_mask_lies(mask: Mask, seed: int, least_px: int) -> None:
    seeds = np.random.default_rng(seed).random(mask.shape) < 0.2
    _, labels = cv2.connectedComponents(mask.view(np.uint8), connectivity=8)
    enough = np.bincount(labels[seeds], minlength=labels.max() + 1) >= least_px
    kept = mask.copy().view(np.uint8)
    drop_unconfirmed(kept, seeds.view(np.uint8), least_px)
    assert np.array_equal(kept > 0, mask & enough[labels])


@given(SMALL_MASKS)
def test_patches_are_those_that_opencv_finds(mask: Mask) -> None:
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=8)
    kept = (stats[:, cv2.CC_STAT_AREA] >= 6) & (np.arange(len(stats)) > 0)
    solid = kept[labels]
    # Ringed by background, all that reaches the border is one large patch.
    padded = np.pad(~solid, 1, constant_values=True).view(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(padded, connectivity=4)
    small = (stats[:, cv2.CC_STAT_AREA] < 4) & (np.arange(len(stats)) > 0)
    assert np.array_equal(cleanup(mask, *COARSE_PPM), solid | small[labels][1:-1, 1:-1])


@given(SMALL_MASKS, st.integers(1, 5))
def test_depths_are_distances_up_to_their_limit(mask: Mask, reach: int) -> None:
    inside2, outside2 = edges._depths2(mask.astype(np.uint8), reach, np.float32(reach**2))
    for found, here in ((inside2, mask), (outside2, ~mask)):
        rows, columns = np.nonzero(~here)
        y, x = np.indices(mask.shape)
        away2 = (y[..., None] - rows) ** 2 + (x[..., None] - columns) ** 2
        true2 = np.minimum(away2.min(axis=2, initial=reach**2), reach**2)
        assert np.array_equal(found, true2)


def test_the_mask_given_stays_as_it_is() -> None:
    mask = standing_actor()
    mask[5, 5] = True
    before = mask.copy()
    cleanup(mask)
    assert np.array_equal(mask, before)


def test_limbs_and_gaps_stay_to_the_pixel() -> None:
    assert np.array_equal(cleanup(standing_actor()), standing_actor())


def test_specks_go_and_holes_close() -> None:
    noisy = standing_actor()
    rng = np.random.default_rng(3)
    rows, columns = rng.integers(2, 55, 60), rng.integers(2, 318, 60)
    noisy[rows, columns] = True
    noisy[90:92, 150:153] = False
    assert np.array_equal(cleanup(noisy), standing_actor())


@pytest.mark.parametrize(("area_px", "filled"), [(7, True), (8, False), (40, False)])
def test_holes_are_filled_up_to_their_limit(area_px: int, filled: bool) -> None:
    mask = standing_actor()
    mask[90, 141 : 141 + min(area_px, 20)] = False
    mask[91, 141 : 141 + max(area_px - 20, 0)] = False
    assert bool(cleanup(mask)[90, 141]) == filled


@pytest.mark.parametrize(("area_px", "kept"), [(15, False), (16, True)])
def test_specks_go_up_to_their_limit(area_px: int, kept: bool) -> None:
    mask = blank()
    mask[20, 30 : 30 + area_px] = True
    assert bool(cleanup(mask).any()) == kept


def test_limits_grow_with_the_picture() -> None:
    mask = np.zeros((480, 640), np.bool_)
    mask[20, 30:90] = True  # 60 px, as many in proportion as 15 at 320x240
    assert not cleanup(mask).any()
    mask[21, 30:33] = True
    assert cleanup(mask).any()


def test_a_pocket_at_the_border_is_no_hole() -> None:
    mask = blank()
    mask[:40, :40] = True
    mask[0, 10:13] = False
    assert np.array_equal(cleanup(mask), mask)


@pytest.mark.parametrize("value", [False, True])
def test_uniform_masks_stay(value: bool) -> None:
    mask = np.full(SHAPE, value)
    assert np.array_equal(cleanup(mask), mask)
    levels = np.full((*SHAPE, 3), 100, np.float32)
    assert np.array_equal(settle_edges(mask, levels, levels), mask)


def mixed_disc(radius_px: float) -> tuple[Levels, Levels, Levels]:
    """How much of each pixel a disc covers (H, W), its picture before a textured wall, and the wall."""
    fine = np.zeros((SHAPE[0] * 8, SHAPE[1] * 8), np.uint8)
    cv2.circle(fine, (1275, 963), round(radius_px * 8), 1, thickness=-1)
    cover = fine.reshape(SHAPE[0], 8, SHAPE[1], 8).mean(axis=(1, 3)).astype(np.float32)
    wall = np.random.default_rng(1).normal(150, 8, (*SHAPE, 1)) * [0.9, 1.0, 1.1]
    picture = cover[..., None] * np.array([110.0, 40.0, 30.0]) + (1 - cover[..., None]) * wall
    return cover, picture.astype(np.float32), wall.astype(np.float32)


@pytest.mark.parametrize("radius_px", [3, 12, 60])
def test_a_pixel_belongs_to_whom_most_of_it_belongs(radius_px: float) -> None:
    cover, picture, wall = mixed_disc(radius_px)
    settled = settle_edges(cover > 0.02, picture, wall)
    undecided = np.abs(cover - 0.5) < 0.1
    assert np.array_equal(settled[~undecided], (cover > 0.5)[~undecided])


def test_noise_leaves_no_ragged_outline() -> None:
    cover, picture, wall = mixed_disc(40)
    noise = np.random.default_rng(5).normal(0, 12, picture.shape).astype(np.float32)
    settled = settle_edges(cover > 0.02, picture + noise, wall)
    wrong = settled != (cover > 0.5)
    assert wrong.sum() < 0.1 * ((cover > 0.02) & (cover < 0.98)).sum()
    assert not np.any(wrong & ((cover == 0) | (cover == 1)))


@pytest.mark.parametrize("ratio", [0.5, 0.7])
def test_edges_settle_in_shadow_too(ratio: float) -> None:
    cover, _, wall = mixed_disc(40)
    shoe = np.array([20.0, 20.0, 25.0])
    picture = cover[..., None] * shoe + (1 - cover[..., None]) * wall * ratio
    settled = settle_edges(cover > 0.02, picture.astype(np.float32), wall)
    undecided = np.abs(cover - 0.5) < 0.1
    assert np.array_equal(settled[~undecided], (cover > 0.5)[~undecided])


def test_a_second_colour_at_the_edge_is_not_cut_off() -> None:
    cover, picture, wall = mixed_disc(30)
    hand = np.zeros(SHAPE, np.bool_)
    hand[118:122, 188:196] = True  # sticks out of the navy disc, too thin to have a depth of its own
    picture[hand] = (60, 170, 230)
    settled = settle_edges((cover > 0.02) | hand, picture, wall)
    assert settled[hand].all()


def test_edges_stay_where_the_actor_looks_like_the_wall() -> None:
    mask = mixed_disc(30)[0] > 0.02
    wall = np.full((*SHAPE, 3), 150, np.float32)
    assert np.array_equal(settle_edges(mask, wall + 3 * mask[..., None], wall), mask)


def test_no_rim_leaves_edges_alone() -> None:
    cover, picture, wall = mixed_disc(30)
    assert np.array_equal(settle_edges(cover > 0.02, picture, wall, 0.0), cover > 0.02)
