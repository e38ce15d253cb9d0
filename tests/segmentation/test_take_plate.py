"""Clean plates made of the take itself, and clean plates with somebody in them."""

import cv2
import numpy as np
import pytest

from services.mocap.types import Bytes, Mask
from services.segmentation.take_plate import find_ghost, plate_of_samples

HEIGHT, WIDTH, NOISE = 90, 120, 2.0


def room() -> Bytes:
    rng = np.random.default_rng(0)
    rough = cv2.GaussianBlur(rng.normal(0, 60, (HEIGHT, WIDTH)), (0, 0), 4) + 120
    return np.asarray(np.clip(rough, 30, 220)[..., None] * [1.0, 0.95, 0.9], np.uint8)


def somebody(column: int) -> Mask:
    drawn = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.ellipse(drawn, (column, 45), (9, 30), 0, 0, 360, 1, thickness=-1)
    return drawn > 0


def picture(columns: list[int], seed: int, gain: float = 1.0) -> Bytes:
    """The room with people in it, all in dark stripes that change with the seed."""
    scene = room().astype(np.float64)
    for column in columns:
        clothes = np.where((np.arange(HEIGHT) // 6 + seed) % 2, 25.0, 45.0)[:, None, None] * [1.0, 0.5, 0.4]
        scene = np.where(somebody(column)[..., None], clothes, scene)
    noisy = scene * gain + np.random.default_rng(seed).normal(0, NOISE, scene.shape)
    return np.asarray(np.clip(np.rint(noisy), 0, 255), np.uint8)


def walk(columns: list[int]) -> Bytes:
    rng = np.random.default_rng(1)
    return np.array([picture([c], n, 1 + rng.uniform(-0.1, 0.1)) for n, c in enumerate(columns)])


def test_a_walk_leaves_the_empty_room() -> None:
    plate = plate_of_samples(walk(list(range(10, 110, 5))))
    off = np.abs(plate.frames.astype(int) - room()).max(axis=-1)
    assert np.quantile(off, 0.999) < 6 * NOISE  # in every frame, at the exposure of the first
    spread = plate.frames[..., 1].astype(float).std(axis=0)
    assert NOISE * 0.6 < np.median(spread) < NOISE * 1.6
    assert plate.unsure_share == 0


def test_where_half_of_the_pictures_show_the_actor_is_told() -> None:
    mostly_there = plate_of_samples(walk([30] * 5 + [33] * 3 + [38] * 3 + [80] * 9))
    assert 0.1 < mostly_there.unsure_share < 0.5
    assert np.abs(np.median(mostly_there.frames, axis=0) - room()).max() < 10 * NOISE  # found all the same
    assert (mostly_there.support[~(somebody(30) | somebody(33) | somebody(38) | somebody(80))] > 0.9).all()


def test_a_clean_plate_is_clean() -> None:
    plate = np.array([picture([], 100 + n) for n in range(6)])
    for columns in (list(range(10, 110, 9)), [60, 61, 62, 60, 61, 59, 60, 61]):  # walks, or stays in place
        assert find_ghost(plate, walk(columns)) is None
        assert find_ghost(plate[:1], walk(columns)) is None


def test_a_border_behind_somebody_who_stays_is_no_outline() -> None:
    def pictured(seed: int, actor: Mask | None = None) -> Bytes:
        scene = np.full((HEIGHT, WIDTH, 3), 200.0)
        scene[:, 60:] = 55.0  # a wall that ends behind the actor
        if actor is not None:
            scene[actor] = 90.0
        return np.rint(scene + np.random.default_rng(seed).normal(0, NOISE, scene.shape)).astype(np.uint8)

    plate = np.array([pictured(100 + n) for n in range(6)])
    columns = (60, 63, 66, 57, 54, 60, 64, 56)
    assert find_ghost(plate, np.array([pictured(n, somebody(c)) for n, c in enumerate(columns)])) is None


@pytest.mark.parametrize("n_stays", [0, 4, 8, 10])
def test_an_actor_before_a_rough_wall_who_stays_for_a_while_is_not_in_the_plate(n_stays: int) -> None:
    rng = np.random.default_rng(5)
    rough = np.kron(rng.uniform(-45, 45, (HEIGHT // 6, WIDTH // 6)), np.ones((6, 6)))[..., None] + 120

    def pictured(column: int | None) -> Bytes:
        scene = np.repeat(rough, 3, axis=2)
        if column is not None:
            scene[somebody(column)] = 60.0
        return np.rint(scene + rng.normal(0, NOISE, scene.shape)).clip(0, 255).astype(np.uint8)

    columns = [60] * n_stays + list(range(10, 110, 8))[: 12 - n_stays]
    takes = [np.array([pictured(column) for column in order]) for order in (columns, columns[::-1])]
    assert [find_ghost(np.array([pictured(None)]), take) for take in takes] == [None, None]


@pytest.mark.parametrize("n_plates", [1, 6])
def test_somebody_who_stands_in_the_plate(n_plates: int) -> None:
    ghost = find_ghost(
        np.array([picture([84], 100 + 2 * n) for n in range(n_plates)]), walk(list(range(10, 70, 5)))
    )
    assert ghost is not None
    assert not ghost.moves
    assert ghost.centre_px(WIDTH) == pytest.approx((84, 45), abs=3)
    assert ghost.share == pytest.approx(somebody(84).mean(), rel=0.1)


def test_the_actor_in_the_plate_who_then_walks_away() -> None:
    ghost = find_ghost(np.array([picture([84], 100)]), walk([84, 84, 84, *range(70, 10, -6)]))
    assert ghost is not None
    assert not ghost.moves
    assert ghost.centre_px(WIDTH) == pytest.approx((84, 45), abs=3)


def test_somebody_who_walks_through_the_plate() -> None:
    ghost = find_ghost(walk([20, 40, 60, 80, 100, 20, 40, 60]), walk(list(range(10, 110, 9))))
    assert ghost is not None
    assert ghost.moves
