"""The paper's table 2: seconds per frame, by plain XOR, with windows and pre-rendering, and distributed."""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from bench.command import Run, track
from bench.takes import take_folder
from services.mocap.errors import UserError
from services.mocap.search.settings import SearchSettings
from services.mocap.take.folder import open_take

SEQUENCES = {"basic": "A", "dance": "B"}
"""The motion of ours that is like a sequence of the paper's."""
FIVE = 4
"""Limb workers of five processes: the fifth is the coordinator."""


@dataclass(frozen=True)
class Way:
    """One row: how frames are solved."""

    name: str
    options: tuple[str, ...]
    """Of xormocap track."""
    workers: int
    paper_s: dict[str, float]
    """The paper's seconds per frame by sequence, on machines with 1.8 GHz Xeon and GeForce3; may be empty."""
    most_frames: int | None
    """Slow ways are measured on so many frames at the start, unless all are asked for."""


_DETAIL_PX = SearchSettings().detail_px
PLAIN = Way("plain XOR, one process", ("--search", "plain"), 0, {"A": 7.98, "B": 14.1}, 25)
WAYS: tuple[Way, ...] = (
    PLAIN,
    Way("plain XOR of thinned meshes", ("--search", "plain", "--set", f"detail_px={_DETAIL_PX}"), 0, {}, 25),
    Way("windows, pre-rendering, one process", ("--search", "paper"), 0, {"A": 3.30, "B": 10.1}, 100),
    Way("the same, five processes", ("--search", "paper"), FIVE, {"A": 1.16, "B": 1.76}, 100),
    Way("default, one process", (), 0, {}, None),
    Way("default, five processes", (), FIVE, {}, None),
)


@dataclass(frozen=True)
class Row:
    """One measured figure."""

    way: str
    take: str
    processes: int
    """Coordinator and limb workers; segmentation and recorder, which hardly compute, come on top."""
    frames: int
    seconds_per_frame: float
    """Wall time of the frames after the first, whose pose has to be found from nothing."""
    paper_s: float | None
    evaluations_per_frame: float
    stages_s: dict[str, float]
    """Mean seconds per frame of each stage, by the names of run.json."""
    critical_path_s: float | None
    """A projection, not a measurement: what five machines would take if messages cost nothing. Torso, slowest
    limb and head of each frame, as solved one after the other by one process, added up; the mean."""
    mean_mm: float | None
    lost_percent: float | None
    times_plain: float | None
    """How many times as fast as plain XOR on one process, in this run and on this take."""


def measure(name: str, frames: str, ways: Sequence[Way], all_frames: bool) -> Iterator[Row | str]:
    """Measure ways on a take (a folder or a synthetic motion) one by one; one that cannot run says why."""
    folder = take_folder(name)
    asked = open_take(folder).frame_range(frames)
    plain_s: float | None = None
    for way in ways:
        count = len(asked) if all_frames or way.most_frames is None else min(way.most_frames, len(asked))
        try:
            with tempfile.TemporaryDirectory(prefix="xormocap-bench-") as scratch:
                some = f"{asked.start}:{asked.start + count}"
                run = track(folder, Path(scratch) / "out", some, way.workers, way.options)
        except UserError as error:
            yield f"{way.name}, {name}: is left out: {error}"
            continue
        row = _row(way, name, run, plain_s)
        plain_s = row.seconds_per_frame if way is PLAIN else plain_s
        yield row


def _row(way: Way, take: str, run: Run, plain_s: float | None) -> Row:
    speed: dict[str, Any] = run.report["speed"]
    accuracy: dict[str, Any] = run.report.get("accuracy", {})
    seconds = 1.0 / speed["frames_per_s"]
    return Row(
        way=way.name,
        take=take,
        processes=1 + way.workers,
        frames=len(run.poses.frames),
        seconds_per_frame=seconds,
        paper_s=way.paper_s.get(SEQUENCES.get(take, "")),
        evaluations_per_frame=speed["evaluations_per_frame"],
        stages_s=speed["mean_s"],
        critical_path_s=None if way.workers else speed.get("critical_path_s"),
        mean_mm=accuracy.get("mean_mm"),
        lost_percent=100.0 * accuracy["frames_with_lost_limbs"] / accuracy["frames"] if accuracy else None,
        times_plain=1.0 if way is PLAIN else plain_s and plain_s / seconds,
    )


def as_tables(rows: Sequence[Row]) -> list[Table]:
    """One table a take, a line a way."""
    return [
        _table(take, [row for row in rows if row.take == take])
        for take in dict.fromkeys(r.take for r in rows)
    ]


def _table(take: str, rows: Sequence[Row]) -> Table:
    sequence = SEQUENCES.get(take)
    beside = f", beside the paper's sequence {sequence} of 2003" if sequence else ""
    table = Table(
        title=f"Seconds per frame, {take}{beside}",
        caption="2003: each process on a machine of its own. Projection: torso, slowest limb and head of one "
        "process added up, as if five machines did them and messages cost nothing",
        box=SIMPLE_HEAD,
        padding=(0, 0, 0, 1),
    )
    table.add_column("", no_wrap=True)
    columns = ("2003", "now", "× plain", "evals", "torso", "limbs", "head", "projection", "mm", "frames")
    for column in columns:
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(row.way, *_cells(row))
    return table


def _cells(row: Row) -> tuple[str, ...]:
    return (
        _said(row.paper_s, ".2f"),
        f"{row.seconds_per_frame:.3f}",
        _said(row.times_plain, ".1f"),
        f"{row.evaluations_per_frame:,.0f}",
        *(_said(row.stages_s.get(name), ".3f") for name in ("torso", "limbs", "head")),
        _said(row.critical_path_s, ".3f"),
        _said(row.mean_mm, ".1f"),
        f"{row.frames}",
    )


def _said(value: float | None, digits: str) -> str:
    return "" if value is None else format(value, digits)
