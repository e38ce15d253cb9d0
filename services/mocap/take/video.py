"""Reads the frames of a video, in order or single ones. A damaged frame raises an error; none is left out."""

from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from itertools import chain, dropwhile, islice
from pathlib import Path
from typing import Self

import av
from av.container import InputContainer
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
        index, stamp = self.index, self.index.stamps[first]
        if index.is_counted:
            keyframe, decoding_stamp = index.keyframe_before(first)
            self._container.seek(decoding_stamp, stream=self._stream)
            decoder = _decoded(self._container.demux(self._stream))
            return decoder, next(islice(_to_the_end(decoder), first - keyframe, None), None)
        for packets in _beginnings(index, first, self._container, self._stream):
            decoder = _decoded(packets)
            at_or_after = (f for f in _to_the_end(decoder) if f.pts is not None and f.pts >= stamp)
            frame = next(at_or_after, None)
            if frame is not None and frame.pts == stamp:
                break
        return decoder, frame


def _decoded(packets: "Iterator[Packet[VideoStream]]") -> Iterator[VideoFrame]:
    for packet in packets:
        yield from packet.decode()


def _beginnings(
    index: VideoIndex, frame: int, container: InputContainer, stream: VideoStream
) -> "Iterator[Iterator[Packet[VideoStream]]]":
    """Ways to read packets from the keyframe of a frame on, or from an earlier one: one gives the frame.

    A seek in an MPEG program stream lands in the midst of a frame, and the next frame has that one's time:
    such a file is read from its start.
    """
    keyframe, decoding_stamp = index.keyframe_before(frame)
    stamp = index.stamps[keyframe]
    for begin_at in (stamp, decoding_stamp):  # some formats seek by decoding time
        first = None
        with suppress(av.error.FFmpegError):
            container.seek(begin_at, stream=stream)
            packets = container.demux(stream)
            first = next(packets, None)
        if first is not None and first.is_keyframe and _shown(first) <= stamp:
            yield chain([first], packets)
    try:
        container.seek(0)
    except av.error.FFmpegError:
        raise TakeError(f"{index.path}: frame {frame} cannot be decoded: {COPY_AGAIN}") from None
    yield dropwhile(
        lambda packet: _shown(packet) < stamp or (index.keyframes and not packet.is_keyframe),
        container.demux(stream),
    )


def _shown(packet: "Packet[VideoStream]") -> int:
    return (packet.dts or 0) if packet.pts is None else packet.pts


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
        if self._index.is_counted or frame in self._index.repeats:
            with VideoReader(self._index, frame, frame + 1, self._colour, self._size_px) as reader:
                return next(iter(reader))
        keyframe, _ = self._index.keyframe_before(frame)
        if self._next is not None and keyframe <= self._next <= frame:
            found = self._find(frame)
        else:
            found = self._find_anew(frame)
        if found is None:
            raise TakeError(f"{self._index.path}: frame {frame} cannot be decoded: {COPY_AGAIN}")
        self._next = frame + 1
        picture = bgr_picture(found, self._converter, self._size_px)
        return picture if self._colour is None else self._colour.apply(picture)

    def _find_anew(self, frame: int) -> VideoFrame | None:
        """A frame, reading from the keyframe before it; None if it was not found."""
        for packets in _beginnings(self._index, frame, self._container, self._stream):
            self._packets = packets
            self._decoded.clear()
            if (found := self._find(frame)) is not None:
                return found
        return None

    def _find(self, frame: int) -> VideoFrame | None:
        """A frame, reading on; None if it was not found."""
        self._next, stamp = None, self._index.stamps[frame]
        with suppress(av.error.FFmpegError, StopIteration):
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
