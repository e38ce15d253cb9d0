"""The curves of one browser: energy, confidence, times, speed, over the last frames that are known."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import viser
import viser.uplot

from services.mocap.take.marks import PARTS, Part
from services.mocap.types import Floats, Ints
from services.viewer.reel import STAGES, Reel

SPAN_FRAMES = 300
"""Frames that the curves show, of which those up to the one that is shown are shaded."""
_HEIGHT_PX = 130
_PAST = "rgba(16, 42, 67, 0.07)"
_COLOURS = ("#486581", "#2f9e44", "#f35e00", "#1e96f0", "#9c36b5", "#a67c00")
_SHOWN_STAGES = ("torso", "limbs", "head", "frame")
_STAGE_WORDS = {"torso": "whole body", "limbs": "limbs", "head": "head", "frame": "frame in all"}


@dataclass
class _Chart:
    handle: "viser.GuiUplotHandle"
    floor: float | None
    """Its lowest value, where that is settled."""


class Curves:
    """Charts of a reel; sent anew as a whole, so not to be drawn too often."""

    def __init__(self, gui: viser.GuiApi, reel: Reel) -> None:
        self._reel = reel
        self._energy = self._chart(gui, "Energy (differing pixels)", ("energy",))
        self._parts = self._chart(gui, "Energy by the nearest part", [_words(part) for part in PARTS])
        self._confidence = self._chart(gui, "Confidence", [_words(part) for part in PARTS], (0, 1.02))
        self._times = self._chart(gui, "Milliseconds", [_STAGE_WORDS[name] for name in _SHOWN_STAGES])
        self._speed = self._chart(gui, "Frames per second", ("tracked",))
        self._lag = self._chart(gui, "Seconds that this page is behind", ("behind",))
        self._lags_s: deque[tuple[int, Floats]] = deque(maxlen=SPAN_FRAMES)

    @staticmethod
    def _chart(
        gui: viser.GuiApi, title: str, names: Sequence[str], limits: tuple[float, float] | None = None
    ) -> _Chart:
        series = [
            viser.uplot.Series(label="frame"),
            *(
                viser.uplot.Series(label=name, stroke=_COLOURS[n % len(_COLOURS)], width=1.5)
                for n, name in enumerate(names)
            ),
            viser.uplot.Series(
                label="shown", width=0, fill=_PAST, points=viser.uplot.Series_Points(show=False)
            ),
        ]
        nothing = tuple(np.zeros(1) for _ in series)
        scales = {"x": viser.uplot.Scale(time=False)}
        if limits is not None:
            scales["y"] = viser.uplot.Scale(range=limits)
        handle = gui.add_uplot(
            nothing,
            tuple(series),
            title=title,
            scales=scales,
            height=_HEIGHT_PX,
            legend=viser.uplot.Legend(show=len(names) > 1),
            visible=False,
        )
        return _Chart(handle, None if limits is None else limits[0])

    def draw(self, frame: int) -> None:
        """Draw the frames about one; charts of which nothing is known stay away."""
        start = max(self._reel.frames.start, frame - SPAN_FRAMES + 1)
        known = self._reel.stretch(start, start + SPAN_FRAMES)
        if len(known.frames) < 2:
            return
        ms = 1e3 * known.seconds[:, [STAGES.index(name) for name in _SHOWN_STAGES]]
        self._fill(self._energy, known.frames, frame, known.energy_px[:, None])
        self._fill(self._parts, known.frames, frame, known.part_px)
        self._fill(self._confidence, known.frames, frame, known.confidence)
        self._fill(self._times, known.frames, frame, ms)
        with np.errstate(divide="ignore"):
            self._fill(
                self._speed,
                known.frames,
                frame,
                _smooth(1.0 / known.seconds[:, STAGES.index("frame")])[:, None],
            )

        self._fill_noted(self._lag, self._lags_s, frame)

    def note_lag(self, frame: int, behind_s: float) -> None:
        """Remember how late the browser was with a live frame."""
        self._lags_s.append((frame, np.array([behind_s])))

    def _fill_noted(self, chart: _Chart, noted: deque[tuple[int, Floats]], frame: int) -> None:
        """Draw what was remembered, in the order of frames."""
        rows = dict(sorted(dict(noted).items()))
        if len(rows) > 1:
            frames = np.array(list(rows), np.int32)
            self._fill(chart, frames, frame, np.array(list(rows.values())))

    @staticmethod
    def _fill(chart: _Chart, frames: Ints, frame: int, values: Floats) -> None:
        """frames: (N,), values: (N, S) of the chart's series; up to a frame they are shaded."""
        has_any = bool(np.isfinite(values).any())
        if has_any:
            columns = np.nan_to_num(values, posinf=0.0).T  # a chart without numbers only has no scale
            has_more = frame < frames[-1]
            floor = columns.min() if chart.floor is None else chart.floor
            past = np.where(has_more & (frames <= frame), columns.max(), floor)
            chart.handle.data = (frames.astype(np.float64), *columns, past)
        if chart.handle.visible != has_any:
            chart.handle.visible = has_any


def _words(part: Part) -> str:
    return part.replace("_", " ")


def _smooth(values: Floats, width: int = 9) -> Floats:
    """Running medians (N,), which single late frames do not upset."""
    padded = np.pad(values, width // 2, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, width), axis=1)
