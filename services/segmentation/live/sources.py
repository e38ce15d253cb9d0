"""Where live pictures come from: devices, network streams, and files played at their own rate."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import TypeAlias

import av
import numpy as np
from av.container import InputContainer
from av.video.reformatter import VideoReformatter

from services.mocap.camera.camera import Camera
from services.mocap.errors import TakeError, UserError
from services.mocap.take.live_settings import LiveCamera
from services.mocap.take.video import VideoReader
from services.mocap.take.video_index import bgr_picture, index_video
from services.mocap.types import Bytes

_OPEN_S, _READ_S = 5.0, 1.5
"""How long a network source may be silent, while it is opened and afterwards, before it counts as lost."""
_SAME_CLOCK_S = 2.0
"""Time stamps this close to this machine's monotonic clock are on that clock, as from camera drivers."""
_LATE_S, _LATE_PICTURES = 0.4, 2
"""A file's picture that is unread for the sum of both is dropped for newer ones, as a camera would do."""
_MEET_S = 0.25
"""Files that drop pictures go on at multiples of about this time, so that several go on at the same
moment."""
_LEAK = 1e-3
"""How much slower a container's clock may run than ours, in seconds per second."""


class SourceLostError(Exception):
    """A source delivers no pictures; it may return. The text says why."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture of a source."""

    image: Bytes
    """BGR (H, W, 3)."""
    taken_s: float
    """When, on this machine's monotonic clock."""


class FileSource:
    """A video file played like a camera: each picture appears at its time.

    A file that is removed or replaced counts as an unplugged camera.
    """

    def __init__(
        self, path: Path, begin_s: float, stopped: Event, passed_over: Callable[[int], None] = lambda _: None
    ) -> None:
        """begin_s: the time of the file's first picture; earlier pictures are skipped. passed_over: called
        with the number of pictures that were not read in time."""
        self._stopped, self._path, self._passed_over = stopped, path, passed_over
        try:
            self._identity = _identity(path)
            self._index = index_video(path)
        except TakeError as problem:
            raise SourceLostError(str(problem)) from None
        self._due_s = begin_s + self._index.times_s - self._index.times_s[0]
        steps_s = np.diff(self._due_s)
        period_s = float(np.median(steps_s)) if len(steps_s) else _MEET_S
        self._late_s = _LATE_S + _LATE_PICTURES * period_s
        self._meet = max(1, round(_MEET_S / period_s))
        self._reader: VideoReader | None = None
        self._go_to(int((self._due_s < time.monotonic()).sum()))

    def _go_to(self, number: int) -> None:
        """Go to a picture; none if there are no more."""
        self.close()
        self._next = number
        self._reader = VideoReader(self._index, number) if number < self._index.n_frames else None
        self._frames = iter(self._reader) if self._reader is not None else iter(())

    def _leave_out_late_ones(self) -> None:
        now_s = time.monotonic()
        if now_s - self._due_s[self._next] < self._late_s:
            return
        number = -(-int((self._due_s < now_s).sum()) // self._meet) * self._meet
        number = min(number, self._index.n_frames)
        self._passed_over(number - self._next)
        if number == self._index.n_frames or self._index.keyframe_before(number)[0] > self._next:
            self._go_to(number)
        while self._next < number:
            next(self._frames)
            self._next += 1

    def read(self) -> Picture | None:
        """Wait for the next picture; None if none will follow. Raises SourceLostError."""
        try:
            if self._next < len(self._due_s):
                self._leave_out_late_ones()
            if self._next >= len(self._due_s):
                return None
            image = next(self._frames)
        except TakeError as problem:
            raise SourceLostError(str(problem)) from None
        due_s, self._next = float(self._due_s[self._next]), self._next + 1
        self._stopped.wait(max(due_s - time.monotonic(), 0.0))
        if _identity(self._path) != self._identity:
            raise SourceLostError(f"{self._path}: the file was replaced")
        return Picture(image, due_s)

    def close(self) -> None:
        """Close the file."""
        if self._reader is not None:
            self._reader.close()


def _identity(path: Path) -> tuple[int, int]:
    try:
        status = path.stat()
    except OSError as problem:
        raise SourceLostError(f"{path}: {problem.strerror}") from None
    return status.st_dev, status.st_ino


class StreamSource:
    """A V4L2 device, or an RTSP or HTTP stream."""

    def __init__(self, settings: LiveCamera, camera: Camera, fps: float) -> None:
        self._settings, self._clock = settings, ContainerClock()
        self._converter = VideoReformatter()
        try:
            self._container = _opened(settings.source, camera, fps)
            self._stream = self._container.streams.video[0]
        except (av.error.FFmpegError, OSError, IndexError) as problem:
            raise SourceLostError(f"{place_of(settings.source)}: {_reason(problem)}") from None
        self._stream.thread_type = "NONE"  # decoder threads would delay pictures
        self._frames = self._container.decode(self._stream)

    def read(self) -> Picture:
        """Wait for the next picture: a stream never ends permanently. Raises SourceLostError."""
        try:
            frame = next(self._frames, None)
            if frame is None:
                raise SourceLostError(f"{place_of(self._settings.source)}: the stream has ended")
            arrived_s = time.monotonic()
            image = bgr_picture(frame, self._converter)
        except (av.error.FFmpegError, OSError) as problem:
            raise SourceLostError(f"{place_of(self._settings.source)}: {_reason(problem)}") from None
        taken_s = arrived_s
        if self._settings.has_stamps and frame.time is not None:
            taken_s = self._clock.taken_s(frame.time, arrived_s)
        return Picture(image, taken_s - self._settings.delay_s)

    def close(self) -> None:
        """Close the device or the connection."""
        self._container.close()


Source: TypeAlias = FileSource | StreamSource


class ContainerClock:
    """Converts a container's time stamps to this machine's clock.

    No picture arrives before it is taken, so the fastest one gives the difference of the two clocks, except
    for the least delay, which delay_s may correct. A clock that steps back, as after a correction of the
    camera's time, is another one.
    """

    def __init__(self) -> None:
        self._offset_s: float | None = None
        self._heard_s = self._stamp_s = 0.0

    def taken_s(self, stamp_s: float, arrived_s: float) -> float:
        """When a picture with this stamp was taken, given its arrival time."""
        if abs(arrived_s - stamp_s) < _SAME_CLOCK_S and stamp_s > _SAME_CLOCK_S:
            return stamp_s
        offset_s = arrived_s - stamp_s
        if self._offset_s is not None and stamp_s >= self._stamp_s:
            leaked_s = self._offset_s + _LEAK * (arrived_s - self._heard_s)
            offset_s = min(offset_s, leaked_s)
        self._offset_s, self._heard_s, self._stamp_s = offset_s, arrived_s, stamp_s
        return stamp_s + offset_s


def _opened(source: int | str, camera: Camera, fps: float) -> InputContainer:
    if isinstance(source, int):
        size = f"{camera.width_px}x{camera.height_px}"
        options = {"video_size": size, "framerate": f"{fps:g}"}
        return av.open(f"/dev/video{source}", "r", format="v4l2", options=options)
    options = {"fflags": "nobuffer", "flags": "low_delay"}
    if source.startswith("rtsp"):
        options["rtsp_flags"] = "prefer_tcp"  # TCP loses nothing; some sources have only UDP
    return av.open(source, "r", options=options, timeout=(_OPEN_S, _READ_S))


def place_of(source: int | str) -> str:
    """A source for messages, without a password in its address."""
    if isinstance(source, int):
        return f"/dev/video{source}"
    scheme, _, rest = source.partition("://")
    return f"{scheme}://{rest.rpartition('@')[2]}" if rest else source


def _reason(problem: Exception) -> str:
    if isinstance(problem, IndexError):
        return "contains no video"
    number = getattr(problem, "errno", None)
    return os.strerror(number) if isinstance(number, int) and 0 < number < 200 else str(problem)


def check_file(source: LiveCamera, camera: Camera) -> None:
    """Raise UserError if a file cannot be played, or has another size than its camera."""
    if not source.is_file:
        return
    path = Path(str(source.source))
    if not path.exists():
        raise UserError(
            f"[cameras.{camera.name}] source: {path} is missing: correct the path, which is relative to the "
            "configuration"
        )
    try:
        index = index_video(path)
    except TakeError as problem:
        raise UserError(f"[cameras.{camera.name}] source: {problem}") from None
    check_size_of(str(source.source), camera, index.height_px, index.width_px)


def check_size_of(place: str, camera: Camera, height_px: int, width_px: int) -> None:
    """Raise UserError if pictures do not have the size for which their camera is calibrated."""
    if (height_px, width_px) != camera.shape_px:
        raise UserError(
            f"{place}: has pictures of {width_px}x{height_px} pixels, but [{camera.name}] was calibrated "
            f"with {camera.width_px}x{camera.height_px}: set the camera to that size or calibrate it anew"
        )
