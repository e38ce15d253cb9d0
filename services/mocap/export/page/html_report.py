"""The report: a result's content on one page that can be mailed and printed."""

import base64
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jinja2 import Environment, StrictUndefined

from services.mocap.atomic import write_file
from services.mocap.errors import TakeError
from services.mocap.export.page import charts
from services.mocap.export.page.charts import svg_of
from services.mocap.result.layout import OVERLAY
from services.mocap.result.result import Result
from services.mocap.result.words import ENERGY_IN_WORDS, IOU_IN_WORDS, accuracy_in_words, rate_in_words
from services.mocap.take.fit_record import FIT_FOLDER, read_record
from services.mocap.take.fit_record import OVERLAY as FIT_OVERLAY
from services.mocap.take.pictures import read_picture
from services.mocap.take.video import VideoReader
from services.mocap.take.video_index import index_video
from services.mocap.types import Bytes, Floats
from services.mocap.verdict.judging import verdict_of

_PICTURE_WIDTH_PX = 1200
_JPEG_QUALITY = 78
_TEMPLATE = Path(__file__).with_name("report.html.j2")
Rows = list[tuple[str, str]]


def key_frames(overlay: Path, frames: list[int], energies_px: Floats, doubts: Floats | None = None) -> Rows:
    """The first, middle and last frame of an overlay, the one of the largest energy and the most doubtful.

    Each is a caption and a JPEG in base64; none where there is no overlay of these frames. frames: (N,) the
    numbers of the overlay's frames; energies_px: (N,) theirs; doubts: (N,) how doubtful each is, 0 if it is
    not.
    """
    if not overlay.exists():
        return []
    try:
        index = index_video(overlay)
        if index.n_frames != len(frames):
            return []
        last, worst = len(frames) - 1, int(np.argmax(energies_px))
        named = {0: "first", last // 2: "middle", last: "last", worst: "largest energy"}
        if doubts is not None and doubts.any():
            most = int(np.argmax(doubts))
            named[most] = "most doubtful, largest energy" if most == worst else "most doubtful"
        shown = []
        for row, why in sorted(named.items()):
            with VideoReader(index, row, row + 1) as video:
                picture = next(iter(video))
            caption = f"{why}: frame {frames[row]}, {energies_px[row]:.0f} pixels"
            shown.append((caption, _jpeg(picture)))
        return shown
    except TakeError:
        return []  # a page without pictures is better than none


def _jpeg(picture: Bytes) -> str:
    height_px, width_px = picture.shape[:2]
    if width_px > _PICTURE_WIDTH_PX:
        size = (_PICTURE_WIDTH_PX, round(height_px * _PICTURE_WIDTH_PX / width_px))
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
    _, encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return base64.b64encode(encoded.tobytes()).decode("ascii")


def write_report(path: Path, result: Result) -> None:
    """Write the page, completely or not at all. Content that is missing in the folder is left out."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = environment.from_string(_TEMPLATE.read_text(encoding="utf-8"))
    # How much the doubtful parts of each frame lack to full confidence; 0 without any.
    doubts = np.where(result.distrusted, 1.001 - np.nan_to_num(result.confidence), 0.0).sum(axis=1)
    overlay, verdict = result.folder / OVERLAY, verdict_of(result)
    told = set(map(str, verdict.causes))
    page = template.render(
        name=result.motion.name,
        verdict=verdict,
        words=(ENERGY_IN_WORDS, IOU_IN_WORDS),
        summary=_summary(result),
        pictures=key_frames(overlay, result.frames.tolist(), result.energies_px, doubts),
        fit_picture=_fit_picture(result.folder),
        fit_warnings=[sentence for sentence in _fit_warnings(result.folder) if sentence not in told],
        sections=list(_sections(result)),
        joint_errors=[
            (joint.replace("_", " "), f"{error:.1f} mm")
            for joint, error in result.run.get("accuracy", {}).get("mean_by_joint_mm", {}).items()
        ],
        tables=[(title, rows) for title, rows in _tables(result) if rows],
    )
    write_file(path, page)


def _fit_picture(folder: Path) -> str:
    """The fitted body over the pictures of its first frame, as a JPEG in base64; empty if there is none."""
    path = folder / FIT_FOLDER / FIT_OVERLAY
    try:
        return _jpeg(read_picture(path)) if path.exists() else ""
    except TakeError:
        return ""


def _fit_warnings(folder: Path) -> list[str]:
    """What the fit of the body warned of, such as furniture before it; empty if that is not known."""
    try:
        record = read_record(folder / FIT_FOLDER)
    except TakeError:
        return []
    return record.warnings if record is not None else []


def _summary(result: Result) -> Rows:
    run, n = result.run, len(result.frames)
    rows = [("frames", f"{n}, from {result.frames[0]} to {result.frames[-1]}")]
    rows.append(("time", f"{n / result.fps:.2f} s at {result.fps:g} frames per second"))
    if "accuracy" in run:
        accuracy = run["accuracy"]
        rows.append(("joint error", accuracy_in_words(accuracy)))
        rows.append(("lost limbs", f"{len(accuracy['lost_limbs'])}"))
    rows.append(("energy", f"median {np.median(result.energies_px):.0f} pixels that differ"))
    if "speed" in run:
        speed = run["speed"]
        rows.append(("tracked at", rate_in_words(speed["frames_per_s"])))
        rows.append(("first frame", f"{speed['first_frame_s']:.1f} s"))
    rows.append(("actor", f"{result.actor.height:.2f} m tall"))
    if "written" in run:
        rows.append(("tracked on", str(run["written"]).replace("T", " ").replace("+00:00", " UTC")))
    return rows


def _sections(result: Result) -> Iterator[tuple[str, str, str]]:
    """Title, explanation and chart."""
    yield (
        "Energy",
        "Look for steps and peaks. Below it the prior cost for the distance from the expected pose. Red, "
        "here and below: frames with doubtful parts.",
        svg_of(charts.energy, result),
    )
    known = result.quantities
    if "part_px" in known:
        yield (
            "Energy by part",
            "The same, each pixel counted to the part of the body that it is nearest to; legs, head dashed.",
            svg_of(charts.parts, result, known["part_px"]),
        )
        yield (
            "Overlap, by camera",
            "A curve for each camera, with its mean. A camera that stands out is out of step, badly "
            "calibrated or badly segmented.",
            svg_of(charts.overlaps_over_time, result, known["iou"]),
        )
    fit = result.run.get("fit")
    if fit:
        frames = f"{len(fit['energy_after_px'])} frames from {fit['first_frame']} to {fit['end_frame'] - 1}"
        yield (
            "Overlap of the fit, by camera",
            f"Mean IoU of the {frames} to which the actor was fitted. A camera that stands out is badly "
            "calibrated or badly segmented.",
            svg_of(charts.overlaps, fit["iou_after"]),
        )
    if result.tracked.marks is not None:
        yield (
            "Trust",
            "Confidence of each part. Red: doubtful; where the whole body is, all parts are. Grey: not "
            "judged.",
            svg_of(charts.trust, result),
        )
    yield (
        "Joint angles",
        "By the recommendations of the ISB, in degrees; angles.csv has all angles.",
        svg_of(charts.angles, result),
    )
    if seconds := known.get("seconds"):
        yield (
            "Time per frame",
            "Wall time of every frame and its stages.",
            svg_of(charts.timings, result, seconds),
        )


def _tables(result: Result) -> Iterator[tuple[str, Rows]]:
    run, settings = result.run, result.run.get("settings", {})
    lengths = result.actor.bone_lengths.items()
    yield (
        "Actor",
        [("height", f"{result.actor.height:.3f} m")]
        + [(name.replace("_", " "), f"{length_m:.3f} m") for name, length_m in lengths],
    )
    yield "Search", _flat(settings.get("search", {}))
    plain = {name: value for name, value in settings.items() if name != "search"}
    yield "Run", _flat({**plain, **run.get("output", {})})
    yield "Versions", _flat(run.get("versions", {}))


def _flat(values: Mapping[str, Any]) -> Rows:
    return [(name.replace("_", " "), _in_words(value)) for name, value in values.items()]


def _in_words(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {_in_words(one)}" for name, one in value.items()) or "none"
    if isinstance(value, list):
        return ", ".join(map(_in_words, value)) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)
