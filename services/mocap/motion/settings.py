"""Every setting of the results, in one place."""

from typing import Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

Smoother: TypeAlias = Literal["none", "rts", "one-euro"]
CUTOFFS_HZ: dict[Smoother, float] = {"rts": 5.0, "one-euro": 4.0}
"""What serves each smoother best, by the joint errors of tracked takes whose truth is known."""


class OutputSettings(BaseModel):
    """How a take's results are made of its poses; nothing of it goes back into the search.

    The description of a field says what it has to be; the text below it what it does.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    smooth: Smoother = Field(default="rts", description="none, rts or one-euro")
    """rts (Rauch, Tung, Striebel) looks both ways, so nothing lags; one-euro looks back only, as live."""
    cutoff_hz: float | None = Field(
        default=None, gt=0, le=1000, description="a number of hertz, above 0 and at most 1000"
    )
    """rts lets slower motion by and takes away faster; to one-euro it is the least, for a body at rest, and
    rises with speed. None: what suits the smoother."""

    @property
    def hz(self) -> float:
        """The cutoff in hertz, whether it was said or not; raises KeyError where nothing is smoothed."""
        return CUTOFFS_HZ[self.smooth] if self.cutoff_hz is None else self.cutoff_hz
