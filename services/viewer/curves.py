"""The curves of one browser: energy, confidence, times, speed, over the last frames that are known."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import viser
import viser.uplot

from services.mocap.take.marks import PARTS
from services.mocap.types import Floats
from services.viewer.reel import STAGES, Reel, Stretch

SPAN_FRAMES = 300
"""Frames that the curves show, up to the one that is shown."""
_HEIGHT_PX = 130
_COLOURS = ("#486581", "#2f9e44", "#f35e00", "#1e96f0", "#9c36b5", "#a67c00")
_SHOWN_STAGES = ("torso", "limbs", "head", "frame")
_STAGE_WORDS = {"torso": "whole body", "limbs": "limbs", "head": "head", "frame": "frame in all"}


@dataclass
class _Chart:
    handle: "viser.GuiUplotHandle"
    names: Sequence[str]


class Curves:
    """Charts of a reel; sent anew as a whole, so not to be drawn too often."""

    def __init__(self, gui: viser.GuiApi, reel: Reel) -> None:
        self._reel = reel
        self._energy = self._chart(gui, "Energy (differing pixels)", ("energy",))
        self._confidence = self._chart(
            gui, "Confidence", [part.replace("_", " ") for part in PARTS], (0, 1.02)
        )
        self._times = self._chart(gui, "Milliseconds", [_STAGE_WORDS[name] for name in _SHOWN_STAGES])
        self._speed = self._chart(gui, "Frames per second", ("tracked",))

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
        return _Chart(handle, names)

    def draw(self, frame: int) -> None:
        """Draw the frames up to one; charts of which nothing is known stay away."""
        known = self._reel.stretch(frame - SPAN_FRAMES + 1, frame + 1)
        if len(known.frames) < 2:
            return
        ms = 1e3 * known.seconds[:, [STAGES.index(name) for name in _SHOWN_STAGES]]
        self._fill(self._energy, known, known.energy_px[:, None])
        self._fill(self._confidence, known, known.confidence)
        self._fill(self._times, known, ms)
        with np.errstate(divide="ignore"):
            self._fill(self._speed, known, _smooth(1.0 / known.seconds[:, STAGES.index("frame")])[:, None])

    @staticmethod
    def _fill(chart: _Chart, known: Stretch, values: Floats) -> None:
        """values: (N, S)."""
        has_any = bool(np.isfinite(values).any())
        if has_any:
            columns = np.nan_to_num(
                values, posinf=0.0
            ).T  # what is not a number leaves a chart without a scale
            chart.handle.data = (known.frames.astype(np.float64), *columns)
        if chart.handle.visible != has_any:
            chart.handle.visible = has_any


def _smooth(values: Floats, width: int = 9) -> Floats:
    """Running medians (N,), which single late frames do not upset."""
    padded = np.pad(values, width // 2, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, width), axis=1)
