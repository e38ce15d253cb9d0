"""The fields of a live configuration: settings of all cameras, and each camera's source."""

import re
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, field_validator

from services.mocap.camera.calibration import ByCamera, Up
from services.mocap.errors import StrictModel
from services.mocap.take.settings import LONGEST_SIDE, LongestSide

_URL = re.compile(r"(?:rtsps?|https?)://\S+")
_RTSP = ("rtsp://", "rtsps://")
_LEAST_CAMERAS = 3

_FRESH_SHOTS, _FRESH_S = 4.0, 0.3

Stamps: TypeAlias = Literal["container", "arrival"]


class LiveCamera(StrictModel):
    """A table [cameras.NAME]; a field's description states its valid values."""

    source: int | str = Field(
        description="the number of a V4L2 device such as 0, an RTSP or HTTP address, or a video file's path"
    )
    stamps: Stamps | None = Field(
        default=None,
        description='"container" (the time stamps of the pictures) or "arrival" (the time of arrival)',
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
        """Whether pictures have time stamps: with RTSP and devices they do, with HTTP not."""
        if self.stamps is not None:
            return self.stamps == "container"
        return isinstance(self.source, int) or self.source.startswith(_RTSP)


_Cameras: TypeAlias = Annotated[ByCamera[dict[str, Any]], Field(min_length=1)]


class LiveSettings(StrictModel):
    """The fields of a live configuration; a description states a field's valid values."""

    name: str = Field(
        min_length=1, max_length=200, description="a name for it in quotes, 200 letters at most"
    )
    fps: float = Field(gt=0, lt=1000, description="the cameras' frames per second, above 0")
    up: Up = Field(description='"y" or "z", the axis of the calibrated world that points up')
    calibration: str = Field(description="the path of a calibration.toml")
    cameras: _Cameras = Field(description="a table [cameras.NAME] with its source for every camera")
    longest_side: LongestSide = LONGEST_SIDE
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
        description="seconds for which the stage stays empty at the start, above 0 to 60",
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
        description="largest time difference of a picture and its shot, above 0 to 1 second",
    )
    grace_s: float = Field(
        default=0.1, ge=0, le=5, description="how long a shot waits for late cameras, 0 to 5 seconds"
    )
    least_cameras: int = Field(
        default=_LEAST_CAMERAS, ge=2, description="least number of cameras of a shot, 2 or more"
    )
    endpoint: str | None = Field(default=None, description="where the coordinator listens, tcp://HOST:PORT")
    elsewhere: list[str] = Field(default=[], description="a list of groups of cameras that other hosts serve")

    @property
    def period_s(self) -> float:
        """Time from one shot to the next, in seconds."""
        return 1.0 / self.fps

    @property
    def reach_s(self) -> float:
        """Largest time difference of a picture and its shot: by default a little more than half the period,
        so that a picture half-way between two shots does not jump back and forth."""
        return 0.6 * self.period_s if self.tolerance_s is None else self.tolerance_s


def fresh_s(fps: float) -> float:
    """How old a shot, or the pose of one, may be and still count as abreast of the cameras, in seconds."""
    return _FRESH_SHOTS / fps + _FRESH_S
