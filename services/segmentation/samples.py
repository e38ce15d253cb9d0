"""Pictures spread over a camera's video, by which what does not move is told from what does."""

from collections.abc import Iterable, Iterator

import cv2
import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.take import layout
from services.mocap.take.folder import Take
from services.mocap.take.video import VideoIndex, index_video
from services.mocap.types import Bytes

_LOOK_WIDTH_PX = 160
_MOST_DECODED = 48
"""Frames that quick looks decode, in all."""


def spread_pictures(take: Take, camera: Camera, most: int) -> Bytes:
    """Up to so many raw pictures (N, H, W, 3) of a camera, from the first frame to the last."""
    index, first = _index_of(take, camera)
    frames = take.settings.frames
    keys = [key - first for key, _ in index.keyframes if first <= key < first + frames]
    if len(keys) >= most:  # these need no other frame to be decoded
        pictures = []
        for key in (keys[i] for i in _spread(len(keys), most)):
            with take.video(camera, key, key + 1, index) as video:
                pictures += list(video)
        return np.array(pictures)
    wanted = set(_spread(frames, most))
    with take.video(camera, 0, frames, index) as video:
        return np.array([picture for frame, picture in enumerate(video) if frame in wanted])


def quick_looks(take: Take, camera: Camera, most: int) -> Bytes:
    """Up to so many small copies (N, h, w, 3) of a camera's raw pictures, of which few need to be decoded.

    Keyframes, and where there are too few of them, frames soon after each.
    """
    index, first = _index_of(take, camera)
    end = take.settings.frames
    begins = [key - first for key, _ in index.keyframes if first < key < first + end]
    runs = [range(*ends) for ends in zip([0, *begins], [*begins, end], strict=True)]
    runs = [runs[i] for i in _spread(len(runs), most)]
    each, longest = -(-most // len(runs)), max(1, _MOST_DECODED // len(runs))
    pictures: list[Bytes] = []
    for run in runs:
        wanted = _spread(min(len(run), longest), each)
        with take.video(camera, run.start, run.start + wanted[-1] + 1, index) as video:
            pictures += [shrunk(picture) for n, picture in enumerate(video) if n in wanted]
    return np.array(pictures)


class KeptLooks:
    """Small copies of some of the pictures that go by, evenly spread, however many there will be."""

    def __init__(self, fewest: int) -> None:
        """Fewest: how many are kept at least of so many or more; never more than twice as many."""
        self._fewest, self._every = fewest, 1
        self._kept: list[Bytes] = []

    def of(self, pictures: Iterable[Bytes]) -> Iterator[Bytes]:
        """The very pictures (H, W, 3), looked at as they go by."""
        for n, picture in enumerate(pictures):
            if n % self._every == 0:
                self._kept.append(shrunk(picture))
                if len(self._kept) == 2 * self._fewest:
                    self._kept, self._every = self._kept[::2], 2 * self._every
            yield picture

    @property
    def pictures(self) -> Bytes:
        """(N, h, w, 3)"""
        return np.array(self._kept)


def shrunk(picture: Bytes) -> Bytes:
    """A picture (H, W, 3), or a smaller one of it that shows people no worse."""
    share = _LOOK_WIDTH_PX / picture.shape[1]
    if share >= 1:
        return picture
    return np.asarray(cv2.resize(picture, None, fx=share, fy=share, interpolation=cv2.INTER_AREA), np.uint8)


def _index_of(take: Take, camera: Camera) -> tuple[VideoIndex, int]:
    """A camera's video, and which of its frames is the take's first."""
    index = index_video(layout.video_path(take.folder, camera.name))
    return index, take.settings.offset(camera.name)


def _spread(count: int, most: int) -> list[int]:
    """Up to `most` of the numbers 0 to count - 1, evenly, the first and the last among them."""
    return [int(i) for i in np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))]
