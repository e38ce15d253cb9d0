"""Reads the frames of a video, in order or single ones. A damaged frame raises an error; none is left out."""

from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Self

import av
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream

from services.mocap.camera.colour import ColourCorrection
from services.mocap.errors import TakeError
from services.mocap.take.video_index import (
    COPY_AGAIN,
    VideoIndex,
    bgr_picture,
    index_video,
    opened_video,
    video_stream,
)
from services.mocap.types import Bytes


class VideoReader:
    """The frames of a video as BGR (H, W, 3) uint8, from `start` up to but not including `stop` (default:
    all).

    Each iteration starts again at `start`, so `enumerate(reader, start)` gives frame numbers. Colours go
    through FFmpeg's fast conversion, whose rounding lowers all values by 1 to 1.5 grey levels. Use it as a
    context manager, or close it. Iterating raises TakeError at a frame that cannot be decoded.
    """

    def __init__(
        self,
        video: Path | VideoIndex,
        start: int = 0,
        stop: int | None = None,
        colour: ColourCorrection | None = None,
        size_px: tuple[int, int] | None = None,
    ) -> None:
        """colour: the correction of the pictures, if any. size_px: width and height to which they are
        reduced."""
        self.index = index_video(video) if isinstance(video, Path) else video
        self.start, self.colour = start, colour
        self._size_px = self.index.reduction_to(size_px)
        self.stop = self.index.n_frames if stop is None else stop
        if not 0 <= self.start <= self.stop <= self.index.n_frames:
            raise TakeError(
                f"{self.index.path}: frames {self.start} to {self.stop} were requested, "
                f"but it has {self.index.n_frames}"
            )
        self._container = opened_video(self.index.path)
        self._stream = video_stream(self._container, self.index.path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Bytes]:
        converter = VideoReformatter()
        pictures = (bgr_picture(frame, converter, self._size_px) for frame in self._frames())
        return pictures if self.colour is None else map(self.colour.apply, pictures)

    def close(self) -> None:
        """Closes the file, which ends any iteration."""
        self._container.close()

    def check(self) -> None:
        """Decodes every frame, without making pictures of them; raises TakeError at the first bad one."""
        for _ in self._frames():
            pass

    def _frames(self) -> Iterator[VideoFrame]:
        if self.start == self.stop:
            return
        index, first = self.index, self.start
        while first in index.repeats and first > 0:
            first -= 1
        decoder, frame = self._begun(first)
        shown: VideoFrame | None = None
        for expected in range(first, self.stop):
            if frame is not None and (index.is_counted or frame.pts == index.stamps[expected]):
                shown, frame = frame, None
            elif expected not in index.repeats:
                shown = None
            if shown is None or shown.is_corrupt:
                raise TakeError(f"{index.path}: frame {expected} cannot be decoded: {COPY_AGAIN}")
            if expected >= self.start:
                yield shown
            if frame is None and expected + 1 < self.stop:
                frame = _next_of(decoder)

    def _begun(self, first: int) -> tuple[Iterator[VideoFrame], VideoFrame | None]:
        """A decoder, and the first frame that it gave at or after the number `first`."""
        keyframe, decoding_stamp = self.index.keyframe_before(first)
        if self.index.is_counted:
            decoder = self._decoder(decoding_stamp)
            return decoder, next(islice(_to_the_end(decoder), first - keyframe, None), None)
        for begin_at in (self.index.stamps[keyframe], decoding_stamp):  # some formats seek by decoding time
            decoder = self._decoder(begin_at)
            at_or_after = (
                f for f in _to_the_end(decoder) if f.pts is None or f.pts >= self.index.stamps[first]
            )
            frame = next(at_or_after, None)
            if frame is not None and frame.pts == self.index.stamps[first]:
                break
        return decoder, frame

    def _decoder(self, begin_at: int) -> Iterator[VideoFrame]:
        self._container.seek(begin_at, stream=self._stream)
        return self._container.decode(self._stream)


def _to_the_end(decoder: Iterator[VideoFrame]) -> Iterator[VideoFrame]:
    """Frames until the end, or until nothing can be decoded."""
    while (frame := _next_of(decoder)) is not None:
        yield frame


def _next_of(decoder: Iterator[VideoFrame]) -> VideoFrame | None:
    """None at the end, or if nothing can be decoded."""
    try:
        return next(decoder, None)
    except av.error.FFmpegError:
        return None


class PicturePicker:
    """Reads single pictures in any order, without decoding all pictures between them.

    For one thread at a time. It keeps the file open.
    """

    def __init__(
        self,
        index: VideoIndex,
        colour: ColourCorrection | None = None,
        size_px: tuple[int, int] | None = None,
    ) -> None:
        """colour: the correction of the pictures, if any. size_px: width and height to which they are
        reduced. Raises TakeError where the file cannot be opened."""
        self._index, self._colour, self._size_px = index, colour, index.reduction_to(size_px)
        self._container = opened_video(index.path)
        self._stream = video_stream(self._container, index.path)
        self._converter = VideoReformatter()
        self._packets: Iterator[Packet[VideoStream]] = iter(())
        self._decoded: deque[VideoFrame] = deque()
        self._next: int | None = None

    def read(self, frame: int) -> Bytes:
        """A frame's picture, BGR (H, W, 3); raises TakeError where it cannot be decoded."""
        if not 0 <= frame < self._index.n_frames:
            raise TakeError(f"{self._index.path}: has no frame {frame}, but {self._index.n_frames} frames")
        while frame in self._index.repeats and frame > 0:
            frame -= 1
        keyframe, decoding_stamp = self._index.keyframe_before(frame)
        if self._index.is_counted:
            with VideoReader(self._index, frame, frame + 1, self._colour, self._size_px) as reader:
                return next(iter(reader))
        if self._next is not None and keyframe <= self._next <= frame:
            found = self._find(frame)
        else:  # some formats seek by presentation time, others by decoding time
            found = self._find(frame, self._index.stamps[keyframe]) or self._find(frame, decoding_stamp)
        if found is None:
            raise TakeError(f"{self._index.path}: frame {frame} cannot be decoded: {COPY_AGAIN}")
        self._next = frame + 1
        picture = bgr_picture(found, self._converter, self._size_px)
        return picture if self._colour is None else self._colour.apply(picture)

    def _find(self, frame: int, begin_at: int | None = None) -> VideoFrame | None:
        """A frame, reading on or from the keyframe at a stamp; None if it was not found."""
        self._next, stamp = None, self._index.stamps[frame]
        with suppress(av.error.FFmpegError, StopIteration):
            if begin_at is not None:
                self._container.seek(begin_at, stream=self._stream)
                self._packets = self._container.demux(self._stream)
                self._decoded.clear()
            while True:
                while self._decoded:
                    found = self._decoded.popleft()
                    if found.pts is not None and found.pts >= stamp:
                        return found if found.pts == stamp and not found.is_corrupt else None
                self._decode(next(self._packets), stamp)
        return None

    def _decode(self, packet: "Packet[VideoStream]", wanted: int) -> None:
        """Decode a packet, unless its picture precedes the wanted one and no other picture depends on it."""
        is_before = packet.pts is not None and packet.pts < wanted
        self._stream.codec_context.skip_frame = "NONREF" if is_before else "DEFAULT"
        self._decoded.extend(packet.decode())
