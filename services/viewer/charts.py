"""The curves of the page: quantities of each frame, joint angles, the tracking speed, the page's delay."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import joint_transforms
from services.mocap.body.skeleton import SIDES, sided
from services.mocap.body.skeleton_table import ROWS
from services.mocap.motion.angles import ANGLES, Angle, joint_angles_deg
from services.mocap.take.marks import DISTRUSTED, PARTS, doubtful_parts
from services.mocap.take.quantities import QUANTITIES, STAGES, Quantity
from services.mocap.types import Floats, Ints, Mask
from services.viewer.frame_history import FrameHistory
from services.viewer.solved_frame import Stretch

MOST_FRAMES = 1200
"""Most frames that a curve has; of longer takes every second, third, … one is drawn."""
_SHOWN_STAGES = ("torso", "limbs", "head", "frame")
_STAGE_WORDS = {"torso": "whole body", "limbs": "limbs", "head": "head", "frame": "frame in all"}
_MEDIAN_FRAMES = 9
_DELAYS = 300
"""How many of the page's delays are kept."""
_PART_OF_JOINT = {row.joint: row.part for row in ROWS}


@dataclass(frozen=True)
class Chart:
    """One chart that a user may choose."""

    title: str
    names: tuple[str, ...]
    """Of its S curves."""
    values_of: Callable[[Stretch], Floats]
    """(N, S) of a stretch of N frames; NaN where nothing is known."""
    parts: tuple[str, ...] = PARTS
    """It is shaded where one of these parts is doubtful."""
    most: float = np.inf
    """If finite, the scale is from 0 to this."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A chart's curves."""

    chart: Chart
    frames: Ints
    """(N,)"""
    values: Floats
    """(N, S)"""
    doubtful: Mask
    """(N,) frames to be shaded."""


class Charts:
    """The charts of one browser."""

    def __init__(self, history: FrameHistory, body: Body) -> None:
        self._history, self._delays_s = history, deque[tuple[int, float]](maxlen=_DELAYS)
        every = [
            *(_quantity_chart(row) for row in QUANTITIES if row.chart),
            *(_angle_chart(angle, body) for angle in ANGLES),
            Chart("Frames per second", ("tracked",), _frames_per_s),
            Chart("Delay of this page in seconds", ("behind",), self._delays),
        ]
        self._charts = {chart.title: chart for chart in every}

    @property
    def titles(self) -> tuple[str, ...]:
        """What a user may choose from."""
        return tuple(self._charts)

    def draw(self, title: str) -> Drawn | None:
        """A chart of all frames in memory; None for an unknown title."""
        chart = self._charts.get(title)
        if chart is None:
            return None
        known = self._history.sampled(MOST_FRAMES)
        marked = [part in chart.parts for part in PARTS]
        doubtful: Mask = np.any(doubtful_parts(known.of(DISTRUSTED) > 0)[:, marked], axis=1)
        return Drawn(chart, known.frames, chart.values_of(known), doubtful)

    def note_delay(self, frame: int, behind_s: float) -> None:
        """Store the browser's delay for a live frame."""
        self._delays_s.append((frame, behind_s))

    def _delays(self, known: Stretch) -> Floats:
        delays_s = dict(self._delays_s)
        return np.array([[delays_s.get(frame, np.nan)] for frame in known.frames.tolist()]).reshape(-1, 1)


def _quantity_chart(row: Quantity) -> Chart:
    labels = _SHOWN_STAGES if row.per == "stage" else row.labels
    words = _STAGE_WORDS if row.per == "stage" else {"": row.name.partition("_")[0]}
    names = tuple(words.get(label, label.replace("_", " ")) for label in labels)
    columns, factor = [row.labels.index(label) for label in labels], 1e3 if row.unit == "s" else 1.0
    return Chart(row.chart, names, lambda known: factor * known.of(row.name)[:, columns], most=row.most)


def _angle_chart(angle: Angle, body: Body) -> Chart:
    sides = SIDES if angle.is_sided else (None,)
    part = _PART_OF_JOINT[angle.joint]
    words = angle.name.replace("_", " ")
    return Chart(
        title=f"Angle: {words} (degrees)",
        names=tuple(side or words for side in sides),
        values_of=partial(_angles_deg, body, tuple(sided(angle.name, side) for side in sides)),
        parts=tuple(sided(part, side) for side in sides),
    )


def _angles_deg(body: Body, names: tuple[str, ...], known: Stretch) -> Floats:
    """(N, S) of joint angles by name."""
    if not len(known.frames):
        return np.zeros((0, len(names)))
    found = joint_angles_deg(joint_transforms(known.poses, body.offsets_m))
    return np.column_stack([found[name] for name in names])


def _frames_per_s(known: Stretch) -> Floats:
    """(N, 1) tracking speed: running medians, robust against single late frames."""
    with np.errstate(divide="ignore"):
        values = 1.0 / known.of("seconds")[:, STAGES.index("frame")]
    if not len(values):
        return values[:, None]
    padded = np.pad(values, _MEDIAN_FRAMES // 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, _MEDIAN_FRAMES)
    return np.median(windows, axis=1, keepdims=True)
