"""Looks at videos that cost little, and the warning that they serve."""

import logging
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.mocap.take.folder import open_take
from services.mocap.take.video import VideoReader
from services.mocap.take.video_index import VideoIndex
from services.mocap.take.writer import video_writer
from services.mocap.types import Bytes
from services.segmentation.background import CameraBackground, keeping_looks, quick_looks, shrunk
from services.segmentation.segmenters import make_segmenter

SmallTake = Callable[..., Path]


@given(st.integers(0, 300), st.integers(1, 12))
def test_some_of_what_goes_by_is_kept_evenly(count: int, fewest: int) -> None:
    pictures = [np.full((2, 2, 3), n % 256, np.uint8) for n in range(count)]
    kept = list[Bytes]()
    through = keeping_looks(pictures, kept, fewest)
    assert all(seen is given for seen, given in zip(through, pictures, strict=True))
    assert min(count, fewest) <= len(kept) < 2 * fewest
    numbers = [int(picture[0, 0, 0]) for picture in kept]
    assert len({(after - before) % 256 for before, after in pairwise(numbers)}) <= 1


def test_large_pictures_are_shrunk_and_small_ones_are_not() -> None:
    assert shrunk(np.zeros((480, 640, 3), np.uint8)).shape == (120, 160, 3)
    small = np.zeros((48, 64, 3), np.uint8)
    assert shrunk(small) is small


@pytest.mark.parametrize("most", [1, 5, 12])
def test_quick_looks_decode_little(small_take: SmallTake, monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    take = open_take(small_take(frames=200))
    camera, asked = take.cameras[0], list[range]()

    def count(video: Path | VideoIndex, start: int, stop: int, *further: Any) -> VideoReader:
        asked.append(range(start, stop))
        return VideoReader(video, start, stop, *further)

    monkeypatch.setattr("services.mocap.take.folder.VideoReader", count)
    looks = quick_looks(take, camera, most)
    assert most <= len(looks) <= 2 * most
    assert sum(len(frames) for frames in asked) <= 50
    with take.video(camera) as video:
        first = next(iter(video))
    assert np.array_equal(looks[0], first)


def repaint_plate(folder: Path, paint: Callable[[int, Bytes], None]) -> None:
    plate = folder / "background/cam02.mp4"
    with VideoReader(plate) as video:
        pictures = [picture.copy() for picture in video]
    pictures = [pictures[n % len(pictures)].copy() for n in range(20)]
    with video_writer(plate, 64, 48, 10.0) as video:
        for n, picture in enumerate(pictures):
            paint(n, picture)
            video.write(picture)


@pytest.mark.parametrize("segmenter", ["clean-plate", "paper", "mog2", "bgsegm"])
@pytest.mark.parametrize(
    ("moves", "said"),
    [(False, "shows something that most frames do not"), (True, "something moves in it"), (None, None)],
)
def test_somebody_in_a_plate_is_said(
    small_take: SmallTake,
    caplog: pytest.LogCaptureFixture,
    segmenter: str,
    moves: bool | None,
    said: str | None,
) -> None:
    folder = small_take(frames=12)

    def paint(n: int, picture: Bytes) -> None:
        column = 52 - (2 * n if moves else 0)
        if moves is not None:
            cv2.ellipse(picture, (column, 30), (5, 14), 0, 0, 360, (30, 40, 60), cv2.FILLED)

    repaint_plate(folder, paint)
    take = open_take(folder)
    with caplog.at_level(logging.WARNING):
        make_segmenter(take, take.cameras, segmenter)
    sentences = [record.getMessage() for record in caplog.records]
    assert len(sentences) == (said is not None)
    if said is not None:
        assert sentences[0].startswith(f"{folder}/background: clean plate of cam02: {said}")
        if not moves:
            assert "about column 52, row 30)" in sentences[0]


def test_noise_of_the_videos_counts_where_the_plate_is_clean(small_take: SmallTake) -> None:
    """A plate from a photograph, for example, or at another sensitivity than the take."""
    folder, rng = small_take(frames=4), np.random.default_rng(2)
    video = folder / "videos/cam02.mp4"
    with VideoReader(video) as reader:
        pictures = [picture.copy() for picture in reader]
    with video_writer(video, 64, 48, 10.0) as writer:
        for picture in pictures:
            noisy = picture + rng.normal(0, 12, picture.shape)
            writer.write(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    take = open_take(folder)
    clean, noisy_plate = (CameraBackground(take, camera).plate() for camera in take.cameras[:2])
    assert noisy_plate.usual_noise2 > 2 * clean.usual_noise2


def test_a_plate_of_another_contrast_is_adapted_and_said(
    small_take: SmallTake, caplog: pytest.LogCaptureFixture
) -> None:
    folder = small_take(frames=12)

    def paint(_: int, picture: Bytes) -> None:
        picture[:] = np.rint(90 + 0.4 * picture)

    repaint_plate(folder, paint)
    take = open_take(folder)
    with caplog.at_level(logging.WARNING):
        make_segmenter(take, take.cameras, "clean-plate")
    (sentence,) = [record.getMessage() for record in caplog.records]
    assert sentence.startswith(
        f"{folder}/background: clean plate of cam02 has another contrast or exposure than the videos, "
        "to which it was "
    )
