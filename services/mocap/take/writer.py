"""Writes take folders and videos; everything appears completely or not at all."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType

import av
import cv2
import numpy as np
from av.container import OutputContainer
from av.video.frame import VideoFrame
from av.video.reformatter import Interpolation, VideoReformatter

from services.mocap.atomic import atomic_file, atomic_folder, write_file
from services.mocap.camera.calibration import write_calibration
from services.mocap.camera.camera import Camera
from services.mocap.errors import TakeError
from services.mocap.take.layout import CALIBRATION, SETTINGS
from services.mocap.take.settings import TakeSettings, write_settings
from services.mocap.types import Bytes, Mask, Trimap

NEAR_LOSSLESS_CRF = 12
REPRODUCIBLE = {"mbtree": "0", "threads": "1", "x264-params": "cpu-independent=1"}
"""Options of x264 for the same file from the same pictures, on all machines. Its macroblock tree makes
another one each time, but saves a third of the bytes."""
_KEYFRAME_EVERY_S = 2  # for fast seeking in browsers and readers
_BT601 = 6  # FFmpeg's number (SMPTE 170M) for the colours of its default conversion
_LIMITED_RANGE = 1
_ROUNDED = int(Interpolation.BILINEAR) | int(
    Interpolation.ACCURATE_RND
)  # otherwise half a grey level is lost


class VideoWriter:
    """Appends pictures to an H.264 stream; made by `video_writer`."""

    def __init__(
        self,
        container: OutputContainer,
        width_px: int,
        height_px: int,
        fps: float,
        options: Mapping[str, str],
    ) -> None:
        """options: of the encoder, besides the keyframe interval."""
        self.width_px, self.height_px = width_px, height_px
        self.n_frames = 0
        self._rate = Fraction(fps).limit_denominator(1001)
        self._converter = VideoReformatter()
        self._container = container
        keyframe_every = max(1, round(_KEYFRAME_EVERY_S * fps))
        self._stream = container.add_stream(
            "libx264", rate=self._rate, options={**options, "g": str(keyframe_every)}
        )
        self._stream.width, self._stream.height, self._stream.pix_fmt = width_px, height_px, "yuv420p"
        context = self._stream.codec_context
        context.colorspace = context.color_primaries = context.color_trc = _BT601
        context.color_range = _LIMITED_RANGE

    def write(self, picture_bgr: Bytes) -> None:
        """Appends one (height_px, width_px, 3) picture; raises ValueError when its shape is another."""
        expected = (self.height_px, self.width_px, 3)
        if picture_bgr.shape != expected:
            raise ValueError(f"picture_bgr: expected shape {expected}, got {picture_bgr.shape}")
        bgr = VideoFrame.from_ndarray(np.ascontiguousarray(picture_bgr), format="bgr24")
        frame = self._converter.reformat(bgr, format="yuv420p", interpolation=_ROUNDED, threads=1)
        frame.pts, frame.time_base = self.n_frames, 1 / self._rate
        self._container.mux(self._stream.encode(frame))
        self.n_frames += 1

    def finish(self) -> None:
        """Flushes the encoder; raises ValueError if there was no picture."""
        if not self.n_frames:
            raise ValueError("a video needs at least one picture")
        self._container.mux(self._stream.encode(None))


@contextmanager
def video_writer(
    path: Path,
    width_px: int,
    height_px: int,
    fps: float,
    crf: int = NEAR_LOSSLESS_CRF,
    options: Mapping[str, str] = MappingProxyType({}),
) -> Iterator[VideoWriter]:
    """A writer of an mp4 that browsers play; the file appears when the block ends without an exception.

    crf: x264's quality, 0 to 51, smaller is better: 12 is nearly lossless, about 20 is good for viewing.
    options: further ones of x264, such as its preset, or REPRODUCIBLE.
    Raises TakeError for odd sizes, which the pixel format of browsers (yuv420p) does not support.
    """
    if width_px % 2 or height_px % 2:
        raise TakeError(
            f"{path}: cannot be written in {width_px}x{height_px} pixels: expected an even width and height"
        )
    with (
        atomic_file(path) as part,
        av.open(str(part), "w", format="mp4", options={"movflags": "+faststart"}) as container,
    ):
        writer = VideoWriter(container, width_px, height_px, fps, {"crf": str(crf), **options})
        yield writer
        writer.finish()


def write_picture(path: Path, picture: Bytes | Trimap | Mask) -> None:
    """A PNG of a BGR (H, W, 3) picture, a (H, W) trimap or a (H, W) silhouette (0 and 255).

    Creates the folder if it is missing.
    """
    pixels = picture.astype(np.uint8) * (255 if picture.dtype == np.bool_ else 1)
    write_file(path, cv2.imencode(".png", pixels)[1].tobytes())


@contextmanager
def take_writer(folder: Path, settings: TakeSettings, cameras: Sequence[Camera]) -> Iterator[Path]:
    """The temporary folder of a new take with its settings and calibration, to be filled by the block.

    cameras: in the internal z-up world. The folder appears when the block ends without an exception. Raises
    UserError if it already exists.
    """
    with atomic_folder(folder) as part:
        write_settings(part / SETTINGS, settings)
        write_calibration(part / CALIBRATION, tuple(cameras), settings.up)
        yield part
