"""Reads the frames of a video, in order or single ones. A damaged frame raises an error; none is left out."""

from collections.abc import Iterator
from contextlib import suppress
from itertools import chain, dropwhile, islice
from pathlib import Path
from typing import Self, TypeAlias

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

_Stamped: TypeAlias = tuple[int, VideoFrame]
"""A frame with its time stamp in the index."""


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
        self._converter = VideoReformatter()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Bytes]:
        pictures = (bgr_picture(frame, self._converter, self._size_px) for frame in self._frames())
        return pictures if self.colour is None else map(self.colour.apply, pictures)

    def close(self) -> None:
        """Closes the file, which ends any iteration."""
        self._container.close()

    def check(self) -> None:
        """Decodes every frame, without making pictures of them; raises TakeError at the first bad one."""
        for _ in self._frames():
            pass

    def _frames(self) -> Iterator[VideoFrame]:
        """Frames from `start` on. If `start` is moved ahead meanwhile, those before it are left out."""
        if self.start == self.stop:
            return
        index, number = self.index, self.start
        frames = self._begun(self._coded(number))
        shown, ahead = None, None
        while number < self.stop:
            stamp, earliest = index.stamps[number], index.stamps[self._coded(number)]
            while shown is None or shown[0] < stamp:
                ahead = ahead or next(frames, None)
                if ahead is None or ahead[0] > stamp:
                    break
                shown, ahead = ahead, None
            if shown is None or shown[0] < earliest or shown[1].is_corrupt:
                raise TakeError(f"{index.path}: frame {number} cannot be decoded: {COPY_AGAIN}")
            yield shown[1]
            number = max(number + 1, self.start)

    def _coded(self, number: int) -> int:
        """The last frame up to a number whose picture the file certainly holds."""
        while number in self.index.repeats and number > 0:
            number -= 1
        return number

    def _begun(self, first: int) -> Iterator[_Stamped]:
        """Frames from the number `first` on, or from an earlier one; none if it cannot be decoded."""
        index, stamp = self.index, self.index.stamps[first]
        if index.is_counted:
            keyframe, decoding_stamp = index.keyframe_before(first)
            self._container.seek(decoding_stamp, stream=self._stream)
            decoded = self._decoded(self._container.demux(self._stream))
            return zip(islice(index.stamps, keyframe, None), decoded, strict=False)
        for packets in _beginnings(index, first, self._container, self._stream):
            decoded = self._decoded(packets)
            stamped = ((frame.pts, frame) for frame in decoded if frame.pts is not None)
            later = dropwhile(lambda of_frame: of_frame[0] < stamp, stamped)
            found = next(later, None)
            if found is not None and found[0] == stamp:
                return chain([found], later)
        return iter(())

    def _decoded(self, packets: "Iterator[Packet[VideoStream]]") -> Iterator[VideoFrame]:
        """Frames until the end, or until nothing can be decoded; those are left out that precede the one
        wanted, and on which no other depends."""
        index, context = self.index, self._stream.codec_context
        with suppress(av.error.FFmpegError):
            for packet in packets:
                wanted = index.stamps[self._coded(self.start)]
                is_before = not index.is_counted and packet.pts is not None and packet.pts < wanted
                context.skip_frame = "NONREF" if is_before else "DEFAULT"
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
        self._reader = VideoReader(index, colour=colour, size_px=size_px)
        self._pictures: Iterator[Bytes] = iter(())
        self._next: int | None = None
        """The number of the next one of these pictures; None where there is none."""

    def read(self, frame: int) -> Bytes:
        """A frame's picture, BGR (H, W, 3); raises TakeError where it cannot be decoded."""
        index = self._reader.index
        if not 0 <= frame < index.n_frames:
            raise TakeError(f"{index.path}: has no frame {frame}, but {index.n_frames} frames")
        begin, _ = index.keyframe_before(frame)
        if index.is_counted:
            begin += 1  # a frame that was lost before this keyframe would be missing in the count
        goes_on = self._next is not None and begin <= self._next <= frame
        self._reader.start, self._next = frame, None
        if not goes_on:
            self._pictures = iter(self._reader)
        picture = next(self._pictures)
        self._next = frame + 1
        return picture
