"""Live input as users describe it: a TOML file that names the cameras' sources, opened like a take.

What is missing in it is what only recorded takes have: videos, and a number of frames.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, field_validator

from services.mocap.camera.calibration import Up, read_calibration
from services.mocap.camera.camera import Camera
from services.mocap.camera.colour import read_colours
from services.mocap.errors import TakeError, load_toml, nearest, validated
from services.mocap.take.folder import Take, open_take
from services.mocap.take.layout import COLOURS
from services.mocap.take.pictures import check_png, check_size, read_picture
from services.mocap.take.settings import TakeSettings
from services.mocap.take.video import VideoReader, index_video
from services.mocap.types import Bytes

OPEN_END = 2**31 - 1
"""The number of frames of live input, which ends when somebody ends it."""
_URL = re.compile(r"(?:rtsps?|https?)://\S+")
_RTSP = ("rtsp://", "rtsps://")
_LEAST_CAMERAS = 3

Stamps: TypeAlias = Literal["container", "arrival"]


class LiveCamera(BaseModel):
    """A table [cameras.NAME]; a description says what its field has to be."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    source: int | str = Field(
        description="the number of a V4L2 device such as 0, an RTSP or HTTP address, or a video file's path"
    )
    stamps: Stamps | None = Field(
        default=None,
        description='"container" (the stamps that come with the pictures) or "arrival" (when they come)',
    )
    delay_s: float = Field(
        default=0.0, ge=0, le=10, description="seconds from the shutter to the stamp, 0 to 10"
    )
    group: str = Field(
        default="cameras", min_length=1, max_length=100, description="the name of a group of cameras"
    )

    @field_validator("source")
    @classmethod
    def _is_a_source(cls, source: int | str) -> int | str:
        if isinstance(source, int) and source < 0:
            raise ValueError(f"expected the number of a V4L2 device, 0 or more, found {source}")
        if isinstance(source, str) and (not source or ("://" in source and not _URL.fullmatch(source))):
            raise ValueError(
                f"expected an address that begins with rtsp:// or http://, or a file, found {source!r}"
            )
        return source

    @property
    def is_file(self) -> bool:
        """Whether the source is a file that is played at its own rate."""
        return isinstance(self.source, str) and not _URL.fullmatch(self.source)

    @property
    def has_stamps(self) -> bool:
        """Whether pictures come with stamps that say when they were taken: RTSP and devices do, HTTP not."""
        if self.stamps is not None:
            return self.stamps == "container"
        return isinstance(self.source, int) or self.source.startswith(_RTSP)


_Cameras: TypeAlias = Annotated[dict[str, dict[str, Any]], Field(min_length=1)]


class LiveSettings(BaseModel):
    """The fields of a live configuration; a description says what its field has to be."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    name: str = Field(
        min_length=1, max_length=200, description="a name for it in quotes, 200 letters at most"
    )
    fps: float = Field(gt=0, lt=1000, description="the cameras' frames per second, above 0")
    up: Up = Field(description='"y" or "z", the axis of the calibrated world that points up')
    calibration: str = Field(description="the path of a calibration.toml")
    cameras: _Cameras = Field(description="a table [cameras.NAME] with its source for every camera")
    background: str | None = Field(
        default=None,
        description="the path of a folder with the empty stage, NAME.png or NAME.mp4 of every camera",
    )
    colour: str | None = Field(
        default=None, description="the path of a colour.toml, as xormocap calibrate --colour writes it"
    )
    empty_stage_s: float = Field(
        default=2.0,
        gt=0,
        le=60,
        description="for how many seconds the stage stays empty at the start, above 0 to 60",
    )
    actor: str | None = Field(default=None, description="the path of an actor.toml")
    actor_height: float | None = Field(
        default=None, ge=0.5, le=2.5, description="the actor's height in metres, 0.5 to 2.5"
    )
    facing: float | None = Field(
        default=None, description="where the actor faces at first, in degrees about up, as in take.toml"
    )
    tolerance_s: float | None = Field(
        default=None,
        gt=0,
        le=1,
        description="how far apart in time a picture and its shot may be, above 0 to 1 second",
    )
    grace_s: float = Field(
        default=0.1, ge=0, le=5, description="how long a shot waits for cameras that are late, 0 to 5 seconds"
    )
    least_cameras: int = Field(
        default=_LEAST_CAMERAS, ge=2, description="how few cameras a shot may be solved from, 2 or more"
    )
    endpoint: str | None = Field(default=None, description="where the coordinator listens, tcp://HOST:PORT")
    elsewhere: list[str] = Field(default=[], description="a list of groups of cameras that other hosts serve")

    @property
    def period_s(self) -> float:
        """From one shot to the next."""
        return 1.0 / self.fps

    @property
    def reach_s(self) -> float:
        """How far from its shot's moment a picture may be: by default as far as half-way to the next, and a
        little more, so that one that hovers there does not jump to and fro."""
        return 0.6 * self.period_s if self.tolerance_s is None else self.tolerance_s


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveTake(Take):
    """Live input in the place of a recording, checked by `open_live`."""

    live: LiveSettings
    sources: tuple[LiveCamera, ...]
    """Of the cameras, in their order; paths are complete."""
    background_folder: Path | None
    """The empty stage; None: seen at the start."""
    colour_path: Path | None
    """Where colours come from; None: nothing is corrected."""

    def has_video(self, camera: Camera) -> bool:  # noqa: ARG002  (as of a take)
        """See Take: there is none to go back to."""
        return False

    def has_background(self, camera: Camera) -> bool:
        """See Take."""
        return self.plate(camera) is not None

    def background(self, camera: Camera) -> Iterator[Bytes]:
        """See Take; raises TakeError where there is none."""
        path = self.plate(camera)
        if path is None:
            raise TakeError(f"{self.folder}: has no picture of the empty stage of {camera.name}")
        colour = self.colours.get(camera.name)
        if path.suffix == ".png":
            picture = read_picture(path)
            yield picture if colour is None else colour.apply(picture)
            return
        with VideoReader(path, colour=colour) as reader:
            yield from reader

    @property
    def actor_path(self) -> Path | None:
        """See Take: the file that the configuration names, even if it is missing."""
        return None if self.live.actor is None else self.folder / self.live.actor

    def inputs(self, from_videos: bool) -> list[Path]:  # noqa: ARG002  (as of a take)
        """See Take: what stays the same from run to run."""
        files = [*(self.plate(camera) for camera in self.cameras), self.colour_path]
        return [self.folder / self.live.calibration, *(path for path in files if path is not None)]

    def groups(self) -> dict[str, list[int]]:
        """Cameras by their place in calibration.toml, group by group."""
        names = dict.fromkeys(source.group for source in self.sources)
        return {name: [c for c, one in enumerate(self.sources) if one.group == name] for name in names}

    def plate(self, camera: Camera) -> Path | None:
        """The file with a camera's empty stage, where there is one."""
        if self.background_folder is None:
            return None
        paths = [self.background_folder / f"{camera.name}{suffix}" for suffix in (".mp4", ".png")]
        return next((path for path in paths if path.exists()), None)


def open_source(path: Path) -> Take:
    """A take folder, or a live configuration's file, opened and checked; raises TakeError."""
    return open_live(path) if path.is_file() else open_take(path)


def open_live(path: Path) -> LiveTake:
    """Opens and checks a live configuration, but for whether its sources are there.

    Raises TakeError with one sentence about the first thing found wrong.
    """
    settings = validated(LiveSettings, load_toml(path, TakeError), f"{path}: ", TakeError)
    folder = path.resolve().parent
    cameras = read_calibration(folder / settings.calibration, settings.up)
    sources = _sources(path, settings, cameras)
    if settings.least_cameras > len(cameras):
        raise TakeError(
            f"{path}: least_cameras: expected at most {len(cameras)}, the cameras of {settings.calibration}"
        )
    for group in settings.elsewhere:
        if group not in (known := sorted({source.group for source in sources})):
            raise TakeError(
                f"{path}: elsewhere: {group}: no camera is of that group: {nearest(group, known)}"
            )
    background = None if settings.background is None else folder / settings.background
    colour_path = _colour_path(path, settings)
    take = LiveTake(
        folder=folder,
        settings=TakeSettings(
            name=settings.name,
            fps=settings.fps,
            units="m",
            up=settings.up,
            frames=OPEN_END,
            actor_height=settings.actor_height,
            facing=settings.facing,
        ),
        cameras=cameras,
        source="videos",
        colours=read_colours(colour_path, [camera.name for camera in cameras]) if colour_path else {},
        colour_path=colour_path,
        live=settings,
        sources=sources,
        background_folder=background,
    )
    _check_plates(path, take)
    return take


def _colour_path(path: Path, settings: LiveSettings) -> Path | None:
    """The file of colours that the configuration names, or else the one beside it, as in a take folder."""
    named = path.resolve().parent / (settings.colour or COLOURS)
    if named.exists():
        return named
    if settings.colour is not None:
        raise TakeError(
            f"{path}: colour: {named} is missing: expected a file as xormocap calibrate --colour writes it"
        )
    return None


def _sources(path: Path, settings: LiveSettings, cameras: tuple[Camera, ...]) -> tuple[LiveCamera, ...]:
    names = [camera.name for camera in cameras]
    for name in settings.cameras:
        if name not in names:
            raise TakeError(
                f"{path}: [cameras.{name}]: is no camera of {settings.calibration}: {nearest(name, names)}"
            )
    for name in names:
        if name not in settings.cameras:
            raise TakeError(f"{path}: [cameras.{name}] is missing: expected a table with its source")
    return tuple(_source(path, name, settings.cameras[name]) for name in names)


def _source(path: Path, name: str, table: dict[str, Any]) -> LiveCamera:
    source = validated(LiveCamera, table, f"{path}: [cameras.{name}] ", TakeError)
    if not source.is_file:
        return source
    file = path.resolve().parent / str(source.source)
    return source.model_copy(update={"source": str(file)})


def _check_plates(path: Path, take: LiveTake) -> None:
    if take.background_folder is None:
        return
    for camera in take.cameras:
        plate = take.plate(camera)
        if plate is None:
            raise TakeError(
                f"{take.background_folder}: holds neither {camera.name}.png nor {camera.name}.mp4: expected "
                f"the empty stage of every camera, or no background in {path}"
            )
        if plate.suffix == ".png":
            check_png(plate, camera)
        else:
            index = index_video(plate)
            check_size(plate, index.width_px, index.height_px, camera)
