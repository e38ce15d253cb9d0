"""Opens a take folder, and checks everything that can be checked before the work starts."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from services.mocap.camera.calibration import read_calibration
from services.mocap.camera.camera import Camera
from services.mocap.camera.colour import ColourCorrection, read_colours
from services.mocap.errors import TakeError, UserError, nearest
from services.mocap.take import layout
from services.mocap.take.pictures import (
    TrimapReader,
    check_png,
    check_size,
    read_picture,
    read_trimap,
)
from services.mocap.take.settings import TakeSettings, read_settings
from services.mocap.take.tables import read_joints_csv
from services.mocap.take.video import VideoReader
from services.mocap.take.video_index import VideoIndex, index_video
from services.mocap.types import Bytes, Floats

Source = Literal["videos", "silhouettes"]

_LARGEST_RATE_ERROR = 0.01
_LARGEST_GAP = 1.5
"""In median frame intervals: with a larger gap, frame numbers no longer give the time."""
_QUICK_TO_DECODE_PX = 200 * 320 * 240
"""Videos of up to this many pixels, 200 frames of 320x240, are decoded completely, which takes over a second
for eight; longer ones only at their end."""


@dataclass(frozen=True, eq=False)
class Take:
    """One recording, checked by `open_take`."""

    folder: Path
    settings: TakeSettings
    cameras: tuple[Camera, ...]
    """As calibrated, with lens distortion, in the internal z-up world."""
    source: Source
    """The source of the silhouettes: videos and clean plates, or the take's own silhouettes."""

    colours: Mapping[str, ColourCorrection] = field(default_factory=dict)
    """The colour corrections of the cameras that have one."""

    def video(
        self, camera: Camera, start: int = 0, stop: int | None = None, index: VideoIndex | None = None
    ) -> VideoReader:
        """A camera's pictures of frames `start` up to but not including `stop` (default: the take's end).

        They are raw except for colour correction. index: of the camera's video, if it is known already.
        """
        video = layout.video_path(self.folder, camera.name) if index is None else index
        ahead, colour = self.settings.offset(camera.name), self.colours.get(camera.name)
        end = self.settings.frames if stop is None else stop
        return VideoReader(video, start + ahead, end + ahead, colour)

    def has_video(self, camera: Camera) -> bool:
        """False for a camera with silhouettes only."""
        return layout.video_path(self.folder, camera.name).exists()

    def has_background(self, camera: Camera) -> bool:
        """False for a camera without a clean plate."""
        return self.plate(camera) is not None

    def plate(self, camera: Camera) -> Path | None:
        """The file of a camera's clean plate: a video, or else a single picture; None where there is none."""
        video = layout.background_video_path(self.folder, camera.name)
        picture = layout.background_picture_path(self.folder, camera.name)
        return next((path for path in (video, picture) if path.exists()), None)

    def trimaps(self, camera: Camera, start: int = 0, stop: int | None = None) -> TrimapReader:
        """A camera's raw silhouettes of frames `start` up to but not including `stop` (default: the take's
        end)."""
        folder, ahead = (
            layout.silhouette_folder(self.folder, camera.name),
            self.settings.offset(camera.name),
        )
        end = self.settings.frames if stop is None else stop
        return TrimapReader(folder, start + ahead, end + ahead, self.settings.unsure)

    def frame_range(self, text: str) -> range:
        """Parse A:B, each optional, as frames A up to but not including B; raises UserError."""
        first, colon, end = text.partition(":")
        n_frames = self.settings.frames
        try:
            if not colon:
                raise ValueError
            frames = range(int(first or 0), int(end or n_frames))
        except ValueError:
            raise UserError(f"--frames {text}: expected A:B, such as 0:50") from None
        if not 0 <= frames.start < frames.stop <= n_frames:
            raise UserError(
                f"--frames {text}: expected a range within 0:{n_frames}, the frames of {self.folder}"
            )
        return frames

    def without_offsets(self) -> "Take":
        """The same take without offsets."""
        return replace(self, settings=self.settings.model_copy(update={"offsets": {}}))

    @property
    def actor_path(self) -> Path | None:
        """The file of the take's actor, if it has one."""
        path = self.folder / layout.ACTOR
        return path if path.exists() else None

    def inputs(self, from_videos: bool) -> list[Path]:
        """The files that determine poses: recordings and clean plates, or silhouettes; and the calibration.

        from_videos: whether silhouettes are made from videos; otherwise they are the take's own.
        """
        folders: set[Path] = set()
        for camera in self.cameras:
            if from_videos:
                folders.add(layout.video_path(self.folder, camera.name).parent)
                folders.add(layout.background_video_path(self.folder, camera.name).parent)
            else:
                folders.add(layout.silhouette_folder(self.folder, camera.name))
        files = [path for folder in sorted(folders) for path in sorted(folder.glob("*")) if path.is_file()]
        if from_videos and (self.folder / layout.COLOURS).exists():
            files.append(self.folder / layout.COLOURS)
        return [self.folder / layout.CALIBRATION, *files]

    def background(self, camera: Camera) -> Iterator[Bytes]:
        """A camera's clean-plate pictures, like `video`'s; raises TakeError where there are none."""
        path, colour = self.plate(camera), self.colours.get(camera.name)
        if path is None:
            raise TakeError(f"{self.folder}: has no picture of the empty stage of {camera.name}")
        if path.suffix == ".png":
            picture = read_picture(path)
            yield picture if colour is None else colour.apply(picture)
            return
        with VideoReader(path, colour=colour) as reader:
            yield from reader


def open_take(folder: Path, *, in_step: bool = True, decoded: bool = True) -> Take:
    """Opens and checks a take folder; in_step: whether videos of different lengths are an error.

    decoded: whether to decode videos, short ones completely and long ones at their end, so that damage is
    found before the work starts; otherwise it is found on reading.

    Raises TakeError for the first error found: settings, calibration, missing or
    damaged videos, clean plates and silhouettes, their sizes, lengths and frame rates, reference tables.
    """
    if not folder.is_dir():
        raise TakeError(f"{folder}: is not a folder: expected a take folder with {layout.SETTINGS} in it")
    settings = read_settings(folder / layout.SETTINGS)
    cameras = read_calibration(folder / layout.CALIBRATION, settings.up)
    source: Source = "silhouettes" if (folder / layout.SILHOUETTES).is_dir() else "videos"
    colours = read_colours(folder / layout.COLOURS, [camera.name for camera in cameras])
    take = Take(folder, settings, cameras, source, colours)
    for name in settings.offsets:
        if name not in (known := [camera.name for camera in cameras]):
            raise TakeError(
                f"{folder / layout.SETTINGS}: offsets: {name}: is no camera of {layout.CALIBRATION}: "
                f"{nearest(name, known)}"
            )
    for camera in cameras:
        if source == "silhouettes":
            _check_silhouettes(take, camera)
        else:
            _check_is_recorded(take, camera, decoded)
    _check_videos(take, in_step, decoded)
    if (folder / layout.REFERENCE_JOINTS_CSV).exists():
        read_joints_csv(folder / layout.REFERENCE_JOINTS_CSV)
    return take


def _check_silhouettes(take: Take, camera: Camera) -> None:
    folder = layout.silhouette_folder(take.folder, camera.name)
    if not folder.is_dir():
        raise TakeError(
            f"{folder}: is missing: expected the silhouettes of {camera.name}, or no folder "
            f"{layout.SILHOUETTES} at all"
        )
    ahead = take.settings.offset(camera.name)
    for frame in range(ahead, ahead + take.settings.frames):
        path = layout.silhouette_path(folder, frame)
        if not path.exists():
            raise TakeError(
                f"{path}: is missing: expected a silhouette for each of the frames = {take.settings.frames} "
                f"of {layout.SETTINGS}{_from(ahead)}"
            )
        check_png(path, camera)
    read_trimap(layout.silhouette_path(folder, ahead), take.settings.unsure)


def _check_is_recorded(take: Take, camera: Camera, decoded: bool) -> None:
    """Every camera has a video, and a clean plate unless no camera has one; then it is estimated from the
    take."""
    video = layout.video_path(take.folder, camera.name)
    if not video.exists():
        raise TakeError(
            f"{video}: is missing: expected the video of [{camera.name}] in {layout.CALIBRATION}, or "
            f"silhouettes in {layout.SILHOUETTES}/{camera.name}"
        )
    plate = take.plate(camera)
    if plate is not None:
        check_plate(plate, camera, decoded=decoded)
        return
    expected = layout.background_video_path(take.folder, camera.name)
    if expected.parent.is_dir():
        raise TakeError(
            f"{expected}: is missing: expected the clean plate of {camera.name} (the empty stage), as this "
            f"video or as {camera.name}.png, or no folder {expected.parent.name} at all"
        )


def check_plate(path: Path, camera: Camera, *, decoded: bool) -> None:
    """Raises TakeError for a clean plate of another size than the camera's, or a damaged one.

    decoded: whether a video is decoded to find that.
    """
    if path.suffix == ".png":
        check_png(path, camera)
        return
    index = index_video(path)
    check_size(path, index.width_px, index.height_px, camera)
    if decoded:
        _check_decodes(index, index.n_frames)


def _check_videos(take: Take, in_step: bool, decoded: bool) -> None:
    """Every video has the take's frames, rate and size, and all have the same length.

    Their lengths may differ if take.toml has offsets, or in_step is false.
    """
    indices: list[VideoIndex] = []
    for camera in take.cameras:
        if take.has_video(camera):
            indices.append(index_video(layout.video_path(take.folder, camera.name)))
            _check_video(take, camera, indices[-1])
    for index in indices[1:]:
        if index.n_frames != indices[0].n_frames and in_step and not take.settings.offsets:
            raise TakeError(
                f"{index.path}: has {index.n_frames} frames, but {indices[0].path.name} has "
                f"{indices[0].n_frames}: cut all videos to the same moments, or run xormocap sync"
            )
    for index in indices if decoded else ():
        _check_decodes(index, take.settings.frames + take.settings.offset(index.path.stem))


def _check_video(take: Take, camera: Camera, index: VideoIndex) -> None:
    check_size(index.path, index.width_px, index.height_px, camera)
    ahead, fps = take.settings.offset(camera.name), take.settings.fps
    frames = take.settings.frames + ahead
    if index.n_frames < frames:
        raise TakeError(
            f"{index.path}: has {index.n_frames} frames, but {layout.SETTINGS} says frames = "
            f"{take.settings.frames}{_from(ahead)}: lower that number or record the camera again"
        )
    if frames > 1:
        _check_rate(index.path, np.diff(index.times_s[:frames]), fps)


def _from(ahead: int) -> str:
    return f" from frame {ahead} on, the camera's offset" if ahead else ""


def _check_rate(path: Path, gaps_s: Floats, fps: float) -> None:
    """gaps_s: (N,) from each frame to the next; they are even, and those of fps."""
    late = np.flatnonzero(gaps_s > _LARGEST_GAP * np.median(gaps_s))
    if late.size:
        raise TakeError(
            f"{path}: lacks frames between its frames {late[0]} and {late[0] + 1}, which are "
            f"{gaps_s[late[0]]:.3f} s apart: convert it to a constant frame rate"
        )
    video_fps = 1 / gaps_s.mean()
    if abs(video_fps / fps - 1) > _LARGEST_RATE_ERROR:
        raise TakeError(
            f"{path}: runs at {video_fps:.4g} frames per second, but {layout.SETTINGS} says fps = {fps:g}: "
            "correct that number or convert the video"
        )


def _check_decodes(index: VideoIndex, frames: int) -> None:
    quick = frames * index.width_px * index.height_px <= _QUICK_TO_DECODE_PX
    start = 0 if quick else index.keyframe_before(frames - 1)[0]
    with VideoReader(index, start, frames) as reader:
        reader.check()
