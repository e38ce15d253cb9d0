"""The curves of the report, as SVG that goes into a page."""

import io
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Concatenate, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from services.mocap.export.tiles import LEFT_BGR, RIGHT_BGR
from services.mocap.motion.angles import ANGLES
from services.mocap.result.result import Result
from services.mocap.take.marks import PARTS, doubtful_parts
from services.mocap.types import Floats
from services.mocap.verdict.verdict import part_in_words, spans_of

P = ParamSpec("P")
_WIDTH_IN, _HEIGHT_IN = 9.6, 2.2
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",  # keep text as text, for searching and copying
    "svg.hashsalt": "xormocap",  # equal results give equal pages
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
}
_INK, _QUIET, _WARNING, _UNJUDGED = "#30363d", "#8b949e", "#d1242f", "#c3cad2"


def _screen(bgr: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*bgr[::-1])


_COLOURS = {"": _INK, "left": _screen(LEFT_BGR), "right": _screen(RIGHT_BGR)}
_SHOWN_ANGLES = (
    *("pelvis_rotation", "pelvis_tilt", "pelvis_list"),
    *("trunk_flexion", "trunk_rotation", "neck_flexion"),
    *("shoulder_elevation", "shoulder_plane_of_elevation", "elbow_flexion"),
    *("hip_flexion", "hip_adduction", "hip_rotation"),
    *("knee_flexion", "ankle_dorsiflexion", "forearm_pronation"),
)
_SIDED = {angle.name: angle.is_sided for angle in ANGLES}
_FIRST_OF_BOTH_SIDES = [_SIDED[name] for name in _SHOWN_ANGLES].index(True)


def svg_of(draw: Callable[Concatenate[Figure, P], None], *args: P.args, **kwargs: P.kwargs) -> str:
    """What one of the functions below draws on a figure of the page's width, as an <svg> element."""
    with mpl.rc_context(_STYLE):
        figure = Figure((_WIDTH_IN, _HEIGHT_IN), layout="constrained")
        draw(figure, *args, **kwargs)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    return text.getvalue()[text.getvalue().index("<svg") :]


def energy(figure: Figure, result: Result) -> None:
    """The energy and the prior cost over time; distrusted frames are shaded."""
    prior = result.tracked.extra.get("prior")
    figure.set_figheight(1.9 if prior is None else 3.2)
    axes = list(figure.subplots(1 if prior is None else 2, 1, sharex=True, squeeze=False)[:, 0])
    axes[0].plot(result.times_s, result.energies_px, color=_INK)
    axes[0].set_ylabel("energy (pixels)")
    if prior is not None:
        axes[1].plot(result.times_s, prior, color=_INK)
        axes[1].set_ylabel("prior (cost)")
    _finish(axes, result)


def parts(figure: Figure, result: Result, part_px: Mapping[str, Floats]) -> None:
    """The energy over time by the nearest part, limbs in the colours of their sides."""
    axes = figure.subplots()
    for part, values in part_px.items():
        side, _, limb = part.rpartition("_")
        style = "--" if limb == "leg" or part == "head" else "-"
        axes.plot(result.times_s, values, style, color=_COLOURS[side], label=part.replace("_", " "))
    axes.set_ylabel("energy (pixels)")
    _legend_beside(axes)
    _finish([axes], result)


def overlaps_over_time(figure: Figure, result: Result, iou: Mapping[str, Floats]) -> None:
    """Intersection over union over time, a curve for each camera."""
    axes = figure.subplots()
    colours = mpl.colormaps["viridis"](np.linspace(0.0, 0.92, max(len(iou), 1)))
    for colour, (camera, values) in zip(colours, iou.items(), strict=True):
        axes.plot(result.times_s, values, color=colour, label=f"{camera} ({values.mean():.3f})")
    axes.set_ylabel("IoU")
    _legend_beside(axes)
    _finish([axes], result)
    axes.set_ylim(max(0.0, min(float(values.min()) for values in iou.values()) - 0.02), 1.0)


def _legend_beside(axes: Axes) -> None:
    axes.legend(ncols=1, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))


def trust(figure: Figure, result: Result) -> None:
    """The confidence of each part over time; red where it is doubtful, grey where it was not judged."""
    axes = figure.subplots()
    half_s = 0.5 / result.fps
    left, right = float(result.times_s[0]) - half_s, float(result.times_s[-1]) + half_s
    shade = axes.imshow(
        result.confidence.T, aspect="auto", interpolation="nearest", vmin=0, vmax=1,
        cmap=mpl.colormaps["Greens"].with_extremes(bad=_UNJUDGED),
        extent=(left, right, len(PARTS) - 0.5, -0.5),
    )  # fmt: skip
    for row, frames in enumerate(doubtful_parts(result.distrusted).T):
        spans = [(time_s - half_s, 2 * half_s) for time_s in result.times_s[frames].tolist()]
        axes.broken_barh(spans, (row - 0.5, 1.0), color=_WARNING)
    axes.set_yticks(range(len(PARTS)), [part_in_words(part) for part in PARTS])
    axes.grid(visible=False)
    axes.set_xlabel("time (s)")
    figure.colorbar(shade, ax=axes, label="confidence", pad=0.01)


def angles(figure: Figure, result: Result) -> None:
    """A choice of the joint angles over time: the left side's orange, the right side's blue."""
    figure.set_figheight(1.8 * len(_SHOWN_ANGLES) / 3)
    figure.set_layout_engine(None)  # finding one takes a second for so many
    figure.subplots_adjust(left=0.05, right=0.99, top=0.97, bottom=0.06, hspace=0.3, wspace=0.2)
    axes = figure.subplots(len(_SHOWN_ANGLES) // 3, 3, sharex=True).ravel()
    for place, name in zip(axes, _SHOWN_ANGLES, strict=True):
        for side in ("left", "right") if _SIDED[name] else ("",):
            values = result.angles_deg[f"{side}_{name}".removeprefix("_")]
            place.plot(result.times_s, values, color=_COLOURS[side], label=side)
        place.set_title(name.replace("_", " ") + " (°)", fontsize=9, loc="left")
        _shade(place, result)
    axes[_FIRST_OF_BOTH_SIDES].legend(ncols=2, fontsize=8, loc="best")
    for place in axes[-3:]:
        place.set_xlabel("time (s)")


def timings(figure: Figure, result: Result, seconds: Mapping[str, Floats]) -> None:
    """Milliseconds per frame: all of it, and its stages."""
    axes = figure.subplots()
    for stage in sorted(seconds, key=lambda name: name != "frame"):
        is_whole = stage == "frame"
        axes.plot(
            result.times_s,
            1000 * seconds[stage],
            color=_INK if is_whole else None,
            alpha=1.0 if is_whole else 0.7,
            label="whole frame" if is_whole else stage.replace("_", " "),
        )
    axes.set_yscale("symlog", linthresh=10)  # the first frame takes a hundred times as long
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.set_ylabel("ms")
    _legend_beside(axes)
    _finish([axes], result)


def overlaps(figure: Figure, iou: Mapping[str, float]) -> None:
    """Overlap of model and silhouette in each camera."""
    figure.set_figheight(1.9)
    axes = figure.subplots()
    bars = axes.bar(list(iou), list(iou.values()), color=_QUIET, width=0.6)
    axes.bar_label(bars, fmt="%.3f", fontsize=8)
    axes.set_ylim(min(0.8, *iou.values()) - 0.05, 1.0)
    axes.set_ylabel("IoU")
    axes.grid(visible=False, axis="x")


def _finish(axes: Sequence[Axes], result: Result) -> None:
    """Shade distrusted frames, and label the lowest axis."""
    half_s = 0.5 / result.fps
    for place in axes:
        _shade(place, result)
        place.set_xlim(float(result.times_s[0]) - half_s, float(result.times_s[-1]) + half_s)
        place.set_ylim(bottom=0)
    axes[-1].set_xlabel("time (s)")


def _shade(place: Axes, result: Result) -> None:
    """Bands over the stretches of distrusted frames."""
    half_s = 0.5 / result.fps
    for first, last in spans_of(np.asarray(result.distrusted.any(axis=1), bool)):
        start_s, end_s = float(result.times_s[first]) - half_s, float(result.times_s[last]) + half_s
        place.axvspan(start_s, end_s, color=_WARNING, alpha=0.15, linewidth=0)
