"""What each setting of the search does to speed and accuracy: one changed at a time."""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table

from bench.command import track
from bench.takes import take_folder
from services.mocap.errors import UserError
from services.mocap.search.settings import Preset

CHANGES: dict[Preset, tuple[str, ...]] = {
    "default": (
        "contour_steps=4",
        "contour_steps=16",
        "contour_reach_px=8",
        "contour_reach_px=32",
        "steadiness=10.0",
        "steadiness=1000.0",
        "rest=0.0",
        "rest=1000.0",
        'search_limbs="always"',
        "doubt_px=10.0",
        "doubt_px=100.0",
        "max_passes=1",
        "arm_grid=[3, 3, 1, 3]",
        "arm_grid=[9, 9, 3, 9]",
        "detail_px=0.0",
    ),
    "paper": (
        "windows=false",
        "prerender=false",
        "detail_px=0.0",
        "max_passes=1",
        "max_passes=6",
        "arm_grid=[3, 3, 1, 3]",
        "arm_grid=[9, 9, 3, 9]",
        "grid_step_rad=0.08",
        "grid_step_rad=0.32",
        "line_tolerance=0.2",
        "line_tolerance=0.01",
        "descent_rounds=1",
        "descent_tolerance=0.02",
    ),
}
"""Settings tried in each search, one by one; as --set takes them."""


@dataclass(frozen=True)
class Row:
    """One run, on one process."""

    take: str
    search: Preset
    change: str
    """What was set; empty: nothing."""
    frames: int
    ms_per_frame: float
    times_as_long: float
    """As the same search with nothing set, in this run of the bench."""
    evaluations_per_frame: float
    mean_mm: float | None
    """Joint error as tracked; None where the truth is not known."""
    p95_mm: float | None
    frames_with_lost_limbs: int | None


def measure(name: str, frames: str, searches: Sequence[Preset]) -> Iterator[Row | str]:
    """Track a take (a folder or a synthetic motion) once a change; one that cannot run says why."""
    folder = take_folder(name)
    for search in searches:
        plain_ms: float | None = None
        for change in ("", *CHANGES.get(search, ())):
            try:
                row = _run(folder, name, frames, search, change, plain_ms)
            except UserError as error:
                yield f"{name}, {change or search}: is left out: {error}"
                continue
            plain_ms = plain_ms or row.ms_per_frame
            yield row


def _run(folder: Path, name: str, frames: str, search: Preset, change: str, plain_ms: float | None) -> Row:
    changed = ("--set", change) if change else ()
    with tempfile.TemporaryDirectory(prefix="xormocap-bench-") as scratch:
        run = track(
            folder, Path(scratch) / "out", frames, 0, ("--search", search, "--smooth", "none", *changed)
        )
    speed, accuracy = run.report["speed"], run.report.get("accuracy", {})
    ms_per_frame = 1000.0 * speed["mean_s"]["frame"]
    return Row(
        take=name,
        search=search,
        change=change,
        frames=len(run.poses.frames),
        ms_per_frame=ms_per_frame,
        times_as_long=ms_per_frame / (plain_ms or ms_per_frame),
        evaluations_per_frame=speed["evaluations_per_frame"],
        mean_mm=accuracy.get("mean_mm"),
        p95_mm=accuracy.get("p95_mm"),
        frames_with_lost_limbs=accuracy.get("frames_with_lost_limbs"),
    )


def as_table(rows: Sequence[Row]) -> Table:
    """A line a run."""
    table = Table(title="Effects of settings, one process", box=SIMPLE_HEAD, padding=(0, 0, 0, 1))
    table.add_column("take and setting", no_wrap=True)
    for column in ("frames", "ms a frame", "times", "evals", "mean mm", "95 %", "lost"):
        table.add_column(column, justify="right")
    for row in rows:
        errors = [row.mean_mm, row.p95_mm]
        table.add_row(
            f"{row.take}, {row.search}" if not row.change else f"  {row.change}",
            f"{row.frames}",
            f"{row.ms_per_frame:.1f}",
            f"{row.times_as_long:.2f}",
            f"{row.evaluations_per_frame:,.0f}",
            *("" if value is None else f"{value:.1f}" for value in errors),
            "" if row.frames_with_lost_limbs is None else f"{row.frames_with_lost_limbs}",
        )
    return table
