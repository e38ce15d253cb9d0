"""Every setting of the results, in one place."""

from typing import Literal, TypeAlias

from pydantic import Field

from services.mocap.errors import StrictModel

Smoother: TypeAlias = Literal["none", "rts", "one-euro"]
ONE_EURO_HZ = 4.0
"""The best cutoff of one-euro, by the joint errors of tracked takes with a reference."""


class OutputSettings(StrictModel):
    """How results are made from a take's poses; this does not affect the search.

    The description of a field states its valid values; the docstring below states its effect.
    """

    smooth: Smoother = Field(default="rts", description="none, rts or one-euro")
    """rts (Rauch, Tung, Striebel) looks forward and back, so nothing lags; one-euro looks back only, as live
    tracking must."""
    cutoff_hz: float | None = Field(
        default=None, gt=0, le=1000, description="a number of hertz, above 0 and at most 1000"
    )
    """Cutoff frequency: rts keeps slower motion and removes faster motion; for one-euro it is the minimum,
    for a body at rest, and rises with speed. None: rts finds the one that suits the motion; one-euro has
    ONE_EURO_HZ."""
