"""How good silhouettes are against true ones, segmenter by segmenter, and what a picture costs."""

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import resized_trimap
from services.mocap.errors import UserError
from services.mocap.take import layout
from services.mocap.take.folder import Take, open_take
from services.mocap.take.pictures import read_trimap
from services.mocap.types import ACTOR, UNSURE, Mask, Trimap
from services.segmentation.segmenters import make_segmenter

SEGMENTERS = ("clean-plate", "paper", "mog2")
"""Those that are compared unless others are asked for."""
_TRUE_SILHOUETTES = Path("reference") / layout.SILHOUETTES
_EDGE_PX = 1
"""Errors that near the true outline are those of its rounding to pixels; shadow is what lies beyond."""


@dataclass(frozen=True)
class Row:
    """One camera of a take by one segmenter; means over its pictures, unsure pixels left out."""

    take: str
    segmenter: str
    camera: str
    pictures: int
    ms: float
    """Per picture, decoding included: this thread's own time, the median over moments."""
    iou: float | None
    """Intersection over union with the true silhouette; None where none is known. So are those below."""
    worst_iou: float | None
    recall: float | None
    surplus: float | None
    """Pixels called actor that are none, over the true actor's area."""
    shadow: float | None
    """Those of them that lie more than a pixel off the true outline."""
    unsure: float | None
    """The share of the true actor's pixels that are unsure."""
    edge_px: float | None
    """Mean distance of the found outline from the true one."""


@dataclass(frozen=True)
class Quality:
    """One picture: see Row."""

    iou: float
    recall: float
    surplus: float
    shadow: float
    unsure: float
    edge_px: float


def measure(
    folder_of: Callable[[], Path], segmenters: Sequence[str] = SEGMENTERS, every: int = 1
) -> Iterator[Row]:
    """A row per segmenter and camera of a take; raises UserError for takes without videos.

    folder_of: finds the take's folder, or makes it. every: of how many frames one is looked at.
    """
    take = open_take(folder_of())
    if take.source == "silhouettes":
        raise UserError(f"{take.folder}: has ready silhouettes: expected videos and clean plates")
    for segmenter in segmenters:
        yield from _measured(take, segmenter, every)


def _measured(take: Take, name: str, every: int) -> list[Row]:
    segmenter = make_segmenter(take, take.cameras, name, lambda _: None)
    moments_ms: list[float] = []
    qualities: list[list[Quality]] = [[] for _ in take.cameras]
    moments = iter(segmenter.source.raw_moments(0, take.settings.frames))
    for frame in range(take.settings.frames):
        began_ms = _now_ms()
        trimaps = next(moments).trimaps
        moments_ms.append((_now_ms() - began_ms) / len(take.cameras))
        if frame % every == 0:
            for camera, trimap, found in zip(take.cameras, trimaps, qualities, strict=True):
                true = _true_silhouette(take, camera, frame)
                if true is not None:
                    found.append(quality_of(trimap, true))
    ms = statistics.median(moments_ms[1:] or moments_ms)  # the first one loads code
    return [
        _row(take, name, camera.name, len(moments_ms), ms, found)
        for camera, found in zip(take.cameras, qualities, strict=True)
    ]


def _row(take: Take, name: str, camera: str, pictures: int, ms: float, found: list[Quality]) -> Row:
    if not found:
        return Row(take.settings.name, name, camera, pictures, ms, *[None] * 7)
    mean = np.mean([[q.recall, q.surplus, q.shadow, q.unsure, q.edge_px] for q in found], axis=0)
    ious = [q.iou for q in found]
    return Row(
        take.settings.name, name, camera, pictures, ms, float(np.mean(ious)), min(ious), *map(float, mean)
    )


def _now_ms() -> float:
    """The processor time of this process's threads: what others do on the same cores does not count."""
    return time.process_time() * 1e3


def _true_silhouette(take: Take, camera: Camera, frame: int) -> Mask | None:
    """None where it is not known, or shows nobody."""
    path = layout.silhouette_path(take.folder / _TRUE_SILHOUETTES / camera.name, frame)
    if not path.exists():
        return None
    true: Mask = resized_trimap(read_trimap(path, ()), camera) == ACTOR
    return true if true.any() else None


def quality_of(trimap: Trimap, true: Mask) -> Quality:
    """How good a trimap (H, W) is, by the true silhouette (H, W), which is not empty."""
    actor, sure = trimap == ACTOR, trimap != UNSURE
    union, whole = int(((actor | true) & sure).sum()), int((true & sure).sum())
    near = cv2.dilate(true.astype(np.uint8), np.ones((2 * _EDGE_PX + 1,) * 2, np.uint8)) > 0
    area = int(true.sum())
    return Quality(
        iou=int((actor & true).sum()) / union if union else 1.0,
        recall=int((actor & true).sum()) / whole if whole else 1.0,
        surplus=int((actor & ~true).sum()) / area,
        shadow=int((actor & ~near).sum()) / area,
        unsure=int((true & ~sure).sum()) / area,
        edge_px=_edge_error_px(actor, true),
    )


def _edge_error_px(actor: Mask, true: Mask) -> float:
    """Mean distance in pixels of an outline from a true one; 0 where there is none."""
    outline = _outline(actor)
    if not outline.any():
        return 0.0
    away = cv2.distanceTransform((~_outline(true)).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return float(away[outline].mean())


def _outline(mask: Mask) -> Mask:
    return np.asarray(mask & (cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0))


def as_table(rows: list[Row]) -> Table:
    """A line for each take and segmenter, and at the end one for each segmenter: the mean and the worst."""
    table = Table(
        title="Silhouettes against true ones, unsure pixels left out",
        box=SIMPLE_HEAD,
        caption="Mean over pictures and cameras (worst camera). Recall: found of the actor. Surplus: called "
        f"actor, but none, over its area; shadow: of that more than {_EDGE_PX} px off the true outline. "
        "Unsure: of the actor. Edge: mean distance of the outlines, in pixels. ms: per picture on one core",
    )
    table.add_column("take", no_wrap=True)
    table.add_column("segmenter", no_wrap=True)
    for column in ("cameras", "IoU", "recall", "surplus", "shadow", "unsure", "edge px", "ms"):
        table.add_column(column, justify="right")
    names = list(dict.fromkeys(row.segmenter for row in rows))
    takes = list(dict.fromkeys(row.take for row in rows))
    for take in takes:
        for name in names:
            of_take = [row for row in rows if (row.take, row.segmenter) == (take, name)]
            table.add_row(take, name, str(len(of_take)), *_cells(of_take), end_section=name == names[-1])
    if len(takes) > 1:
        for name in names:
            table.add_row(f"all {len(takes)}", name, "", *_cells([r for r in rows if r.segmenter == name]))
    return table


def _cells(rows: list[Row]) -> tuple[str, ...]:
    ms = f"{np.mean([row.ms for row in rows]):.2f}" if rows else ""

    def column(field: str, worst: str) -> str:
        values = [getattr(row, field) for row in rows if getattr(row, field) is not None]
        if not values:
            return ""
        return f"{np.mean(values):.3f}" + (f" ({min(values) if worst == 'least' else max(values):.3f})")

    least = {"iou": "least", "recall": "least"}
    fields = ("iou", "recall", "surplus", "shadow", "unsure", "edge_px")
    return (*(column(field, least.get(field, "most")) for field in fields), ms)
