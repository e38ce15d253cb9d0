"""The shift of a picture against the clean plate."""

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wall_scene import COLOURS, HEIGHT, WIDTH, disc, exposed, wall

from services.mocap.take.folder import open_take
from services.mocap.take.video import VideoReader
from services.mocap.take.writer import video_writer
from services.mocap.types import Bytes, Floats
from services.segmentation.comparison import LEAST_CHANGE, Comparison
from services.segmentation.plate import Plate
from services.segmentation.plate_shift import shifted
from services.segmentation.segmenters import make_segmenter
from services.segmentation.steadying import Anchors

SmallTake = Callable[..., Path]


@pytest.fixture(scope="module")
def anchors() -> Anchors:
    return Anchors.on(tiles().astype(np.float32))


def tiles() -> Floats:
    """The wall with joints in both directions."""
    scene = wall()
    scene[::30] -= 15
    return scene


def shown(column: int) -> Floats:
    """The wall with somebody before a fifth of it."""
    scene = tiles()
    scene[disc(70, (column, 100))] = COLOURS["navy"]
    return scene


def seen(scene: Floats, right: float, down: float, gain: float = 1.0) -> Bytes:
    rng = np.random.default_rng(1)
    return exposed(next(shifted([scene.astype(np.float32)], (right, down))).astype(np.float64), rng, gain)


@settings(max_examples=60, deadline=None)
@given(
    right=st.floats(-2, 2), down=st.floats(-2, 2), gain=st.floats(0.7, 1.2), column=st.integers(0, WIDTH - 1)
)
def test_a_shift_is_found_whatever_the_light_and_wherever_the_actor(
    anchors: Anchors, right: float, down: float, gain: float, column: int
) -> None:
    found = anchors.shift_px(seen(shown(column), right, down, gain))
    is_small = np.hypot(right, down) < 0.6  # within the noise, it may be left as it is
    assert np.allclose(found, (right, down), atol=0.2) or (is_small and found == (0.0, 0.0))


@pytest.mark.parametrize("column", range(0, WIDTH, 40))
def test_an_actor_who_moves_is_no_shift(anchors: Anchors, column: int) -> None:
    assert anchors.shift_px(seen(shown(column), 0, 0)) == (0.0, 0.0)


def test_stripes_tell_a_shift_across_them_only() -> None:
    stripes = np.where(np.arange(HEIGHT) // 12 % 2, 90.0, 150.0)[:, None, None] * np.ones((1, WIDTH, 3))
    right, down = Anchors.on(stripes.astype(np.float32)).shift_px(seen(stripes, 1.5, -0.8))
    assert (right, down) == (0.0, pytest.approx(-0.8, abs=0.1))


def test_an_even_wall_tells_none() -> None:
    even = np.full((HEIGHT, WIDTH, 3), 120.0)
    actor = even.copy()
    actor[disc(60)] = COLOURS["white"]
    assert Anchors.on(even.astype(np.float32)).shift_px(seen(actor, 0, 0)) == (0.0, 0.0)


@pytest.mark.parametrize("level", [0, 255])
def test_a_covered_or_dazzled_camera_is_steady(anchors: Anchors, level: int) -> None:
    assert anchors.shift_px(np.full((HEIGHT, WIDTH, 3), level, np.uint8)) == (0.0, 0.0)


@pytest.mark.parametrize("shape", [(10, 10), (12, 16), (36, 48), (60, 32), (24, 300)])
def test_small_pictures_are_taken_as_they_are(shape: tuple[int, int]) -> None:
    small = np.random.default_rng(0).integers(0, 255, (*shape, 3), dtype=np.uint8)
    assert Anchors.on(small.astype(np.float32)).shift_px(small) == (0.0, 0.0)


def test_a_shaken_picture_shows_the_same_changes() -> None:
    rng = np.random.default_rng(10)
    compared = Comparison(Plate.learn([exposed(tiles(), rng) for _ in range(12)]))
    scene, inner = shown(160), np.s_[6:-6, 6:-6]
    compared.look(seen(scene, 0, 0))
    changed = compared.change > LEAST_CHANGE
    compared.look(seen(scene, 1.6, -1.2))
    assert ((compared.change > LEAST_CHANGE) != changed)[inner].mean() < 0.01


def test_cameras_that_shake_are_said(small_take: SmallTake, caplog: pytest.LogCaptureFixture) -> None:
    folder: Path = small_take(frames=12)
    video = folder / "videos/cam02.mp4"
    with VideoReader(video) as reader:
        pictures = [picture.copy() for picture in reader]
    with video_writer(video, 64, 48, 10.0) as writer:
        for n, picture in enumerate(pictures):
            writer.write(next(shifted([picture], (1.5 * (-1) ** n, 0.0))))
    take = open_take(folder)
    with caplog.at_level(logging.WARNING):
        make_segmenter(take, take.cameras, "clean-plate")
    (sentence,) = [record.getMessage() for record in caplog.records]
    assert sentence.startswith(f"{folder}: cameras shake, or stabilise their pictures (cam02 by ")
