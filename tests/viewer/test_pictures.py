"""Pictures and silhouettes in any order are those that reading in order gives."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from services.mocap.camera.undistort import Undistorter
from services.mocap.take.folder import Take
from services.mocap.take.video_index import VideoIndex, index_video
from services.viewer import pictures as module
from services.viewer.pictures import Reader, TakePictures


def test_a_reader_goes_on_turns_back_and_jumps() -> None:
    begun: list[int] = []

    def begin(start: int) -> Iterator[int]:
        begun.append(start)
        return iter(range(start, 200))

    reader = Reader(begin)
    assert [reader.read(frame) for frame in (0, 1, 1, 5, 29, 3, 199, 0)] == [0, 1, 1, 5, 29, 3, 199, 0]
    assert begun == [0, 3, 199, 0]


def test_a_reader_that_failed_begins_anew() -> None:
    def begin(start: int) -> Iterator[int]:
        for frame in range(start, 10):
            if frame == 4:
                raise OSError
            yield frame

    reader = Reader(begin)
    assert reader.read(2) == 2
    with pytest.raises(OSError):
        reader.read(5)
    assert reader.read(5) == 5


def test_pictures_of_a_take(walk: Take) -> None:
    pictures = TakePictures(walk, None)
    camera = walk.cameras[2]
    with walk.video(camera) as video:
        undistorter = Undistorter(camera)
        expected = [undistorter.image(picture) for picture in video]
    for frame in (3, 4, 20, 0):
        found = pictures.picture(2, frame)
        assert found is not None
        np.testing.assert_array_equal(found, expected[frame])
    assert pictures.trimap(2, 3) is None  # nobody makes any


def test_silhouettes_that_somebody_makes(walk: Take) -> None:
    pictures = TakePictures(
        walk,
        lambda start, stop: (
            [np.full((2, 3), 10 * f + c, np.uint8) for c in range(len(walk.cameras))]
            for f in range(start, stop)
        ),
    )
    for camera, frame in ((0, 4), (2, 4), (2, 5), (1, 0)):
        found = pictures.trimap(camera, frame)
        assert found is not None
        assert np.unique(found).tolist() == [10 * frame + camera]


def test_videos_can_be_opened_ahead(walk: Take, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Path] = []

    def note(path: Path) -> VideoIndex:
        opened.append(path)
        return index_video(path)

    monkeypatch.setattr(module, "index_video", note)
    pictures = TakePictures(walk, None)
    pictures.open()
    assert len(opened) == 8
    assert pictures.picture(7, 3) is not None
    assert len(opened) == 8
