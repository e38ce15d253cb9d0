"""take.toml: the user's description of a take."""

import math
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import tomli_w
from pydantic import Field, field_validator, model_validator

from services.mocap.atomic import write_file
from services.mocap.body.skeleton import DOFS, LOWER, UPPER
from services.mocap.camera.calibration import ByCamera, Up
from services.mocap.errors import StrictModel, TakeError, load_toml, nearest, validated
from services.mocap.take import layout
from services.mocap.types import UNSURE, Floats

LongestSide: TypeAlias = Annotated[
    int,
    Field(
        ge=32,
        le=16384,
        description="a number of pixels, 32 or more, to which larger pictures are reduced along their "
        "longer side",
    ),
]
LONGEST_SIDE = 1280
"""Larger pictures hardly make poses more exact, and the time grows with the number of pixels."""

_TABLES: dict[str, tuple[type, ...]] = {"videos": (str,), "offsets": (int,), "initial_pose": ()}
"""The tables and the types of their values; none where no row can be named like a field of the take."""
_DOF_OF_COLUMN = {dof.column: (i, dof) for i, dof in enumerate(DOFS)}


class TakeFile(StrictModel):
    """The fields of take.toml; a description states a field's valid values.

    `xormocap new` writes those with an example as comments.
    """

    name: str = Field(
        min_length=1, max_length=200, description="the take's name in quotes, 200 letters at most"
    )
    fps: float | None = Field(
        default=None, gt=0, lt=10000, description="a positive number of frames per second", examples=[50.0]
    )
    units: Literal["m"] = Field(description='"m", since all lengths are in metres')
    up: Up = Field(description='"y" or "z", the axis of the calibrated world that points up')
    frames: int | None = Field(
        default=None, ge=1, description="a whole number of frames, 1 or more", examples=[500]
    )
    videos: ByCamera[str] = Field(
        default={},
        description="a table of video files by camera, as paths from the take folder, such as "
        'cam01 = "videos/left.mov"',
    )
    longest_side: LongestSide = LONGEST_SIDE
    actor_height: float | None = Field(
        default=None, ge=0.5, le=2.5, description="the actor's height in metres, 0.5 to 2.5", examples=[1.75]
    )
    init_frames: int | None = Field(
        default=None,
        ge=1,
        description="a number of frames from where the work begins, 1 or more, to which the body is fitted; "
        "best if the actor then stands with arms and legs apart",
        examples=[10],
    )
    facing: float | None = Field(
        default=None,
        description="where the actor faces in the first frame, in degrees about up, counterclockwise "
        "seen from above, from the world's x axis (up = z) or z axis (up = y)",
        examples=[90.0],
    )
    offsets: ByCamera[int] = Field(
        default={},
        description="a table of whole frames, 0 or more, by which cameras are ahead, such as cam02 = 3",
    )
    unsure: list[int] = Field(
        default=[UNSURE, UNSURE],
        description="the lowest and the highest grey of silhouettes that mean unsure, 1 to 254, such as "
        "[64, 191], or [] if none does",
    )
    initial_pose: dict[str, float] = Field(
        default={}, description="a table of pose parameters in metres and radians, such as root_x_m = 0.5"
    )

    @field_validator("offsets")
    @classmethod
    def _not_negative(cls, offsets: dict[str, int]) -> dict[str, int]:
        for camera, offset in offsets.items():
            if offset < 0:
                raise ValueError(
                    f"{camera}: expected 0 or more frames, found {offset}: add to all cameras as many as "
                    "the one farthest behind needs"
                )
        return offsets

    @field_validator("unsure")
    @classmethod
    def _none_or_a_range(cls, unsure: list[int]) -> list[int]:
        if unsure and not (len(unsure) == 2 and 1 <= unsure[0] <= unsure[1] <= 254):
            raise ValueError(
                "expected two greys from 1 to 254, the lower one first, such as [64, 191], or [] if none "
                f"means unsure, found {unsure}"
            )
        return unsure

    @field_validator("initial_pose")
    @classmethod
    def _known_and_within_limits(cls, initial_pose: dict[str, float]) -> dict[str, float]:
        for column, value in initial_pose.items():
            if column not in _DOF_OF_COLUMN:
                raise ValueError(f"{column}: unknown parameter: {nearest(column, _DOF_OF_COLUMN)}")
            i, dof = _DOF_OF_COLUMN[column]
            if not LOWER[i] <= value <= UPPER[i]:
                raise ValueError(
                    f"{column}: expected {LOWER[i]:.3f} to {UPPER[i]:.3f} {dof.unit}, the limits of the "
                    f"joint, found {value:g}"
                )
        return initial_pose

    def offset(self, camera: str) -> int:
        """How many frames a camera is ahead: frame n + offset of its files shows the take's frame n."""
        return self.offsets.get(camera, 0)


class TakeSettings(TakeFile):
    """The settings of a take, of which the frame rate and the number of frames are known."""

    fps: float = Field(gt=0, lt=10000, description="a positive number of frames per second")
    frames: int = Field(ge=1, description="a whole number of frames, 1 or more")

    @model_validator(mode="after")
    def _init_within_frames(self) -> "TakeSettings":
        if self.init_frames is not None and self.init_frames > self.frames:
            raise ValueError(
                f"init_frames: expected at most frames = {self.frames}, found {self.init_frames}"
            )
        return self

    @property
    def facing_rad(self) -> float | None:
        """The root's heading in the first frame, if it is given."""
        return None if self.facing is None else math.radians(self.facing)

    def beginning_at(self, frame: int) -> "TakeSettings":
        """The hints for tracking from a frame on: hints about the first pose apply only to frame 0."""
        return self.model_copy(update={"facing": None, "initial_pose": {}}) if frame else self

    def with_initial_pose(self, pose: Floats) -> Floats:
        """A copy of the (D,) pose, with the parameters of `[initial_pose]`."""
        pose = pose.copy()
        for column, value in self.initial_pose.items():
            pose[_DOF_OF_COLUMN[column][0]] = value
        return pose


def read_take_file(path: Path) -> TakeFile:
    """Raises TakeError, which names the file and the field."""
    if path.parent.is_dir() and not path.exists():
        if (path.parent / layout.SILHOUETTES).is_dir():
            raise TakeError(
                f'{path}: is missing: expected a text file with the lines name = "…", fps = …, units = "m" '
                'and up = "z", beside the silhouettes'
            )
        raise TakeError(f"{path}: is missing: expected a take folder: xormocap new makes one from videos")
    data = load_toml(path, TakeError)
    for table, types in _TABLES.items():
        rows = data[table] if isinstance(data.get(table), dict) else {}
        for name, field in TakeFile.model_fields.items():  # a camera may be named like one
            is_missing = field.is_required() and name not in data
            if name in rows and (is_missing or not isinstance(rows[name], types)):
                raise misplaced(path, table, name)
    return validated(TakeFile, data, f"{path}: ", TakeError)


def misplaced(path: Path, table: str, field: str) -> TakeError:
    """The error that a field of take.toml is in one of its tables."""
    return TakeError(
        f"{path}: {table}: {field}: is a field of the take, not of this table: move it above [{table}]"
    )


def write_settings(path: Path, settings: TakeSettings) -> None:
    """Writes take.toml, without fields that were not given."""
    fields = settings.model_dump(exclude_none=True)
    if settings.unsure == [UNSURE, UNSURE]:
        del fields["unsure"]
    if settings.longest_side == LONGEST_SIDE:
        del fields["longest_side"]
    for table in _TABLES:
        if not fields[table]:
            del fields[table]
    write_file(path, tomli_w.dumps(fields))
