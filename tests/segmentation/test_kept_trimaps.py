"""Silhouettes that are made once: read again they are the same, and nothing is learnt or decoded for them."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from services.mocap.camera.camera import Camera
from services.mocap.take.folder import Take, open_take
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Bytes, Trimap
from services.segmentation import segmenters, silhouettes
from services.segmentation.background import CameraBackground
from services.segmentation.kept_trimaps import KeptTrimaps
from services.segmentation.plate import Plate
from services.segmentation.segmenters import make_segmenter
from services.segmentation.silhouettes import pictures_of

Cameras = Callable[[int], list[Camera]]
SmallTake = Callable[..., Path]
FRAMES = 5


def test_trimaps_of_any_size_come_back_as_they_were(small_cameras: Cameras, tmp_path: Path) -> None:
    rng, states = np.random.default_rng(3), np.array([BACKGROUND, UNSURE, ACTOR], np.uint8)
    cameras = [camera.resized(64 - 8 * c, 48 - 6 * c) for c, camera in enumerate(small_cameras(3))]
    kept = KeptTrimaps(tmp_path / "kept", cameras)
    assert kept.read(7) is None
    made = [rng.choice(states, (camera.height_px, camera.width_px)) for camera in cameras]
    kept.keep(7, made)
    _assert_same(kept.read(7), made)
    assert not kept.has_all(8)
    for frame in range(7):
        kept.keep(frame, made)
    assert kept.has_all(8)


def test_what_cannot_be_kept_is_made_again(small_take: SmallTake, tmp_path: Path) -> None:
    take = open_take(small_take(n_cameras=3, frames=2))
    (tmp_path / "file").touch()
    made = make_segmenter(take, take.cameras, kept=tmp_path / "file" / "kept")
    expected = make_segmenter(take, take.cameras)
    for _ in range(2):
        for found, trimaps in zip(made.trimaps(0, 2), expected.trimaps(0, 2), strict=True):
            _assert_same(found, trimaps)


def _assert_same(found: Sequence[Trimap] | None, expected: Sequence[Trimap]) -> None:
    assert found is not None
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("mode", [0o700, 0o777])
def test_what_was_learnt_is_learnt_once(
    small_take: SmallTake, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int
) -> None:
    """A folder that others can write into is not believed."""
    take, learnt = open_take(small_take(n_cameras=3, frames=FRAMES)), Mock(wraps=segmenters.learn_from_take)
    tmp_path.chmod(mode)
    monkeypatch.setattr(segmenters, "learn_from_take", learnt)
    one, other = (make_segmenter(take, take.cameras, kept=tmp_path) for _ in range(2))
    assert learnt.call_count == (1 if mode == 0o700 else 2)
    alone = make_segmenter(take, take.cameras)
    for made in (one, other):
        expected = alone.trimaps(0, FRAMES)
        for found, trimaps in zip(made.trimaps(0, FRAMES), expected, strict=True):
            _assert_same(found, trimaps)
        for path in tmp_path.glob("*.trimaps"):
            path.unlink()


def test_backgrounds_are_learnt_once(small_take: SmallTake, monkeypatch: pytest.MonkeyPatch) -> None:
    take, learnt = open_take(small_take(n_cameras=3, frames=FRAMES)), Mock(wraps=Plate.learn)
    monkeypatch.setattr(Plate, "learn", learnt)
    backgrounds = {camera.name: CameraBackground(take, camera) for camera in take.cameras}
    alone = make_segmenter(take, take.cameras[:1], backgrounds=backgrounds)
    assert learnt.call_count == 1
    together = make_segmenter(take, take.cameras, backgrounds=backgrounds)
    assert learnt.call_count == 3
    for made, cameras in ((alone, take.cameras[:1]), (together, take.cameras)):
        _assert_same(next(made.trimaps(0, 1)), next(make_segmenter(take, cameras).trimaps(0, 1)))


def test_a_frame_is_made_once(small_take: SmallTake, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    take = open_take(small_take(n_cameras=3, frames=FRAMES))
    expected = list(make_segmenter(take, take.cameras).trimaps(0, FRAMES))
    decoded = list[int]()

    def counted(take: Take, cameras: Sequence[Camera], start: int, stop: int) -> Iterator[dict[int, Bytes]]:
        for frame, images in enumerate(pictures_of(take, cameras, start, stop), start):
            decoded.append(frame)
            yield images

    monkeypatch.setattr(silhouettes, "pictures_of", counted)
    first = make_segmenter(take, take.cameras, kept=tmp_path)
    for found, trimaps in zip(first.trimaps(1, 3), expected[1:3], strict=True):
        _assert_same(found, trimaps)
    assert decoded == [1, 2]
    for found, trimaps in zip(first.trimaps(0, FRAMES), expected, strict=True):
        _assert_same(found, trimaps)
    assert decoded == [1, 2, *range(FRAMES)], "from the first missing frame on"

    decoded.clear()
    monkeypatch.setattr(
        segmenters, "learn_from_take", Mock(side_effect=AssertionError("nothing is to learn"))
    )
    again = make_segmenter(take, take.cameras, kept=tmp_path)
    for found, trimaps in zip(again.trimaps(0, FRAMES), expected, strict=True):
        _assert_same(found, trimaps)
    assert not decoded
    with_pictures = list(again.moments(2, 4))
    assert decoded == [2, 3]
    for moment, images in zip(with_pictures, pictures_of(take, take.cameras, 2, 4), strict=True):
        assert moment.images_bgr is not None
        for c, image in images.items():
            np.testing.assert_array_equal(moment.images_bgr[c], image)
