"""How reliable confidences and marks are: of the limb-frames that they say the same of, how many are lost."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.box import SIMPLE_HEAD
from rich.table import Table
from scipy.stats import binomtest

from bench.limb_scores import LOST_MM
from services.mocap.types import Floats, Mask

_ENDS = (0.0, 0.4, 0.6, 0.8, 0.9, 0.95, 0.98, 1.0)
"""Of the bins of confidence, which are narrow where most confidences are."""
MARKED, NOT_MARKED, NOT_JUDGED = "marked", "not marked", "no confidence"


@dataclass(frozen=True)
class Counted:
    """Limb-frames of which the same was said."""

    limb_frames: int
    lost: int
    marked: int

    def __add__(self, other: "Counted") -> "Counted":
        return Counted(
            self.limb_frames + other.limb_frames, self.lost + other.lost, self.marked + other.marked
        )


def reliability_of(limbs_mm: Floats, marked: Mask, confidence: Floats) -> dict[str, Counted]:
    """What was said -> the limb-frames of which it was said, with empty ones left out.

    limbs_mm: (F, 4) the error of each limb; marked and confidence: (F, 4), NaN where a limb was not judged.
    """
    lost = limbs_mm > LOST_MM
    told = {MARKED: marked, NOT_MARKED: ~marked, NOT_JUDGED: np.isnan(confidence)}
    for low, high in pairwise(_ENDS):
        told[_name(low, high)] = (confidence >= low) & ((confidence < high) | (high == 1.0))
    return {
        name: Counted(int(chosen.sum()), int((lost & chosen).sum()), int((marked & chosen).sum()))
        for name, chosen in told.items()
        if chosen.any()
    }


def _name(low: float, high: float) -> str:
    return f"confidence {low:.2f} to {high:.2f}"


def together(several: Iterable[Mapping[str, Counted]]) -> dict[str, Counted]:
    """The sums over takes; marks come first, then confidences in order."""
    sums: dict[str, Counted] = defaultdict(lambda: Counted(0, 0, 0))
    for of_take in several:
        for name, counted in of_take.items():
            sums[name] += counted
    order = (MARKED, NOT_MARKED, NOT_JUDGED)
    return {name: sums[name] for name in (*filter(sums.__contains__, order), *sorted(sums.keys() - {*order}))}


def as_table(several: Iterable[Mapping[str, Counted]]) -> Table:
    """A line for each thing that may be said of a limb."""
    table = Table(
        title="Reliability of marks and confidences",
        box=SIMPLE_HEAD,
        caption=f"Limb-frames: each arm and leg in each frame. Lost: a joint is off by more than {LOST_MM:g} "
        "mm. Marked: the limb or the torso is distrusted",
    )
    table.add_column("said of a limb")
    for column in ("limb-frames", "lost", "lost of them", "marked of them"):
        table.add_column(column, justify="right")
    for name, counted in together(several).items():
        shares = (f"{100.0 * n / counted.limb_frames:.1f} %" for n in (counted.lost, counted.marked))
        table.add_row(name, f"{counted.limb_frames}", f"{counted.lost}", *shares)
    return table


def draw(several: Iterable[Mapping[str, Counted]], path: Path) -> None:
    """Write a picture, of the type that its name ends in: how many limbs of each confidence are not lost.

    Bars are Wilson's intervals of 95 %, as if frames were independent, which neighbours are not.
    """
    sums = together(several)
    figure = Figure((5.2, 4.2), layout="constrained")
    axes = figure.subplots()
    axes.plot((0, 1), (0, 1), "--", color="0.6", label="says what happens")
    for low, high in pairwise(_ENDS):
        counted = sums.get(_name(low, high))
        if counted is None:
            continue
        kept, all_of_them = counted.limb_frames - counted.lost, counted.limb_frames
        interval = binomtest(kept, all_of_them).proportion_ci(method="wilson")
        axes.plot(((low + high) / 2,) * 2, (interval.low, interval.high), color="tab:blue")
        axes.plot((low, high), (kept / all_of_them,) * 2, color="tab:blue", linewidth=3)
        axes.annotate(f"{all_of_them:,}", ((low + high) / 2, interval.low), (0, -4), rotation=90,
                      textcoords="offset points", ha="center", va="top", fontsize=7)  # fmt: skip
    axes.set(xlabel="confidence of a limb", ylabel=f"share of limb-frames within {LOST_MM:g} mm")
    axes.legend(loc="upper left", frameon=False)
    figure.savefig(path, dpi=110)
