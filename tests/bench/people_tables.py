"""The tables of `scripts/bench people`."""

from collections.abc import Iterator, Sequence
from typing import TypeAlias

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from bench import reliability
from bench.limb_scores import LOST_MM, RIGHT_MM
from bench.people import Outcome, Row
from bench.pose_floor import FAILED, Floor

Figures: TypeAlias = dict[str, float]
"""Column -> figure; NaN where it is not known."""
Measured: TypeAlias = list[tuple[Row, Figures]]

_CAMERAS = {"up to 3": (0, 3), "4 to 5": (4, 5), "6 to 8": (6, 8), "9 and more": (9, 64)}
"""Numbers of cameras that are summed up together: the fewest and the most."""
_BETTER_HIGH = ("fps",)
_TRACKED = (
    "Joint errors of joints.csv in mm, without what is a matter of definition; raw: with it. Lost: "
    f"limb-frames in % with a joint off by more than {LOST_MM:g} mm; silent: lost and not marked; false: "
    f"marked and within {RIGHT_MM:g} mm. Bones: mean error of four in %, and the worst one. Height: cm "
    "too tall"
)
_FLOOR = (
    "Floor: poses found from the true joints, then aligned with the silhouettes. Tracked: poses.csv, which "
    "is not smoothed. mm and % as above. Failures: frames in % in which the tracked pose has more than "
    f"{FAILED:g} times the energy of the floor's"
)


def as_tables(rows: Sequence[Row]) -> list[Table]:
    """Tracking take by take, the floor of those that were tracked, and the reliability of marks."""
    tracked = [(row, outcome_figures(row.outcome)) for row in rows if row.outcome]
    with_floor = [(row, floor_figures(row.floor)) for row in rows if row.floor]
    tables = [_tracked(rows, tracked)]
    if with_floor:
        tables.append(_floor(with_floor))
    if outcomes := [row.outcome for row in rows if row.outcome]:
        tables.append(reliability.as_table([outcome.reliability for outcome in outcomes]))
    return tables


def outcome_figures(outcome: Outcome) -> Figures:
    """What tracking gave."""
    errors, marks = outcome.errors, outcome.marks
    return {
        "mean": errors.mean_mm,
        "95 %": errors.p95_mm,
        "raw": errors.raw_mean_mm,
        "lost": errors.lost_percent,
        "silent": marks.silent_percent,
        "false": marks.false_percent,
        "marked": marks.marked_percent,
        "height": outcome.height_off_cm,
        "fps": outcome.frames_per_s,
        "bones": outcome.mean_bone_percent,
    }


def floor_figures(floor: Floor) -> Figures:
    """The best poses, and the tracked ones beside them."""
    best, tracked = floor.errors, floor.tracked_errors
    return {
        "floor mean": best.mean_mm,
        "floor 95 %": best.p95_mm,
        "floor lost": best.lost_percent,
        "tracked mean": tracked.mean_mm,
        "tracked 95 %": tracked.p95_mm,
        "tracked lost": tracked.lost_percent,
        "failures": floor.failures_percent,
    }


def _tracked(rows: Sequence[Row], tracked: Measured) -> Table:
    table = _empty("People who are not the body model, by xormocap track", _TRACKED)
    for figure in tracked[0][1] if tracked else ():
        table.add_column(figure, justify="right")
    table.add_column("worst bone")
    for row, figures in tracked:
        bone = row.outcome.worst_bone if row.outcome else ""
        off = f"{bone} {row.outcome.bones_off_percent[bone]:+.0f}" if row.outcome and bone else ""
        table.add_row(row.take, str(row.cameras), row.clothes, *_cells(figures), off)
    _add_sums(table, tracked)
    refused = [f"{row.take}, {row.cameras} cameras: refused: {row.refusal}" for row in rows if row.refusal]
    table.caption = "\n".join([_TRACKED, *refused])
    return table


def _floor(with_floor: Measured) -> Table:
    table = _empty("The best poses of the fitted bodies, and the tracked ones in the same frames", _FLOOR)
    for figure in with_floor[0][1]:
        table.add_column(figure, justify="right")
    for row, figures in with_floor:
        table.add_row(row.take, str(row.cameras), row.clothes, *_cells(figures))
    _add_sums(table, with_floor)
    return table


def _empty(title: str, caption: str) -> Table:
    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 0, 0, 1), caption=caption)
    table.add_column("take", no_wrap=True)
    table.add_column("cameras", justify="right")
    table.add_column("clothes", no_wrap=True)
    return table


def _add_sums(table: Table, measured: Measured) -> None:
    """Mean, median and worst of all takes; the means by number of cameras and by clothes."""
    if len(measured) < 2:
        return
    table.add_section()
    for name, figures in sums_of(measured).items():
        table.add_row(f"all {len(measured)}", "", name, *_cells(figures))
    for cameras, clothes, group in groups_of(measured):
        table.add_row(f"mean of {len(group)}", cameras, clothes, *_cells(sums_of(group)["mean"]))


def sums_of(measured: Measured) -> dict[str, Figures]:
    """The mean, the median and the worst of every figure, where it is known."""
    sums: dict[str, Figures] = {"mean": {}, "median": {}, "worst": {}}
    for figure in measured[0][1]:
        values = [figures[figure] for _, figures in measured if not np.isnan(figures[figure])] or [np.nan]
        sums["mean"][figure] = float(np.mean(values))
        sums["median"][figure] = float(np.median(values))
        sums["worst"][figure] = min(values) if figure in _BETTER_HIGH else max(values, key=abs)
    return sums


def groups_of(measured: Measured) -> Iterator[tuple[str, str, Measured]]:
    """Number of cameras, clothes, and the takes of these: by the one, then by the other, which is empty."""
    for name, (fewest, most) in _CAMERAS.items():
        if group := [(row, figures) for row, figures in measured if fewest <= row.cameras <= most]:
            yield name, "", group
    for clothes in sorted({row.clothes for row, _ in measured}):
        yield "", clothes, [(row, figures) for row, figures in measured if row.clothes == clothes]


def _cells(figures: Figures) -> list[str]:
    return ["" if np.isnan(value) else f"{value:.1f}" for value in figures.values()]
