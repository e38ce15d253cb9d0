"""How exact tracking is: joint errors where the truth is known, overlap of silhouettes, and lost limbs."""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from bench.command import Run, frame_numbers, track
from bench.degradations import Degradation, Trimaps, trimaps_of, write_harder
from bench.takes import take_folder
from services.mocap.body.actor import build_body
from services.mocap.camera.rig import Rig
from services.mocap.camera.undistort import Undistorter
from services.mocap.energy.bitplanes import TriPlanes, pack_trimaps
from services.mocap.fit.quality import quality_of
from services.mocap.take.folder import Take, open_take
from services.mocap.types import Floats, Trimap

PLAIN = "as it is"
_CHUNK = 50
"""Frames whose silhouettes are compared at a time."""


@dataclass(frozen=True)
class Row:
    """What one run gave; lengths in millimetres, overlaps (IoU) from 0 to 1."""

    take: str
    variant: str
    frames: int
    frames_per_s: float
    mean_mm: float | None
    """Joint errors over all frames and joints, as in joints.csv; None where the truth is not known."""
    median_mm: float | None
    p95_mm: float | None
    tracked_mean_mm: float | None
    """The mean before the results were smoothed."""
    lost_percent: float | None
    """Frames with a joint that is off by more than 200 mm."""
    silent_frames: int | None
    """Those of them that bear no mark."""
    distrusted_frames: int
    """Frames with a part that is marked as not to be trusted."""
    iou: float
    """Over all frames and cameras: the poses as tracked, and the silhouettes before they were made harder."""
    iou_worst_camera: float
    """The mean over the frames, of the camera where it is least."""
    iou_worst_frame: float
    """The mean over the cameras, of the frame where it is least."""
    growth_percent: float | None = None
    """By how much the mean error is larger than that of the take as it is; 1 - IoU without a known truth."""


def measure(name: str, frames: str, workers: int, options: tuple[str, ...], harder: bool) -> Iterator[Row]:
    """Track a take, and what degradations make of it: one row each. Raises UserError.

    name: a folder or a synthetic motion; frames: A:B; options: further ones of xormocap track. The harder
    ones get the actor of the take as it is.
    """
    folder = take_folder(name)
    take, shown = open_take(folder), name if name != str(folder) else folder.resolve().name
    with tempfile.TemporaryDirectory(prefix="xormocap-bench-") as temporary:
        scratch = Path(temporary)
        run = track(folder, scratch / "plain", frames, workers, options)
        trimaps = trimaps_of(take, scratch / "segmented")
        plain = _row(shown, PLAIN, run, overlaps(take, trimaps, run))
        yield plain
        for k, degradation in enumerate(Degradation if harder else ()):
            write_harder(scratch / f"take{k}", take, trimaps, run.actor, degradation)
            hard = track(scratch / f"take{k}", scratch / f"out{k}", frames, workers, options)
            row = _row(shown, degradation, hard, overlaps(take, trimaps, hard))
            yield replace(row, growth_percent=_growth_percent(plain, row))


def _row(take: str, variant: str, run: Run, iou: Floats) -> Row:
    """iou: (F, C)."""
    accuracy: dict[str, Any] = run.report.get("accuracy", {})
    tracked = run.report.get("accuracy_before_smoothing", accuracy)
    lost = accuracy.get("frames_with_lost_limbs")
    return Row(
        take=take,
        variant=variant,
        frames=len(run.poses.frames),
        frames_per_s=run.report["speed"]["frames_per_s"],
        mean_mm=accuracy.get("mean_mm"),
        median_mm=accuracy.get("median_mm"),
        p95_mm=accuracy.get("p95_mm"),
        tracked_mean_mm=tracked.get("mean_mm"),
        lost_percent=None if lost is None else 100.0 * lost / accuracy["frames"],
        silent_frames=run.silently_wrong_frames if accuracy else None,
        distrusted_frames=run.report["trust"]["distrusted_frames"],
        iou=float(iou.mean()),
        iou_worst_camera=float(iou.mean(axis=0).min()),
        iou_worst_frame=float(iou.mean(axis=1).min()),
    )


def _growth_percent(plain: Row, row: Row) -> float:
    if plain.mean_mm is not None and row.mean_mm is not None:
        return 100.0 * (row.mean_mm / plain.mean_mm - 1.0)
    return 100.0 * ((1.0 - row.iou) / (1.0 - plain.iou) - 1.0)


def overlaps(take: Take, trimaps: Trimaps, run: Run) -> Floats:
    """IoU (F, C) of a run's poses, as tracked, with a take's silhouettes."""
    rig, body = Rig.of(take.cameras), build_body(run.actor)
    numbers = frame_numbers(run)
    inputs = _packed(take, trimaps, numbers)
    found = []
    for first in range(0, len(numbers), _CHUNK):
        poses = run.poses.poses[first : first + _CHUNK]
        found.append(quality_of(body, poses, rig, TriPlanes.of_frames(list(islice(inputs, len(poses))))).iou)
    return np.concatenate(found)


def _packed(take: Take, trimaps: Trimaps, numbers: range) -> Iterator[TriPlanes]:
    """What is seen (P, H, W) in some frames, undistorted, all in the size of the largest picture."""
    readers = [islice(trimaps(camera), numbers.start, numbers.stop) for camera in take.cameras]
    undistorters = [Undistorter(camera) for camera in take.cameras]
    shape = max(c.height_px for c in take.cameras), max(c.width_px for c in take.cameras)
    for of_frame in zip(*readers, strict=True):
        common: Trimap = np.zeros((len(of_frame), *shape), np.uint8)
        for c, (undistorter, trimap) in enumerate(zip(undistorters, of_frame, strict=True)):
            common[c, : trimap.shape[0], : trimap.shape[1]] = undistorter.trimap(trimap)
        yield pack_trimaps(common)


def as_table(rows: Sequence[Row], workers: int) -> Table:
    """A line a run."""
    processes = f"coordinator and {workers} limb workers" if workers else "one process"
    table = Table(
        title=f"Accuracy, {processes}",
        box=SIMPLE_HEAD,
        padding=(0, 0, 0, 1),
        caption="Joint errors in mm. Lost: frames with a joint off by more than 200 mm, in brackets those "
        "without a mark. IoU: over all frames and cameras, in brackets the worst camera and the worst frame",
    )
    table.add_column("take", no_wrap=True)
    for column in ("frames", "fps", "mean", "median", "95 %", "lost", "marked", "IoU", "grows"):
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(f"{row.take}\n {row.variant}", *_cells(row))
    return table


def _cells(row: Row) -> tuple[str, ...]:
    lost = None if row.lost_percent is None else f"{row.lost_percent:.1f} % ({row.silent_frames})"
    growth = None if row.growth_percent is None else f"{row.growth_percent:+.0f} %"
    return (
        f"{row.frames}",
        f"{row.frames_per_s:.2f}",
        *("" if value is None else f"{value:.1f}" for value in (row.mean_mm, row.median_mm, row.p95_mm)),
        lost or "",
        f"{row.distrusted_frames}",
        f"{row.iou:.3f}\n({row.iou_worst_camera:.2f}, {row.iou_worst_frame:.2f})",
        growth or "",
    )
