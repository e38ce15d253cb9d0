"""What the cameras saw, frame by frame in any order: pictures and silhouettes, where there are any."""

import threading
from collections.abc import Callable, Iterator
from typing import Generic, Protocol, TypeVar

from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import Undistorter
from services.mocap.take import layout
from services.mocap.take.folder import Take
from services.mocap.take.video import index_video
from services.mocap.types import Bytes, Mask

Content = TypeVar("Content")
_SPARED_FRAMES = 24
"""Where so many frames need not be read, it is worth to begin anew."""
Silhouettes = Callable[[Camera, int, int], Iterator[Mask]]
"""Undistorted masks (h, w) of a camera, from a frame up to and without another."""


class Pictures(Protocol):
    """What the cameras of a rig saw; everything undistorted. To be called by one thread at a time."""

    def picture(self, camera: int, frame: int) -> Bytes | None:
        """(h, w, 3); None where there is none."""
        ...

    def silhouette(self, camera: int, frame: int) -> Mask | None:
        """(h, w); None where there is none."""
        ...


class Reader(Generic[Content]):
    """Reads something in order, and turns back or jumps where somebody wants another place."""

    def __init__(
        self, begin: Callable[[int], Iterator[Content]], read_from: Callable[[int], int] = lambda frame: frame
    ) -> None:
        """Begin: what follows from a frame on. read_from: where that starts reading, such as a keyframe."""
        self._begin, self._read_from = begin, read_from
        self._stream: Iterator[Content] = iter(())
        self._next: int | None = None
        self._last: tuple[int, Content] | None = None

    def read(self, frame: int) -> Content:
        """What there is at a frame; raises what the stream raises, StopIteration beyond its end."""
        if self._last is not None and self._last[0] == frame:
            return self._last[1]
        at = self._next
        if at is None or frame < at or self._read_from(frame) >= at + _SPARED_FRAMES:
            self._stream, at = self._begin(frame), frame
        self._next = None  # until all went well
        for _ in range(at, frame):
            next(self._stream)
        self._last = frame, next(self._stream)
        self._next = frame + 1
        return self._last[1]


class TakePictures:
    """A take folder's pictures and silhouettes."""

    def __init__(self, take: Take, silhouettes: Silhouettes | None) -> None:
        """silhouettes: makes those of takes that have none; None: then there are none."""
        self._take, self._segment = take, silhouettes
        self._lock = threading.Lock()
        self._pictures: dict[int, Reader[Bytes]] = {}
        self._masks: dict[int, Reader[Mask]] = {}

    def picture(self, camera: int, frame: int) -> Bytes | None:
        """See Pictures.picture."""
        if not self._take.has_video(self._take.cameras[camera]):
            return None
        with self._lock:
            if camera not in self._pictures:
                self._pictures[camera] = self._video_of(self._take.cameras[camera])
            return self._pictures[camera].read(frame)

    def _video_of(self, camera: Camera) -> Reader[Bytes]:
        index = index_video(layout.video_path(self._take.folder, camera.name))
        undistorter, end = Undistorter(camera), self._take.settings.frames

        def undistorted(start: int) -> Iterator[Bytes]:
            with self._take.video(camera, start, end, index) as video:
                yield from map(undistorter.image, video)

        return Reader(undistorted, lambda frame: index.keyframe_before(frame)[0])

    def silhouette(self, camera: int, frame: int) -> Mask | None:
        """See Pictures.silhouette."""
        if self._take.source == "videos" and self._segment is None:
            return None
        with self._lock:
            if camera not in self._masks:
                self._masks[camera] = Reader(self._masks_of(self._take.cameras[camera]))
            return self._masks[camera].read(frame)

    def _masks_of(self, camera: Camera) -> Callable[[int], Iterator[Mask]]:
        take, segment = self._take, self._segment
        if take.source == "videos" and segment is not None:
            return lambda start: segment(camera, start, take.settings.frames)
        undistorter = Undistorter(camera)
        return lambda start: (undistorter.mask(mask) for mask in take.silhouettes(camera, start))
