"""The index of a video file, found by reading all its packets, and how files and pictures are opened.

A frame's number is its position in presentation order, found from time stamps, so that it is exact even if
reading starts in the middle of a file.
"""

import re
from bisect import bisect_left
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from math import ceil
from pathlib import Path
from typing import NamedTuple

import av
import numpy as np
from av.container import InputContainer
from av.stream import Disposition
from av.video.frame import VideoFrame
from av.video.reformatter import Interpolation, VideoReformatter
from av.video.stream import VideoStream

from services.mocap.errors import TakeError
from services.mocap.types import Bytes, Floats

COPY_AGAIN = "copy or record it again"
_LONGEST_NOT_CODED = 19
"""Bytes: an MPEG-4 packet up to this long may only say "as before", or be a B-frame of little movement."""
_REDUCING = Interpolation.AREA | 0x2000
"""FFmpeg's SWS_AREA with SWS_FULL_CHR_H_INT, without which it halves the colours' resolution once more."""
_INDICES_KEPT = 256
"""To read all packets takes as long as to read the file."""
_CODECS_WITH_NOT_CODED = ("mpeg4",)
_WHOLE_REFRESH = {
    "h264": re.compile(rb"\x00\x00\x01[\x05\x25\x45\x65]"),
    "hevc": re.compile(rb"\x00\x00\x01[\x26\x28]"),
}
"""By codec that stores frames out of order: how a picture begins (IDR) that none later looks back beyond."""


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
    repeats: frozenset[int] = frozenset()
    """Frames that the file may not code: if so, the picture before them is shown again."""
    is_turned: bool = False
    """Whether the file's rotation tag turns its stored pictures by a quarter turn."""
    is_counted: bool = False
    """Whether frames must be counted from a keyframe, as their time stamps are in decoding order."""
    is_interlaced: bool = False
    """Whether the first picture holds two moments, in its even and its odd rows."""
    n_left_out: int = 0
    """Number of pictures before the first one that are no frames, as what they need was cut away."""

    @property
    def n_frames(self) -> int:
        """Number of frames in the file."""
        return len(self.stamps)

    def reduction_to(self, size_px: tuple[int, int] | None) -> tuple[int, int] | None:
        """The width and height to which pictures must be reduced to have this size; None if they have it."""
        return None if size_px == (self.width_px, self.height_px) else size_px

    def keyframe_before(self, frame: int) -> tuple[int, int]:
        """The last keyframe (its number, its decoding stamp) at or before a frame."""
        return max((key for key in self.keyframes if key[0] <= frame), default=(0, 0))


def index_video(path: Path) -> VideoIndex:
    """Reads all packets and decodes one picture, unless this process has done so since the file was written.

    Raises TakeError if the file is missing, contains no video, is cut off or does not tell pictures' times.
    """
    written = (0, 0, 0)
    with suppress(OSError):  # opened_video says what is wrong
        state = path.stat()
        written = (state.st_ino, state.st_size, state.st_mtime_ns)
    return _index(path, written)


@lru_cache(_INDICES_KEPT)
def _index(path: Path, _written: tuple[int, int, int]) -> VideoIndex:
    with opened_video(path) as container:
        stream = video_stream(container, path)
        packets = _packets(container, stream, path)
        declared, unit_s = stream.frames, float(stream.time_base or 0)
        is_counted = _is_counted(container, stream)
        needs_times = "matroska" in container.format.name  # only pictures that a cut left out have none
        if container.format.name == "avi":
            declared = _declared_by_avi(stream, packets)
    _check_whole(path, packets, declared)
    frame = _first_frame(path, next((n for n, packet in enumerate(packets) if packet.is_key), 0))
    quarter_turns = _quarter_turns(frame)
    width, height = (frame.height, frame.width) if quarter_turns % 2 else (frame.width, frame.height)
    shown = _shown(packets, frame.pts)
    stamps = sorted(packet.shown for packet in shown)
    if len(stamps) > 1 and np.median(np.diff(stamps)) == 0:
        raise TakeError(f"{path}: gives most pictures the same time: convert it (ffmpeg -r FPS -i IN OUT)")
    keyframes = sorted((bisect_left(stamps, p.shown), p.decoded) for p in packets if p.is_begin)
    return VideoIndex(
        path=path,
        width_px=width,
        height_px=height,
        times_s=np.array(stamps) * unit_s,
        stamps=tuple(stamps),
        keyframes=tuple(keyframes),
        repeats=frozenset(bisect_left(stamps, packet.shown) for packet in shown if packet.is_not_coded),
        is_turned=quarter_turns % 2 == 1,
        is_counted=is_counted,
        is_interlaced=frame.interlaced_frame,
        n_left_out=sum(
            not p.is_hidden and (p.shown < stamps[0] if p.has_time else needs_times) for p in packets
        ),
    )


class _Packet(NamedTuple):
    """The parts of a packet for the index, without its data."""

    shown: int
    decoded: int
    is_key: bool
    is_begin: bool
    """Whether reading can begin here: where frames are counted, none may need earlier ones."""
    is_whole: bool
    is_hidden: bool
    """Decoded only because other frames need it, according to the file's edit list."""
    is_not_coded: bool
    has_time: bool

    @classmethod
    def of(cls, packet: "av.Packet[VideoStream]", codec: str, *, is_counted: bool) -> "_Packet":
        decoded = packet.dts or 0
        return cls(
            shown=decoded if packet.pts is None or is_counted else packet.pts,
            decoded=decoded,
            is_key=packet.is_keyframe,
            is_begin=packet.is_keyframe
            and (not is_counted or _WHOLE_REFRESH[codec].search(bytes(packet)) is not None),
            is_whole=not packet.is_corrupt,
            is_hidden=packet.is_discard,
            is_not_coded=codec in _CODECS_WITH_NOT_CODED and packet.size <= _LONGEST_NOT_CODED,
            has_time=packet.pts is not None or packet.dts is not None,
        )


def _is_counted(container: InputContainer, stream: VideoStream) -> bool:
    return container.format.name == "avi" and stream.codec_context.name in _WHOLE_REFRESH


def _packets(container: InputContainer, stream: VideoStream, path: Path) -> list[_Packet]:
    codec, is_counted = stream.codec_context.name, _is_counted(container, stream)
    try:
        every = container.demux(stream)
        return [_Packet.of(packet, codec, is_counted=is_counted) for packet in every if packet.size]
    except (av.error.FFmpegError, IndexError):  # the latter where damage makes a stream appear late
        raise TakeError(f"{path}: is damaged: {COPY_AGAIN}") from None


def _check_whole(path: Path, packets: list[_Packet], declared: int) -> None:
    if len(packets) < declared:  # cut off, or an edit list hides frames: count all packets to know which
        with opened_video(path, {"ignore_editlist": "1"}) as container:
            packets = _packets(container, video_stream(container, path), path)
    whole = sum(packet.is_whole for packet in packets)
    if whole < max(declared, len(packets), 1):
        raise TakeError(f"{path}: cut off after {whole} of {max(declared, whole)} frames: {COPY_AGAIN}")


def _shown(packets: list[_Packet], first: int | None) -> list[_Packet]:
    """The packets whose pictures players show, given the stamp of the first picture that can be decoded.

    Where a file was cut without coding it anew, pictures before its first keyframe may need others that were
    cut away; Matroska gives them no time.
    """
    timed = [packet for packet in packets if packet.has_time] or packets
    key = next((packet for packet in timed if packet.is_key), timed[0]).shown
    begin = key if first is None else min(key, first)
    return [packet for packet in timed if not packet.is_hidden and packet.shown >= begin]


def _declared_by_avi(stream: VideoStream, packets: list[_Packet]) -> int:
    """How many frames an AVI file should have, which is what it has unless it ends early.

    Its header counts moments, also those without a frame: where one was dropped, or all odd ones. FFmpeg
    shortens the duration of a file that is smaller than its header says; after a damaged frame the following
    ones come too early, and the last one before the end.
    """
    steps = np.diff([packet.decoded for packet in packets])
    step = max(1.0, float(np.median(steps))) if len(steps) else 1.0
    end = packets[-1].decoded + step if packets else 0.0
    if min(stream.duration or 0, end) >= stream.frames:
        return len(packets)
    return ceil(stream.frames / step)


def opened_video(path: Path, options: dict[str, str] | None = None) -> InputContainer:
    """Open a video file; raises TakeError if it is missing or cannot be read."""
    try:
        return av.open(str(path), "r", options=options, metadata_errors="replace")
    except FileNotFoundError:
        raise TakeError(f"{path}: is missing: expected a video") from None
    except PermissionError as problem:
        raise TakeError(f"{path}: cannot be read ({problem.strerror}): change its permissions") from None
    except (av.error.FFmpegError, OSError):
        raise TakeError(
            f"{path}: cannot be read as a video (empty, cut off before its index, no video): {COPY_AGAIN}"
        ) from None


def video_stream(container: InputContainer, path: Path) -> VideoStream:
    """The video stream that the file marks as its default, else the first; raises TakeError if there is none.

    It is decoded on one thread.
    """
    streams = [stream for stream in container.streams.video if stream.codec_context]
    if not streams:
        raise TakeError(f"{path}: contains no video that can be decoded: copy it again or convert it")
    stream = next((stream for stream in streams if stream.disposition & Disposition.default), streams[0])
    stream.thread_type = "NONE"  # the services share the cores: more threads would only compete for them
    return stream


def _first_frame(path: Path, skipped: int) -> VideoFrame:
    """The first frame that can be decoded, without the first `skipped` packets."""
    with opened_video(path) as container:
        packets = islice(container.demux(video_stream(container, path)), skipped, None)
        try:
            frames = (frame for packet in packets for frame in packet.decode() if not frame.is_corrupt)
            frame = next(frames, None)
        except av.error.FFmpegError:
            frame = None
        if frame is None:
            raise TakeError(f"{path}: frame 0 cannot be decoded: {COPY_AGAIN}")
        return frame


def bgr_picture(
    frame: VideoFrame, converter: VideoReformatter, size_px: tuple[int, int] | None = None
) -> Bytes:
    """A decoded frame as BGR (H, W, 3), rotated by the file's metadata: cameras held upright store rotated
    pictures.

    size_px: width and height to which the upright picture is reduced, by the mean over areas; None: not.
    """
    quarter_turns = _quarter_turns(frame)
    if size_px is None:
        converted = converter.reformat(frame, format="bgr24", threads=1)
    else:
        width, height = size_px[::-1] if quarter_turns % 2 else size_px
        converted = converter.reformat(frame, width, height, "bgr24", interpolation=_REDUCING, threads=1)
    bgr: Bytes = np.asarray(converted.to_ndarray(), np.uint8)
    return np.ascontiguousarray(np.rot90(bgr, quarter_turns)) if quarter_turns else bgr


def _quarter_turns(frame: VideoFrame) -> int:
    """By how many quarter turns, counter-clockwise, the file's rotation tag turns a stored picture."""
    return round(frame.rotation / 90) % 4
