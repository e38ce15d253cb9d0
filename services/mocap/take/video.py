"""Reads videos: the index of a file, found by reading all its packets, and its frames in order.

A frame's number is its position in presentation order, found from time stamps, so that it is exact even if
reading starts in the middle of a file. A missing or damaged frame raises an error; none is skipped.
"""

from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

import av
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream

from services.mocap.camera.colour import ColourCorrection
from services.mocap.errors import TakeError
from services.mocap.types import Bytes, Floats

COPY_AGAIN = "copy or record it again"


@dataclass(frozen=True)
class VideoIndex:
    """The index of a video file."""

    path: Path
    width_px: int
    height_px: int
    """Size of the upright pictures."""
    times_s: Floats
    """(N,) presentation time of every frame, increasing."""
    stamps: tuple[int, ...]
    """The same times in the file's own units."""
    keyframes: tuple[tuple[int, int], ...]
    """(frame number, decoding stamp) of the frames at which decoding can start."""

    @property
    def n_frames(self) -> int:
        """Number of frames in the file."""
        return len(self.stamps)

    def keyframe_before(self, frame: int) -> tuple[int, int]:
        """The last keyframe (its number, its decoding stamp) at or before a frame."""
        return max((key for key in self.keyframes if key[0] <= frame), default=(0, 0))


def index_video(path: Path) -> VideoIndex:
    """Reads all packets and decodes one picture.

    Raises TakeError if the file is missing, contains no video or is cut off.
    """
    packets, declared, unit_s = _demuxed(path)
    if (
        len(packets) < declared
    ):  # cut off, or an edit list hides frames; only counting all packets shows which
        packets_in_file, *_ = _demuxed(path, {"ignore_editlist": "1"})
    else:
        packets_in_file = packets
    whole = sum(packet.is_whole for packet in packets_in_file)
    if whole < max(declared, len(packets_in_file), 1):
        raise TakeError(f"{path}: cut off after {whole} of {max(declared, whole)} frames: {COPY_AGAIN}")
    stamps = sorted(packet.shown for packet in packets if not packet.is_hidden)
    keyframes = sorted((bisect_left(stamps, p.shown), p.decoded) for p in packets if p.is_key)
    height, width = _first_picture(path).shape[:2]
    return VideoIndex(path, width, height, np.array(stamps) * unit_s, tuple(stamps), tuple(keyframes))


class _Packet(NamedTuple):
    """The parts of a packet for the index, without its data."""

    shown: int
    decoded: int
    is_key: bool
    is_whole: bool
    is_hidden: bool
    """Decoded only because other frames need it, according to the file's edit list."""

    @classmethod
    def of(cls, packet: "av.Packet[VideoStream]") -> "_Packet":
        decoded = packet.dts or 0
        shown = decoded if packet.pts is None else packet.pts
        return cls(shown, decoded, packet.is_keyframe, not packet.is_corrupt, packet.is_discard)


def _demuxed(path: Path, options: dict[str, str] | None = None) -> tuple[list[_Packet], int, float]:
    """All packets of the video, their number declared by the file, and the time stamps' unit in seconds."""
    with opened_video(path, options) as container:
        stream = video_stream(container, path)
        try:
            packets = [_Packet.of(packet) for packet in container.demux(stream) if packet.size]
        except av.error.FFmpegError:
            raise TakeError(f"{path}: is damaged: {COPY_AGAIN}") from None
        return packets, stream.frames, float(stream.time_base or 0)


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
    ) -> None:
        """colour: the correction of the pictures, if any."""
        self.index = index_video(video) if isinstance(video, Path) else video
        self.start, self.colour = start, colour
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __len__(self) -> int:
        return self.stop - self.start

    def __iter__(self) -> Iterator[Bytes]:
        converter = VideoReformatter()
        pictures = (bgr_picture(frame, converter) for frame in self._frames())
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
        stamps = self.index.stamps
        keyframe, decoding_stamp = self.index.keyframe_before(self.start)
        decoder, frame = self._begun(stamps[keyframe])
        if frame is None or frame.pts != stamps[self.start]:
            decoder, frame = self._begun(decoding_stamp)  # some formats seek by decoding time
        for expected in range(self.start, self.stop):
            if expected > self.start:
                frame = _next_of(decoder)
            if frame is None or frame.pts != stamps[expected] or frame.is_corrupt:
                raise TakeError(f"{self.index.path}: frame {expected} cannot be decoded: {COPY_AGAIN}")
            yield frame

    def _begun(self, begin_at: int) -> tuple[Iterator[VideoFrame], VideoFrame | None]:
        """A decoder from the keyframe at a stamp, and the first frame not before the start."""
        self._container.seek(begin_at, stream=self._stream)
        decoder = self._container.decode(self._stream)
        while True:
            frame = _next_of(decoder)
            if frame is None or frame.pts is None or frame.pts >= self.index.stamps[self.start]:
                return decoder, frame


def _next_of(decoder: Iterator[VideoFrame]) -> VideoFrame | None:
    """None at the end, or if nothing can be decoded."""
    try:
        return next(decoder, None)
    except av.error.FFmpegError:
        return None


def opened_video(path: Path, options: dict[str, str] | None = None) -> InputContainer:
    """Open a video file; raises TakeError if it is missing or cannot be read."""
    try:
        return av.open(str(path), "r", options=options)
    except FileNotFoundError:
        raise TakeError(f"{path}: is missing: expected a video") from None
    except (av.error.FFmpegError, OSError):
        raise TakeError(
            f"{path}: cannot be read as a video (empty, cut off before its index, no video): {COPY_AGAIN}"
        ) from None


def video_stream(container: InputContainer, path: Path) -> VideoStream:
    """The first video stream, decoded on one thread; raises TakeError if there is none."""
    if not container.streams.video:
        raise TakeError(f"{path}: contains no video stream: expected a video")
    stream = container.streams.video[0]
    stream.thread_type = "NONE"  # the services share the cores: more threads would only compete for them
    return stream


def _first_picture(path: Path) -> Bytes:
    """The first picture that can be decoded, upright."""
    with opened_video(path) as container:
        try:
            frame = next(container.decode(video_stream(container, path)), None)
        except av.error.FFmpegError:
            frame = None
        if frame is None:
            raise TakeError(f"{path}: frame 0 cannot be decoded: {COPY_AGAIN}")
        return bgr_picture(frame, VideoReformatter())


def bgr_picture(frame: VideoFrame, converter: VideoReformatter) -> Bytes:
    """A decoded frame as BGR (H, W, 3), rotated by the file's metadata: cameras held upright store rotated
    pictures."""
    bgr: Bytes = np.asarray(converter.reformat(frame, format="bgr24", threads=1).to_ndarray(), np.uint8)
    quarter_turns = round(frame.rotation / 90) % 4
    return np.ascontiguousarray(np.rot90(bgr, quarter_turns)) if quarter_turns else bgr
