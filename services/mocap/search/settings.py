"""Every setting of the search, in one place."""

from collections.abc import Mapping
from typing import Annotated, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, field_validator

from services.mocap.energy.cost import Cost

_Weight = Annotated[float, Field(ge=0, le=1000)]
_Count = Annotated[int, Field(ge=1, le=15)]
GridCounts: TypeAlias = tuple[_Count, _Count, _Count, _Count]
"""Points along each axis; 15 keep the largest grid's poses within 100 MB."""

_GRID = "four whole numbers from 1 to 15, such as [5, 5, 3, 5]"
_SHARE = "a share, 0 or more and less than 1"
_UP_TO_1 = "a number above 0, 1 at most"
_UP_TO_100 = "a number from 0 to 100"


class SearchSettings(BaseModel):
    """How far and how finely a frame is searched. Travels with every limb task.

    The description of a field says what it has to be; the text below it what it does, in the README too.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    max_passes: int = Field(default=3, ge=1, le=20, description="a whole number from 1 to 20")
    """Rounds of torso, limbs and head over one frame, at most."""
    pass_tolerance: float = Field(default=0.01, ge=0, lt=1, description=_SHARE)
    """Passes end when one lowers the whole energy by less than this share."""
    arm_grid: GridCounts = Field(default=(5, 5, 3, 5), description=_GRID)
    """Points tried for shoulder elevation, forward, twist and elbow flexion."""
    leg_grid: GridCounts = Field(default=(7, 3, 3, 7), description=_GRID)
    """Points tried for hip flexion, abduction, twist and knee flexion."""
    grid_step_rad: float = Field(default=0.16, gt=0, le=1, description=_UP_TO_1)
    """Distance between grid points; a twist takes twice as much, since it shows less."""
    line_tolerance: float = Field(default=0.05, gt=0, lt=1, description="a share between 0 and 1")
    """Brent's line search ends at this share of a parameter's step."""
    angle_step_rad: float = Field(default=0.08, gt=0, le=1, description=_UP_TO_1)
    """First step of a line search over an angle."""
    shift_step_m: float = Field(default=0.03, gt=0, le=1, description=_UP_TO_1)
    """First step of a line search over a position."""
    descent_tolerance: float = Field(default=0.004, ge=0, lt=1, description=_SHARE)
    """A direction-set descent ends when one round lowers the energy by less than this share."""
    descent_rounds: int = Field(default=4, ge=1, le=100, description="a whole number from 1 to 100")
    """Rounds of a direction-set descent, at most."""
    detail_px: float = Field(default=0.5, ge=0, le=100, description=_UP_TO_100)
    """Level of detail: silhouettes of thinned meshes may be off by this many pixels of the working
    resolution; 0: always the full mesh."""
    distance_cap_px: float = Field(default=0.0, ge=0, le=50, description="a number from 0 to 50")
    """If positive, a differing pixel costs its distance to the input's contour, at most this many pixels."""
    camera_weights: tuple[_Weight, ...] = Field(
        default=(), description="a list of numbers from 0 to 1000, such as [1.0, 0.5, 1.0]"
    )
    """What each camera's pixels count, one factor per camera; none at all: all 1."""
    camera_cap: float = Field(default=0.0, ge=0, le=100, description=_UP_TO_100)
    """If positive, cameras whose energy exceeds this share of a middling camera's foreground pull little."""

    @field_validator("arm_grid", "leg_grid", "camera_weights", mode="before")
    @classmethod
    def _from_list(cls, value: object) -> object:
        """Messages and TOML know lists only."""
        return tuple(value) if isinstance(value, list) else value

    @field_validator("camera_weights")
    @classmethod
    def _some_weight(cls, weights: tuple[float, ...]) -> tuple[float, ...]:
        if weights and not any(weights):
            raise ValueError("expected at least one camera that counts, found only zeros")
        return weights

    @property
    def cost(self) -> Cost:
        """What differing pixels cost while searching; energies are reported as plain counts all the same."""
        return Cost(self.distance_cap_px, self.camera_weights, self.camera_cap)

    def to_wire(self) -> dict[str, bool | int | float | str | list[int] | list[float]]:
        """The settings as a message carries them."""
        return {name: list(v) if isinstance(v, tuple) else v for name, v in self.model_dump().items()}

    @classmethod
    def from_wire(cls, fields: Mapping[str, object]) -> "SearchSettings":
        """Check and take settings out of a message; raises ValueError (pydantic.ValidationError)."""
        return cls.model_validate(dict(fields))

    def widened(self) -> "SearchSettings":
        """For a first pose, when the limbs may be anywhere."""
        wide = {"max_passes": 4, "arm_grid": (9, 7, 3, 5), "leg_grid": (7, 5, 3, 7), "grid_step_rad": 0.3}
        return self.model_copy(update=wide)
