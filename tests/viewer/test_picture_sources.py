"""Pictures and silhouettes in any order are those that reading in order gives."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from proto.messages import Silhouettes
from services.mocap.camera.rig import Rig
from services.mocap.camera.undistort import Undistorter
from services.mocap.energy.bitplanes import TriPlanes, pack, pack_classes
from services.mocap.take.folder import Take
from services.mocap.take.video_index import VideoIndex, index_video
from services.mocap.types import ACTOR
from services.viewer.picture_sources import LivePictures, Reader, Segmented, TakePictures


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
    assert pictures.segmented(2, 3) is None  # nobody makes any


def test_silhouettes_that_somebody_makes(walk: Take) -> None:
    pictures = TakePictures(
        walk,
        lambda start, stop: (
            [Segmented(np.full((2, 3), 10 * f + c, np.uint8)) for c in range(len(walk.cameras))]
            for f in range(start, stop)
        ),
    )
    for camera, frame in ((0, 4), (2, 4), (2, 5), (1, 0)):
        found = pictures.segmented(camera, frame)
        assert found is not None
        assert np.unique(found.trimap).tolist() == [10 * frame + camera]


def test_videos_can_be_opened_ahead(walk: Take, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Path] = []

    def note(path: Path) -> VideoIndex:
        opened.append(path)
        return index_video(path)

    monkeypatch.setattr("services.mocap.take.folder.index_video", note)
    pictures = TakePictures(walk, None)
    pictures.open()
    assert len(opened) == 8
    assert pictures.picture(7, 3) is not None
    assert len(opened) == 8


def test_classes_that_a_coordinator_sends_are_kept_with_their_silhouettes(walk: Take) -> None:
    rig = Rig.of(walk.cameras)
    rng = np.random.default_rng(3)
    classes = rng.integers(0, 8, (2, *rig.shape_px), np.uint8)
    planes = TriPlanes(pack(classes > 0), np.zeros((1, *rig.shape_px), np.uint8), pack_classes(classes))

    def answer(frame: int) -> None:
        sent = {"planes": planes.silhouettes, "unsure": planes.unsure, "classes": planes.sent_classes}
        for cameras in ([3, 0], [1]):
            pictures.add(Silhouettes(take="walk", run="0" * 32, frame=frame, cameras=cameras, **sent))

    pictures = LivePictures(rig, None, answer)
    for camera, place in ((3, 0), (0, 1), (1, 0)):
        found = pictures.segmented(camera, 5)
        assert found is not None and found.classes is not None
        np.testing.assert_array_equal(found.classes, classes[place])
        np.testing.assert_array_equal(found.trimap == ACTOR, classes[place] > 0)
    assert pictures.segmented(2, 5) is None
