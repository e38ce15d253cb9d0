"""Every setting of the search, in one place."""

from collections.abc import Collection, Sequence
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, Strict, field_validator

from services.mocap.body.skeleton import BodyName
from services.mocap.energy.cost import Cost
from services.mocap.errors import StrictModel

_Weight = Annotated[float, Field(ge=0, le=1000)]
_Count = Annotated[int, Field(ge=1, le=15)]
# Messages and TOML have only lists: the tuples are not strict, what is in them is.
_Weights: TypeAlias = Annotated[tuple[_Weight, ...], Strict(False)]
GridCounts: TypeAlias = Annotated[tuple[_Count, _Count, _Count, _Count], Strict(False)]
"""Points along each axis; 15 keep the largest grid's poses within 100 MB."""

_GRID = "four integers from 1 to 15, such as [5, 5, 3, 5]"
_SHARE = "a share, 0 or more and less than 1"
_UP_TO_1 = "a number above 0, 1 at most"


class SearchSettings(StrictModel):
    """How far and how finely a frame is searched. Travels with every limb task.

    The description of a field states its valid values; the docstring below states its effect, and is in a
    README table.
    """

    method: Literal["contours", "paper"] = Field(default="contours", description='"contours" or "paper"')
    """How poses are found: contours aligns the whole body with the silhouettes' outlines and searches limbs
    near remaining differences; paper minimises XOR for torso, limbs and head in turn."""
    body: BodyName = Field(default="anatomical", description='"anatomical" or "paper"')
    """Which pose parameters vary: all, or those of the published body, whose trunk is rigid; the others are
    zero."""
    both_ways: bool = Field(default=True, description="true or false")
    """With method contours, recorded takes are also tracked from the last frame back, and every frame is
    solved again from the best combination of both ways; live frames with doubtful parts likewise, from half a
    second later. If false, takes are tracked only forwards."""
    search_limbs: Literal["in doubt", "always", "never"] = Field(
        default="in doubt", description='"in doubt", "always" or "never"'
    )
    """Which limbs contours searches by XOR: those near differences, all in every frame, or none. Live frames
    that are late are solved with none, and so are, before a way back, frames whose poses an earlier run knows
    and that do not look doubtful."""
    contour_steps: int = Field(default=8, ge=2, le=100, description="an integer from 2 to 100")
    """Steps of an alignment with the contours."""
    contour_reach_px: int = Field(default=16, ge=2, le=64, description="an integer from 2 to 64")
    """How far from the body its contour is searched, in pixels of a picture 320 wide."""
    steadiness: float = Field(default=100.0, ge=0, le=1e6, description="a number from 0 to 1000000")
    """Prior weight towards the predicted pose: cost of a deviation of one radian or metre, in units of one
    squared pixel on one pixel of contour."""
    rest: float = Field(default=100.0, ge=0, le=1e6, description="a number from 0 to 1000000")
    """Weight of a prior that holds the hands straight (full weight), feet at a right angle and the waist not
    turned (a third), limbs untwisted and the waist not bent (a tenth); in the unit of steadiness."""
    contact: float = Field(default=6.0, ge=0, le=1000, description="a number from 0 to 1000")
    """Price of an arm inside the trunk or the head, and of a leg inside the other one: differing pixels for
    each camera and centimetre that its axis is inside, in pictures 320 wide."""
    pose_prior: float = Field(default=5.0, ge=0, le=1000, description="a number from 0 to 1000")
    """Price of arms and legs in poses that people seldom take: differing pixels for each camera and half of
    the squared distance from people's mean, in standard deviations, in pictures 320 wide; far away it grows
    less."""
    doubt_px: float = Field(default=30.0, ge=0, le=10000, description="a number from 0 to 10000")
    """A limb is searched by XOR if about this many more pixels than usual differ near it by more than the
    rim, in pictures 320 wide in eight cameras. Its confidence decides whether it is marked as doubtful."""
    windows: bool = Field(default=True, description="true or false")
    """Limbs, head, hands and feet are searched in windows, the torso at half resolution; false: everything in
    whole pictures."""
    prerender: bool = Field(default=True, description="true or false")
    """Draw only the moving segments and mask the rest; false: draw the whole body at every evaluation."""
    max_passes: int = Field(default=3, ge=1, le=20, description="an integer from 1 to 20")
    """Rounds of torso, limbs and head over one frame, at most."""
    pass_tolerance: float = Field(default=0.01, ge=0, lt=1, description=_SHARE)
    """Passes end when one lowers the whole energy by less than this share."""
    arm_grid: GridCounts = Field(default=(5, 5, 3, 5), description=_GRID)
    """Points tried for shoulder elevation, forward, twist and elbow flexion."""
    leg_grid: GridCounts = Field(default=(7, 3, 3, 7), description=_GRID)
    """Points tried for hip flexion, abduction, twist and knee flexion."""
    grid_step_rad: float = Field(default=0.16, gt=0, le=1, description=_UP_TO_1)
    """Distance between grid points; twice as much for a twist, because it is less visible."""
    typical_limbs: bool = Field(default=False, description="true or false")
    """Limbs are also tried as in poses that people take, wherever they were before. Searches for a first pose
    and for lost limbs do so in any case."""
    line_tolerance: float = Field(default=0.05, gt=0, lt=1, description="a share between 0 and 1")
    """Brent's line search ends at this share of a parameter's step."""
    angle_step_rad: float = Field(default=0.08, gt=0, le=1, description=_UP_TO_1)
    """First step of a line search over an angle."""
    shift_step_m: float = Field(default=0.03, gt=0, le=1, description=_UP_TO_1)
    """First step of a line search over a position."""
    descent_tolerance: float = Field(default=0.004, ge=0, lt=1, description=_SHARE)
    """A direction-set descent ends when one round lowers the energy by less than this share."""
    descent_rounds: int = Field(default=4, ge=1, le=100, description="an integer from 1 to 100")
    """Rounds of a direction-set descent, at most."""
    detail_px: float = Field(default=0.5, ge=0, le=100, description="a number from 0 to 100")
    """Level of detail: silhouettes of thinned meshes may be off by this many pixels of the working
    resolution; 0: always the full mesh."""
    camera_weights: _Weights = Field(
        default=(), description="a list of numbers from 0 to 1000, such as [1.0, 0.5, 1.0]"
    )
    """Weight of each camera's pixels, one factor per camera; empty: all 1."""
    colour: float = Field(default=1.0, ge=0, le=10, description="a number from 0 to 10")
    """What a pixel with a wrong colour class costs, in differing pixels, where classes were learnt; 0:
    colours do not count."""

    @field_validator("camera_weights")
    @classmethod
    def _some_weight(cls, weights: tuple[float, ...]) -> tuple[float, ...]:
        if weights and not any(weights):
            raise ValueError("expected at least one camera that counts, found only zeros")
        return weights

    @property
    def goes_both_ways(self) -> bool:
        """Whether a recorded take is tracked both ways."""
        return self.both_ways and self.method == "contours"

    @property
    def cost(self) -> Cost:
        """The cost of differing pixels in the search; reported energies are always plain counts."""
        return Cost(self.camera_weights, self.colour)

    def without_cameras(self, left_out: Collection[int], n_cameras: int) -> "SearchSettings":
        """The same with a weight of 0 for some of the cameras."""
        if not left_out:
            return self
        weights = self.cost.weights(n_cameras)
        weights[list(left_out)] = 0.0
        return self.model_copy(update={"camera_weights": tuple(weights.tolist())})

    def for_cameras(self, kept: Sequence[int]) -> "SearchSettings":
        """The same for a rig with only some of the cameras, in this order."""
        weights = tuple(self.camera_weights[c] for c in kept) if self.camera_weights else ()
        return self.model_copy(update={"camera_weights": weights})

    def aligned_only(self) -> "SearchSettings":
        """The same without a search of limbs, which takes several times as long as the rest."""
        return self.model_copy(update={"search_limbs": "never"})

    def widened(self) -> "SearchSettings":
        """For a first pose, when the limbs may be anywhere."""
        wide = {"arm_grid": (9, 7, 3, 5), "leg_grid": (7, 5, 3, 7), "grid_step_rad": 0.3}
        more = {"typical_limbs": True, "max_passes": 4, "search_limbs": "always"}
        return self.model_copy(update={**wide, **more})


Preset: TypeAlias = Literal["default", "paper", "plain"]
PRESETS: dict[Preset, SearchSettings] = {
    "default": SearchSettings(),
    "paper": SearchSettings(method="paper", body="paper", colour=0.0),
    "plain": SearchSettings(
        method="paper", body="paper", windows=False, prerender=False, detail_px=0.0, colour=0.0
    ),
}
"""The searches by name, for `--search`; --set and --settings modify them."""
