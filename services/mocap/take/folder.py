"""Opens a take folder, and checks everything that can be checked before the work starts."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import tomli_w

from services.mocap.camera.calibration import Up, read_calibration
from services.mocap.camera.camera import Camera
from services.mocap.camera.colour import ColourCorrection, read_colours
from services.mocap.camera.formats import read_any
from services.mocap.camera.undistort import reduce_picture
from services.mocap.errors import CalibrationError, TakeError, UserError, validated
from services.mocap.side_by_side import side_by_side
from services.mocap.take import layout
from services.mocap.take.pictures import check_greys, check_png, read_picture, read_trimaps
from services.mocap.take.recordings import check_names, files_of, find_videos, match_by_name, unused_remarks
from services.mocap.take.settings import TakeFile, TakeSettings, read_take_file
from services.mocap.take.tables import read_joints_csv
from services.mocap.take.video import PicturePicker, VideoReader
from services.mocap.take.video_checks import (
    check_decodes,
    check_plate,
    check_video,
    cut_remark,
    drift_remark,
    interlaced_remarks,
    left_out_remarks,
    rate_of,
)
from services.mocap.take.video_index import VideoIndex, index_video
from services.mocap.types import Bytes, Trimap

Source = Literal["videos", "silhouettes"]


_LOOKED_AT = 9
"""Of a camera's silhouettes, to tell whether they use the expected greys."""
_MOST_OF_MEDIAN = 2
"""How many times as large as the median camera's pictures others may be: with one of three cameras 4 times as
large, joints were 29 mm off those of equal ones, and 7 mm with one twice as large."""


@dataclass(frozen=True, eq=False)
class Take:
    """One recording, checked by `open_take`."""

    folder: Path
    settings: TakeSettings
    calibrated: tuple[Camera, ...]
    """The cameras of the files, with lens distortion, in the internal z-up world."""
    source: Source
    """The source of the silhouettes: videos and clean plates, or the take's own silhouettes."""

    colours: Mapping[str, ColourCorrection] = field(default_factory=dict)
    """The colour corrections of the cameras that have one."""
    videos: Mapping[str, Path] = field(default_factory=dict)
    """The recordings of the cameras that have one."""
    plates: Mapping[str, Path] = field(default_factory=dict)
    """The clean plates of the cameras that have one: videos or PNG pictures."""
    remarks: tuple[str, ...] = ()
    """Sentences about the recording that its user should know."""
    stated: tuple[Camera, ...] = ()
    """The cameras as calibration.toml has them, if `calibrated` has some of them elsewhere (moved_take)."""

    @cached_property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras of the pictures and silhouettes that are worked with, which are reduced where they are
        larger than the settings' longest_side, or much larger than most cameras' are: each pixel counts."""
        longer_px = sorted(max(camera.size_px) for camera in self.calibrated)
        most_px = min(self.settings.longest_side, _MOST_OF_MEDIAN * longer_px[(len(longer_px) - 1) // 2])
        return tuple(camera.reduced(most_px) for camera in self.calibrated)

    @property
    def camera_names(self) -> list[str]:
        """In the order of the cameras."""
        return [camera.name for camera in self.cameras]

    def video(
        self, camera: Camera, start: int = 0, stop: int | None = None, index: VideoIndex | None = None
    ) -> VideoReader:
        """A camera's pictures of frames `start` up to but not including `stop` (default: the take's end).

        They are raw except for colour correction, and reduced to the camera's size. index: of the camera's
        video, if it is known already.
        """
        video = self.videos[camera.name] if index is None else index
        ahead, colour = self.settings.offset(camera.name), self.colours.get(camera.name)
        end = self.settings.frames if stop is None else stop
        return VideoReader(video, start + ahead, end + ahead, colour, camera.size_px)

    def picker(self, camera: Camera) -> PicturePicker:
        """Reads single pictures of a camera's video, like `video`'s; frames are numbered as in the file."""
        index, colour = index_video(self.videos[camera.name]), self.colours.get(camera.name)
        return PicturePicker(index, colour, camera.size_px)

    def has_video(self, camera: Camera) -> bool:
        """False for a camera with silhouettes only."""
        return camera.name in self.videos

    def has_background(self, camera: Camera) -> bool:
        """False for a camera without a clean plate."""
        return self.plate(camera) is not None

    def plate(self, camera: Camera) -> Path | None:
        """The file of a camera's clean plate: a video, or else a single picture; None where there is none."""
        return self.plates.get(camera.name)

    def trimaps(self, camera: Camera, start: int = 0, stop: int | None = None) -> Iterator[Trimap]:
        """A camera's raw silhouettes of frames `start` up to but not including `stop` (default: the take's
        end), reduced to the camera's size."""
        folder = layout.silhouette_folder(self.folder, camera.name)
        ahead = self.settings.offset(camera.name)
        end = self.settings.frames if stop is None else stop
        return read_trimaps(folder, start + ahead, end + ahead, self.settings.unsure, camera)

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
        if from_videos:
            files = sorted({*self.videos.values(), *self.plates.values()})
            if (self.folder / layout.COLOURS).exists():
                files.append(self.folder / layout.COLOURS)
        else:
            folders = {layout.silhouette_folder(self.folder, camera.name) for camera in self.cameras}
            files = [path for folder in sorted(folders) for path in sorted(folder.glob("*"))]
        return [self.folder / layout.CALIBRATION, *files]

    def background(self, camera: Camera) -> Iterator[Bytes]:
        """A camera's clean-plate pictures, like `video`'s; raises TakeError where there are none."""
        path, colour = self.plate(camera), self.colours.get(camera.name)
        if path is None:
            raise TakeError(f"{self.folder}: has no picture of the empty stage of {camera.name}")
        if path.suffix == ".png":
            picture = reduce_picture(read_picture(path), camera)
            yield picture if colour is None else colour.apply(picture)
            return
        with VideoReader(path, colour=colour, size_px=camera.size_px) as reader:
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
    said = read_take_file(folder / layout.SETTINGS)
    cameras = _cameras(folder / layout.CALIBRATION, said.up)
    names = [camera.name for camera in cameras]
    check_names(folder, "offsets", said.offsets, names)
    source: Source = "silhouettes" if (folder / layout.SILHOUETTES).is_dir() else "videos"
    videos, plates = find_videos(folder, names, said.videos), _find_plates(folder, names)
    if source == "videos":
        side_by_side(lambda camera: _check_is_recorded(folder, camera, videos, plates, decoded), cameras)
    indices = {name: index_video(videos[name]) for name in names if name in videos}
    recordings, lengths = videos, {name: index.n_frames for name, index in indices.items()}
    if source == "silhouettes":
        recordings = {name: layout.silhouette_folder(folder, name) for name in names}
        lengths = {name: len(files_of(path, (".png",))) for name, path in recordings.items()}
    settings = _completed(folder / layout.SETTINGS, said, lengths, indices)
    colours = read_colours(folder / layout.COLOURS, names)
    take = Take(folder, settings, cameras, source, colours, videos, plates)
    for camera in cameras:
        if source == "silhouettes":
            _check_silhouettes(take, camera, said.frames)
        if camera.name in indices:
            check_video(indices[camera.name], camera, settings, said)
    of_paths = {recordings[name]: length for name, length in lengths.items()}
    cut = cut_remark(of_paths, settings, is_stated=said.frames is not None) if in_step else None
    drift = drift_remark(indices, settings, is_stated=said.fps is not None) if in_step else None
    if decoded:
        side_by_side(
            lambda name: check_decodes(indices[name], settings.frames + settings.offset(name)), indices
        )
    if (folder / layout.REFERENCE_JOINTS_CSV).exists():
        read_joints_csv(folder / layout.REFERENCE_JOINTS_CSV)
    remarks = [
        *(remark for remark in (cut, drift) if remark is not None),
        *left_out_remarks(indices.values()),
        *interlaced_remarks(indices.values()),
        *unused_remarks(files_of(folder / layout.VIDEOS), videos),
    ]
    return replace(take, remarks=tuple(remarks))


def _cameras(path: Path, up: Up) -> tuple[Camera, ...]:
    """The calibration; raises CalibrationError, which says how to convert a file of another tool."""
    try:
        return read_calibration(path, up)
    except CalibrationError as problem:
        try:
            read_any(path, "toml", size_px=None, units="auto", scale=1.0, up=up)
        except CalibrationError:
            raise problem from None
        raise CalibrationError(
            f"{problem}; if another tool wrote this file, rename it and type: xormocap calibrate --import "
            f"{path.with_name('other.toml')} --out {path}"
        ) from None


def _find_plates(folder: Path, names: list[str]) -> dict[str, Path]:
    """The clean plates: videos, or single pictures of cameras without one."""
    plates = folder / layout.BACKGROUND
    videos = match_by_name(names, files_of(plates))
    left = [name for name in names if name not in videos]
    return videos | match_by_name(left, files_of(plates, (".png",)))


def _completed(
    path: Path, said: TakeFile, lengths: Mapping[str, int], indices: Mapping[str, VideoIndex]
) -> TakeSettings:
    """The settings, with the frame rate and the shortest recording's length where take.toml states none.

    path: take.toml. lengths: of the recordings, by camera. Raises TakeError where other fields do not fit the
    number of frames.
    """
    of_videos = ((name, index.n_frames) for name, index in indices.items())
    for name, length in (*lengths.items(), *of_videos):
        if 0 < length <= said.offset(name):
            raise TakeError(
                f"{path}: offsets: {name}: is {said.offset(name)}, but the camera has {length} frames: "
                "expected less than that"
            )
    frames = min(length - said.offset(name) for name, length in lengths.items())
    fps = said.fps or rate_of(list(indices.values()), path)
    known = {"fps": fps, "frames": said.frames or max(1, frames)}
    return validated(TakeSettings, said.model_dump() | known, f"{path}: ", TakeError)


def _check_silhouettes(take: Take, camera: Camera, stated: int | None) -> None:
    """Raise TakeError if a silhouette is missing or damaged; stated: the frames that take.toml states."""
    folder = layout.silhouette_folder(take.folder, camera.name)
    if not folder.is_dir():
        there = ", ".join(sorted(path.name for path in folder.parent.iterdir() if path.is_dir())) or "none"
        raise TakeError(
            f"{folder}: is missing: expected the silhouettes of {camera.name}, a camera of "
            f"{layout.CALIBRATION}; the folders there are: {there}: name them like the cameras, or leave "
            f"[{camera.name}] out of {layout.CALIBRATION}"
        )
    ahead = take.settings.offset(camera.name)
    frames = range(ahead, ahead + take.settings.frames)
    for frame in frames:
        path = layout.silhouette_path(folder, frame)
        if not path.exists():
            expected = _silhouettes_expected(folder, ahead, stated)
            raise TakeError(f"{path}: is missing: expected a silhouette for {expected}")
        check_png(path, camera)
    looked_at = frames[:: -(-len(frames) // _LOOKED_AT)]
    check_greys([layout.silhouette_path(folder, frame) for frame in looked_at], take.settings.unsure)


def _silhouettes_expected(folder: Path, ahead: int, stated: int | None) -> str:
    """The frames of which there should be a silhouette, and what files of other names should be named."""
    begin = f" from frame {ahead} on, the camera's offset" if ahead else ""
    files, first = files_of(folder, (".png",)), layout.silhouette_path(folder, 0)
    if not files or files[0] not in {layout.silhouette_path(folder, frame) for frame in range(ahead + 1)}:
        there = f"the first file there is {files[0].name}" if files else "there is no PNG picture"
        following = layout.silhouette_path(folder, 1).name
        return f"each frame{begin}, named {first.name}, {following} and so on, but {there}"
    if stated is None:
        return f"each frame{begin} up to that of {files[-1].name}"
    return f"each of the frames = {stated} of {layout.SETTINGS}{begin}"


def _check_is_recorded(
    folder: Path, camera: Camera, videos: Mapping[str, Path], plates: Mapping[str, Path], decoded: bool
) -> None:
    """Every camera has a video, and a clean plate unless no camera has one; then it is estimated from the
    take."""
    video = layout.video_path(folder, camera.name)
    if camera.name not in videos:
        free = [path.name for path in files_of(video.parent) if path not in videos.values()]
        absent = "" if free else f"; if it did not record, leave it out of {layout.CALIBRATION}"
        raise TakeError(
            f"{video}: is missing: expected the video of [{camera.name}] in {layout.CALIBRATION}, or "
            f"silhouettes in {layout.SILHOUETTES}/{camera.name}{_or_stated(camera.name, free)}{absent}"
        )
    plate = plates.get(camera.name)
    if plate is not None:
        check_plate(plate, camera, decoded=decoded)
        return
    expected = layout.background_video_path(folder, camera.name)
    if expected.parent.is_dir():
        raise TakeError(
            f"{expected}: is missing: expected the clean plate of {camera.name} (the empty stage), as this "
            f"video or as {camera.name}.png, or no folder {expected.parent.name} at all"
        )


def _or_stated(camera: str, free: list[str]) -> str:
    """The remedy if there are videos that belong to no camera."""
    if not free:
        return ""
    return (
        f"; {', '.join(free)} can be given to cameras by a table [videos] in {layout.SETTINGS}, such as "
        f"{tomli_w.dumps({camera: f'{layout.VIDEOS}/{free[0]}'}).strip()}"
    )
