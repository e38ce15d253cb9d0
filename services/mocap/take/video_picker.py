"""Single pictures of a video, in any order, without decoding all pictures between them."""

from collections import deque
from collections.abc import Iterator
from contextlib import suppress

import av
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream

from services.mocap.camera.colour import ColourCorrection
from services.mocap.errors import TakeError
from services.mocap.take.video import VideoReader
from services.mocap.take.video_index import COPY_AGAIN, VideoIndex, bgr_picture, opened_video, video_stream
from services.mocap.types import Bytes


class PicturePicker:
    """Reads single pictures; for one thread at a time. It keeps the file open."""

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
