"""Milliseconds per picture of segmentation by stage, and how good its silhouettes are."""

import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from services.bench.takes import take_folder
from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import Undistorter
from services.mocap.errors import UserError
from services.mocap.take import layout
from services.mocap.take.folder import Take, open_take
from services.mocap.take.pictures import read_silhouette
from services.mocap.types import Mask
from services.segmentation.clean_plate import CleanPlate
from services.segmentation.cleanup import SegmentationSettings

_TRUE_SILHOUETTES = Path("reference") / layout.SILHOUETTES
_EDGE_PX = 1
"""Errors that near the true outline are those of its rounding to pixels; shadow is what lies beyond."""


@dataclass(frozen=True)
class Row:
    """One camera of a take; times are medians over its pictures, of one core's own time."""

    take: str
    camera: str
    pictures: int
    decode_ms: float
    statistics_ms: float
    """The exposure, the statistical test and the shadow test."""
    cleanup_ms: float
    """Edges settled, specks and holes."""
    undistort_ms: float
    total_ms: float
    """The median of the sums, which is not the sum of the medians."""
    iou: float | None
    """Mean over the pictures, raw silhouettes against reference/silhouettes; None where there are none."""
    worst_iou: float | None
    shadow_percent: float | None
    """Pixels called actor that lie off the true outline, over the actor's area; mean over the pictures."""


def measure(name: str) -> Iterator[Row]:
    """A row per camera of a take, camera after camera; raises UserError for takes without videos."""
    take = open_take(take_folder(name))
    if take.source == "silhouettes":
        raise UserError(f"{take.folder}: has ready silhouettes: expected videos and clean plates")
    for camera in take.cameras:
        yield _measured(take, camera)


def _measured(take: Take, camera: Camera) -> Row:
    plate = CleanPlate.learn(take.background(camera), SegmentationSettings())
    undistorter = Undistorter(camera)
    times_ms: list[tuple[float, ...]] = []
    qualities: list[tuple[float, float]] = []
    with take.video(camera) as video:
        pictures = iter(video)
        for frame in range(take.settings.frames):
            began_ms = _now_ms()
            picture = next(pictures)
            decoded_ms = _now_ms()
            plate.foreground(picture)
            tested_ms = _now_ms()
            mask = plate.silhouette(picture)  # tests once more, which is taken off below
            made_ms = _now_ms()
            undistorter.mask(mask)
            ended_ms = _now_ms()
            test_ms = tested_ms - decoded_ms
            clean_ms = max(made_ms - tested_ms - test_ms, 0.0)
            times_ms.append((decoded_ms - began_ms, test_ms, clean_ms, ended_ms - made_ms))
            qualities += _quality(take, camera, frame, mask)
    times_ms = times_ms[1:] or times_ms  # the first picture loads code
    decode, test, clean, undistort = (statistics.median(stage) for stage in zip(*times_ms, strict=True))
    total = statistics.median(sum(stages) for stages in times_ms)
    found = np.array(qualities).reshape(-1, 2)
    iou, worst, shadow = (
        (float(found[:, 0].mean()), float(found[:, 0].min()), float(100 * found[:, 1].mean()))
        if len(found)
        else (None, None, None)
    )
    of_take = take.settings.name, camera.name, take.settings.frames
    return Row(*of_take, decode, test, clean, undistort, total, iou, worst, shadow)


def _now_ms() -> float:
    """This thread's own time: that of other processes on the same cores does not count."""
    return time.thread_time() * 1e3


def _quality(take: Take, camera: Camera, frame: int, mask: Mask) -> list[tuple[float, float]]:
    """Overlap, and the share of what is no actor, of one mask; nothing where the truth is not known."""
    path = layout.silhouette_path(take.folder / _TRUE_SILHOUETTES / camera.name, frame)
    true = read_silhouette(path) if path.exists() else np.zeros(mask.shape, np.bool_)
    if not true.any():
        return []
    near = cv2.dilate(true.astype(np.uint8), np.ones((2 * _EDGE_PX + 1,) * 2, np.uint8)) > 0
    return [(float((mask & true).sum() / (mask | true).sum()), float((mask & ~near).sum() / true.sum()))]


def as_table(rows: list[Row]) -> Table:
    """A line a camera, and one for each take's frames: all of its cameras."""
    table = Table(
        title="Segmentation, milliseconds per picture on one core",
        box=SIMPLE_HEAD,
        caption=f"IoU: mean (worst picture). Shadow: pixels called actor more than {_EDGE_PX} px off the "
        "true outline, over the actor's area",
    )
    table.add_column("take", no_wrap=True)
    for column in ("camera", "decode", "statistics", "cleanup", "undistort", "total", "IoU", "shadow"):
        table.add_column(column, justify="right")
    for take in dict.fromkeys(row.take for row in rows):
        of_take = [row for row in rows if row.take == take]
        for row in of_take:
            table.add_row(take, row.camera, *_cells([row]))
        table.add_row(take, f"all {len(of_take)}", *_cells(of_take), end_section=True)
    return table


def _cells(rows: list[Row]) -> tuple[str, ...]:
    """Sums of times, means of qualities."""
    stages = [
        (row.decode_ms, row.statistics_ms, row.cleanup_ms, row.undistort_ms, row.total_ms) for row in rows
    ]
    times = tuple(f"{sum(stage):.2f}" for stage in zip(*stages, strict=True))
    ious = [row.iou for row in rows if row.iou is not None]
    worst = [row.worst_iou for row in rows if row.worst_iou is not None]
    shadows = [row.shadow_percent for row in rows if row.shadow_percent is not None]
    if not ious:
        return (*times, "", "")
    return (*times, f"{np.mean(ious):.4f} ({min(worst):.3f})", f"{np.mean(shadows):.3f} %")
