"""The cameras' pictures and silhouettes, if there are any, frame by frame in any order."""

import threading
import zlib
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Generic, Protocol, TypeVar

import numpy as np

from proto.messages import Silhouettes
from services.blob_store import keep_latest
from services.mocap.camera.rig import Rig
from services.mocap.camera.undistort import Undistorter
from services.mocap.energy.bitplanes import TriPlanes, fit_together, unpack_classes, unpack_trimaps
from services.mocap.take.folder import Take
from services.mocap.types import Bytes, Trimap

Content = TypeVar("Content")
_SPARED_FRAMES = 24
"""From this many skipped frames on, it is faster to reopen the video."""


@dataclass(frozen=True, eq=False)
class Segmented:
    """What the tracker gets of one camera's picture."""

    trimap: Trimap
    """(h, w)"""
    classes: Bytes | None = None
    """(h, w) the colour class of every actor pixel, 0 for none; None if no classes are known."""


Segment = Callable[[int, int], Iterator[Sequence[Segmented]]]
"""What all cameras show, undistorted, from a frame up to but not including another."""


class Pictures(Protocol):
    """The undistorted pictures and silhouettes of a rig's cameras. Only one thread at a time may call it."""

    def picture(self, camera: int, frame: int) -> Bytes | None:
        """(h, w, 3); None if there is none."""

    def segmented(self, camera: int, frame: int) -> Segmented | None:
        """The silhouette and colour classes; None if there is no silhouette."""


class Reader(Generic[Content]):
    """Reads a stream in order, and reopens it to go back or to jump."""

    def __init__(self, begin: Callable[[int], Iterator[Content]]) -> None:
        """begin: opens the stream at a frame."""
        self._begin = begin
        self._stream: Iterator[Content] = iter(())
        self._next: int | None = None
        self._last: tuple[int, Content] | None = None

    def read(self, frame: int) -> Content:
        """The content at a frame; raises what the stream raises, StopIteration beyond its end."""
        if self._last is not None and self._last[0] == frame:
            return self._last[1]
        at = self._next
        if at is None or frame < at or frame >= at + _SPARED_FRAMES:
            self._stream, at = self._begin(frame), frame
        self._next = None  # until reading has succeeded
        for _ in range(at, frame):
            next(self._stream)
        self._last = frame, next(self._stream)
        self._next = frame + 1
        return self._last[1]


class TakePictures:
    """A take folder's pictures and silhouettes."""

    def __init__(self, take: Take, segment: Segment | None, shown: Mapping[int, int] | None = None) -> None:
        """segment: makes the silhouettes of takes without any; None: no silhouettes. shown: the take's frame
        that a frame of the results shows, where they differ (PoseTable.frames_shown)."""
        self._take, self._segment, self._shown = take, segment, shown or {}
        self._lock = threading.Lock()
        self._video = cache(self._open_video)
        self._segmented = Reader(self._segmented_from)

    def open(self) -> None:
        """Open all videos before the first picture is needed; raises TakeError."""
        for c, camera in enumerate(self._take.cameras):
            if self._take.has_video(camera):
                with self._lock:
                    self._video(c)

    def picture(self, camera: int, frame: int) -> Bytes | None:
        """See Pictures.picture."""
        if not self._take.has_video(self._take.cameras[camera]):
            return None
        with self._lock:
            return self._video(camera)(self._shown.get(frame, frame))

    def _open_video(self, c: int) -> Callable[[int], Bytes]:
        """What reads a camera's undistorted picture (h, w, 3) of a frame and keeps the last one."""
        take, camera = self._take, self._take.cameras[c]
        picker, undistorter = take.picker(camera), Undistorter(camera)
        ahead = take.settings.offset(camera.name)
        return lru_cache(1)(lambda frame: undistorter.image(picker.read(frame + ahead)))

    def segmented(self, camera: int, frame: int) -> Segmented | None:
        """See Pictures.segmented."""
        if self._take.source == "videos" and self._segment is None:
            return None
        with self._lock:
            return self._segmented.read(self._shown.get(frame, frame))[camera]

    def _segmented_from(self, start: int) -> Iterator[Sequence[Segmented]]:
        take = self._take
        if take.source == "videos" and self._segment is not None:
            yield from self._segment(start, take.settings.frames)
            return
        undistorters = [Undistorter(camera) for camera in take.cameras]
        readers = [take.trimaps(camera, start) for camera in take.cameras]
        for trimaps in zip(*readers, strict=True):
            yield [Segmented(undo.trimap(raw)) for undo, raw in zip(undistorters, trimaps, strict=True)]


_KEPT_FRAMES = 512
"""Number of frames whose packed silhouettes and classes are kept; 10 to 50 kilobytes each."""
_SILHOUETTES_WAIT_S = 0.3
"""How long a page waits for silhouettes; the coordinator answers between two of its own steps."""


class LivePictures:
    """See Pictures. Silhouettes exist for frames that a page showed while they were new."""

    def __init__(self, rig: Rig, folder: TakePictures | None, ask: Callable[[int], None]) -> None:
        """folder: the take folder, if it is on this host. ask: requests a frame's silhouettes from the
        coordinator."""
        self._rig, self._folder, self._ask = rig, folder, ask
        self._packed: OrderedDict[int, dict[int, tuple[bytes, ...]]] = OrderedDict()
        """By frame and camera the trimap, and the classes if they are known."""
        self._asked: OrderedDict[int, None] = OrderedDict()
        self._came = threading.Condition()

    def picture(self, camera: int, frame: int) -> Bytes | None:
        """See Pictures.picture."""
        return None if self._folder is None else self._folder.picture(camera, frame)

    def segmented(self, camera: int, frame: int) -> Segmented | None:
        """See Pictures.segmented."""
        here = None if self._folder is None else self._folder.segmented(camera, frame)
        if here is not None:
            return here
        with self._came:
            if frame not in self._asked and frame not in self._packed:
                keep_latest(self._asked, frame, None, _KEPT_FRAMES)
                self._ask(frame)
                all_here = self._rig.n_cameras
                self._came.wait_for(lambda: len(self._packed.get(frame, {})) == all_here, _SILHOUETTES_WAIT_S)
            packed = self._packed.get(frame, {}).get(camera)
        width, height = self._rig.sizes_px[camera].tolist()
        if packed is None:
            return None
        return Segmented(
            *(np.frombuffer(zlib.decompress(one), np.uint8).reshape(height, width) for one in packed)
        )

    def add(self, message: Silhouettes) -> None:
        """Add silhouettes of some cameras; those that do not fit the rig are ignored."""
        cameras = message.cameras
        sent = message.planes, message.unsure, message.classes
        fits = fit_together(*sent, len(cameras), self._rig.shape_px)
        if max(cameras) >= self._rig.n_cameras or not fits:
            return
        planes = TriPlanes.of_sent(*sent)
        with self._came:
            if message.frame not in self._asked:
                return
            frame = self._packed.setdefault(message.frame, {})
            layers = [unpack_trimaps(planes, len(cameras))]
            if planes.classes is not None:
                layers.append(unpack_classes(planes.classes, len(cameras)))
            for camera, *of_camera in zip(cameras, *layers, strict=True):
                width, height = self._rig.sizes_px[camera].tolist()
                frame[camera] = tuple(zlib.compress(one[:height, :width].tobytes(), 1) for one in of_camera)
            while len(self._packed) > _KEPT_FRAMES:
                self._packed.popitem(last=False)
            self._came.notify_all()
