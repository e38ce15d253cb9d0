"""The verdict on a result as data, and its words.

The terminal, run.json, the report, the overlay and the page show this object.
"""

from collections.abc import Iterable
from typing import Literal, TypeAlias, get_args

import numpy as np

from services.mocap.errors import FrozenModel
from services.mocap.take.marks import PARTS, WHOLE_BODY, Part
from services.mocap.types import Mask

Level: TypeAlias = Literal["good", "usable with gaps", "not usable"]
LEVELS: tuple[Level, ...] = get_args(Level)
"""The best first."""
_MOST_SPANS = 6
"""Stretches of frames that a line of text lists; the others are counted."""


class Doubt(FrozenModel):
    """A part of the body, and the frames in which it is doubtful."""

    part: Part
    frames: int
    """How many."""
    spans: tuple[tuple[int, int], ...]
    """First and last frame of each stretch of them."""

    def __str__(self) -> str:
        return f"{part_in_words(self.part)} in {self.frames} ({spans_in_words(self.spans)})"


class Cause(FrozenModel):
    """Something that explains doubtful frames or a wrong body."""

    what: str
    """What is wrong, as far as the data tell."""
    remedy: str
    """The command or the file that mends it."""
    level: Level
    """The best level that a result with it can have; `good` for a remark."""

    @property
    def kind(self) -> Literal["cause", "remark"]:
        """What it is called: a remark does no harm."""
        return "remark" if self.level == "good" else "cause"

    def __str__(self) -> str:
        return f"{self.what}: {self.remedy}" if self.remedy else self.what


class Verdict(FrozenModel):
    """The verdict on N consecutive frames."""

    level: Level
    frames: int
    """N."""
    doubtful_frames: int
    """Frames with a doubtful part."""
    lost_frames: int
    """Frames in which the whole body is doubtful."""
    lost_limbs: float = 0.0
    """The share of arms and legs, from 0 to 1, that may be lost in the other frames."""
    doubts: tuple[Doubt, ...]
    """Parts that are doubtful in some frame in which not the whole body is, in the order of PARTS."""
    iou: dict[str, float]
    """By camera: intersection over union of model and silhouette, median of the frames."""
    causes: tuple[Cause, ...]
    """Those found before the run first; remarks last."""

    @property
    def typical_iou(self) -> float:
        """The median of the cameras' overlaps; 1 where they are not known."""
        return float(np.median(list(self.iou.values()))) if self.iou else 1.0

    @property
    def headline(self) -> str:
        """The level, how many frames are doubtful, and how many arms and legs may be lost; without a doubtful
        frame, whether there is another cause for the level."""
        if not self.doubtful_frames:
            sure = f"{self.level}: no part is doubtful in any of {self.frames} frames"
            return sure if self.level == "good" else f"{sure}, but a cause of errors was found"
        have = "has" if self.doubtful_frames == 1 else "have"
        frames = f"{self.level}: {self.doubtful_frames} of {self.frames} frames {have} doubtful parts"
        percent = round(100 * self.lost_limbs)
        return f"{frames}; {percent} % of arms and legs may be lost" if percent else frames

    @property
    def doubts_in_words(self) -> str:
        """Which parts are doubtful, and when; empty without any."""
        return "; ".join(map(str, self.doubts))


def part_in_words(part: Part) -> str:
    """A part as a person reads it."""
    return "whole body" if part == WHOLE_BODY else part.replace("_", " ")


def frame_in_words(distrusted: Iterable[bool]) -> str:
    """The verdict on one frame, by its doubtful parts among PARTS (6,); the whole body alone if it is one."""
    doubtful = [part for part, is_doubtful in zip(PARTS, distrusted, strict=True) if is_doubtful]
    named = [WHOLE_BODY] if WHOLE_BODY in doubtful else doubtful
    return f"doubtful: {', '.join(map(part_in_words, named))}" if named else "good"


def spans_of(chosen: Mask, first: int = 0) -> tuple[tuple[int, int], ...]:
    """First and last number of each stretch of chosen frames (N,), which are numbered from `first`."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(np.int8), [0]])))
    return tuple((first + int(start), first + int(stop) - 1) for start, stop in edges.reshape(-1, 2))


def spans_in_words(spans: tuple[tuple[int, int], ...]) -> str:
    """`frame 4`, or `frames 4 to 9, 30, and 3 more stretches`; the longest are listed."""
    longest = sorted(spans, key=lambda span: span[0] - span[1])[:_MOST_SPANS]
    listed = ", ".join(f"{a}" if a == b else f"{a} to {b}" for a, b in sorted(longest))
    more = len(spans) - len(longest)
    one = len(spans) == 1 and spans[0][0] == spans[0][1]
    return f"frame{'' if one else 's'} {listed}" + (
        f", and {more} more stretch{'es' if more > 1 else ''}" if more else ""
    )
