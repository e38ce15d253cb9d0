"""The curves of one browser: energy, confidence, times, speed, over the last known frames."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
import viser
import viser.uplot

from services.mocap.take.quantities import QUANTITIES, STAGES, Quantity
from services.mocap.types import Floats, Ints
from services.viewer.frame_history import FrameHistory, Stretch

SPAN_FRAMES = 300
"""Number of frames in the curves; those up to the shown frame are shaded."""
_HEIGHT_PX = 130
_PAST = "rgba(16, 42, 67, 0.07)"
_COLOURS = ("#486581", "#2f9e44", "#f35e00", "#1e96f0", "#9c36b5", "#a67c00")
_SHOWN_STAGES = ("torso", "limbs", "head", "frame")
_MARGIN = 1.02
_MEDIAN_FRAMES = 9
_STAGE_WORDS = {"torso": "whole body", "limbs": "limbs", "head": "head", "frame": "frame in all"}


Draw: TypeAlias = Callable[[int], bool]
"""Draws a chart around a frame; False if there are no values."""


@dataclass
class _Chart:
    handle: "viser.GuiUplotHandle"
    floor: float | None
    """Its lowest value, if fixed."""


class Curves:
    """Charts of a history; each is sent as a whole, so they must not be drawn too often."""

    def __init__(self, gui: viser.GuiApi, history: FrameHistory) -> None:
        self._history = history
        known: list[tuple[_Chart, Callable[[Stretch], Floats]]] = [
            (self._quantity_chart(gui, row), partial(_shown, row)) for row in QUANTITIES if row.chart
        ]
        known.append((self._chart(gui, "Frames per second", ("tracked",)), _frames_per_s))
        self._lag = self._chart(gui, "Delay of this page in seconds", ("behind",))
        self._lags_s: deque[tuple[int, Floats]] = deque(maxlen=SPAN_FRAMES)
        self._turns = deque[Draw]([*(partial(self._draw, *chart) for chart in known), self._draw_lag])
        self._drawn: dict[Draw, int] = {}
        """The frame around which each chart was last drawn."""

    @classmethod
    def _quantity_chart(cls, gui: viser.GuiApi, row: Quantity) -> _Chart:
        if row.per == "frame":
            words = [row.name.partition("_")[0]]
        else:
            known = _STAGE_WORDS if row.per == "stage" else {}
            words = [known.get(label, label.replace("_", " ")) for label in _shown_labels(row)]
        limits = (0.0, _MARGIN * row.most) if np.isfinite(row.most) else None
        return cls._chart(gui, row.chart, words, limits)

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

    def draw_next(self, frame: int) -> bool:
        """Draw the next chart that has not been drawn around this frame; False if there is none.

        One at a time, because the next body waits while a chart is being sent. Charts without values are
        hidden.
        """
        for _ in range(len(self._turns)):
            draw = self._turns[0]
            self._turns.rotate(-1)
            if self._drawn.get(draw) != frame:
                self._drawn[draw] = frame
                if draw(frame):
                    return True
        return False

    def _draw(self, chart: _Chart, values_of: Callable[[Stretch], Floats], frame: int) -> bool:
        start = max(self._history.frames.start, frame - SPAN_FRAMES + 1)
        known = self._history.stretch(start, start + SPAN_FRAMES)
        return len(known.frames) > 1 and self._fill(chart, known.frames, frame, values_of(known))

    def note_lag(self, frame: int, behind_s: float) -> None:
        """Store the browser's delay for a live frame."""
        self._lags_s.append((frame, np.array([behind_s])))

    def _draw_lag(self, frame: int) -> bool:
        """Draw the stored delays, in the order of frames."""
        rows = dict(sorted(dict(self._lags_s).items()))
        frames, values = np.array(list(rows), np.int32), np.array(list(rows.values()))
        return len(rows) > 1 and self._fill(self._lag, frames, frame, values)

    @staticmethod
    def _fill(chart: _Chart, frames: Ints, frame: int, values: Floats) -> bool:
        """frames: (N,), values: (N, S) of the chart's series; up to a frame they are shaded."""
        has_any = bool(np.isfinite(values).any())
        if has_any:
            columns = np.nan_to_num(values, posinf=0.0).T  # a chart with only NaN has no scale
            has_more = frame < frames[-1]
            floor = columns.min() if chart.floor is None else chart.floor
            past = np.where(has_more & (frames <= frame), columns.max(), floor)
            chart.handle.data = (frames.astype(np.float64), *columns, past)
        if chart.handle.visible != has_any:
            chart.handle.visible = has_any
        return has_any


def _shown_labels(row: Quantity) -> tuple[str, ...]:
    return _SHOWN_STAGES if row.per == "stage" else row.labels


def _shown(row: Quantity, known: Stretch) -> Floats:
    """(N, k) of the labels that are shown; seconds as milliseconds."""
    values = known.of(row.name)[:, [row.labels.index(label) for label in _shown_labels(row)]]
    return 1e3 * values if row.unit == "s" else values


def _frames_per_s(known: Stretch) -> Floats:
    """(N, 1) tracking speed: running medians, robust against single late frames."""
    with np.errstate(divide="ignore"):
        values = 1.0 / known.of("seconds")[:, STAGES.index("frame")]
    padded = np.pad(values, _MEDIAN_FRAMES // 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, _MEDIAN_FRAMES)
    return np.median(windows, axis=1, keepdims=True)
