"""What a user does on the page, as the browser sends it."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, TypeAdapter

from services.mocap.errors import FrozenModel
from services.mocap.take.marks import Part
from services.viewer.tiles import Content


class Seen(FrozenModel):
    """The browser has taken in all messages up to a number."""

    do: Literal["seen"]
    number: int


class Seek(FrozenModel):
    """Show a frame."""

    do: Literal["seek"]
    frame: int


class StepBy(FrozenModel):
    """Go some frames on, or back."""

    do: Literal["step"]
    frames: int = Field(ge=-1000, le=1000)


class SeekDoubtful(FrozenModel):
    """Go to the next or previous doubtful frame, or stretch of such frames."""

    do: Literal["doubtful"]
    way: Literal[-1, 1]
    by_stretch: bool


class Play(FrozenModel):
    """Play, or stay; without a value the other of the two."""

    do: Literal["play"]
    on: bool | None = None


class Live(FrozenModel):
    """Follow the newest frame, or stay."""

    do: Literal["live"]
    on: bool


class Speed(FrozenModel):
    """Play at another speed, relative to the recording."""

    do: Literal["speed"]
    factor: float = Field(gt=0, le=16)


class ShowTiles(FrozenModel):
    """What the cameras' tiles show."""

    do: Literal["show"]
    content: Content
    part: Part | None
    """The part whose window is shown; None: whole pictures."""
    cameras: tuple[int, ...]


class Enlarge(FrozenModel):
    """Show one camera alone; None: all of those that were chosen."""

    do: Literal["enlarge"]
    camera: int | None


class Room(FrozenModel):
    """What the 3D view shows besides the body."""

    do: Literal["room"]
    frusta: bool
    trails: bool
    follow: bool
    """Whether the viewpoint moves with the actor."""


class Frame(FrozenModel):
    """Put the viewpoint where the actor, or the actor and all cameras, fill the view."""

    do: Literal["frame"]
    what: Literal["actor", "all"]


class Choose(FrozenModel):
    """The charts that are shown."""

    do: Literal["charts"]
    titles: tuple[str, ...] = Field(max_length=2)


Action: TypeAlias = Annotated[
    Seen | Seek | StepBy | SeekDoubtful | Play | Live | Speed | ShowTiles | Enlarge | Room | Frame | Choose,
    Field(discriminator="do"),
]
ACTIONS: TypeAdapter[Action] = TypeAdapter(Action)
