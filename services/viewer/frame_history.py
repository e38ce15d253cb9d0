"""The solved frames of a take that a page can show, and the whole take at a glance."""

import threading
from dataclasses import dataclass
from typing import Literal

import numpy as np

from services.mocap.body.kinematics import N_DOF
from services.mocap.take.marks import PARTS, doubtful_parts, judged_parts
from services.mocap.types import Floats, Mask
from services.viewer.solved_frame import COLUMNS, SolvedFrame, Stretch

MOST_FRAMES = 100_000
"""Most frames that are kept of an open take, at 1.5 KB each: more than an hour at 25 frames per second."""
_MOST_BINS = 600


@dataclass(frozen=True, eq=False)
class Overview:
    """A take in B equal bins, for a timeline."""

    known: Mask
    """(B,) bins with a solved frame."""
    energy_px: Floats
    """(B,) the largest energy; 0 if unknown."""
    doubtful: Mask
    """(B, 6) bins with a frame in which a part is doubtful, by part."""
    unjudged: Mask
    """(B, 6) bins with a frame in which nobody judged a part."""

    @classmethod
    def empty(cls, bins: int) -> "Overview":
        """Bins without a frame."""
        no_parts = np.zeros((bins, len(PARTS)), bool)
        return cls(np.zeros(bins, bool), np.zeros(bins), no_parts, no_parts.copy())


class FrameHistory:
    """Solved frames of a take's range; for any thread."""

    def __init__(self, frames: range, *, is_open: bool = False) -> None:
        """is_open: the number of frames is not known yet or too large to keep all; then the end of `frames`
        is only a limit."""
        self.frames = frames
        """The range; where an open take becomes too long, it loses the oldest frames."""
        self.extent = frames[:_MOST_BINS] if is_open else frames
        """The range of the timeline: all frames; for an open take it grows."""
        self._solved: dict[int, SolvedFrame] = {}
        self._marks = Overview.empty(max(len(self.extent), 1))
        """Of the frames of the extent, each in a bin of its own."""
        self.version = 0
        """Incremented by every frame that is learnt of."""
        self._lock = threading.Lock()
        self.newest: int | None = None
        """The last solved frame."""
        self.is_over = False
        """Whether no more frames will come."""

    def put(self, solved: SolvedFrame) -> None:
        """Add a frame; one outside the range is ignored, one before the newest may fill a gap."""
        frame = solved.frame
        with self._lock:
            known = self._solved.get(frame)
            if frame not in self.frames or (known is not None and known.settled and not solved.settled):
                return
            if frame not in self.extent:
                self._extend_to(frame)
            marks, at = self._marks, frame - self.extent.start
            marks.known[at], marks.energy_px[at] = True, np.nan_to_num(solved.energy_px)
            marks.doubtful[at] = doubtful_parts(solved.distrusted)
            marks.unjudged[at] = ~judged_parts(solved.of("confidence"), solved.distrusted)
            self._solved[frame] = solved
            self.newest = frame if self.newest is None else max(self.newest, frame)
            self.version += 1

    def _extend_to(self, frame: int) -> None:
        """Extend the timeline of an open take to a frame; where it would become too long, forget the oldest
        frames, a tenth or more."""
        start, length = self.extent.start, len(self.extent)
        while frame >= start + length and length < MOST_FRAMES:
            length = min(2 * length, MOST_FRAMES)
        if frame >= start + length:
            start = frame + 1 - 9 * MOST_FRAMES // 10
            self.frames = range(start, self.frames.stop)
            self._solved = {kept: solved for kept, solved in self._solved.items() if kept >= start}
        length = min(length, self.frames.stop - start)
        marks = Overview.empty(length)
        for before, after in zip(vars(self._marks).values(), vars(marks).values(), strict=True):
            kept = before[start - self.extent.start :]
            after[: len(kept)] = kept
        self.extent, self._marks = range(start, start + length), marks

    def doubtful_beside(self, frame: int, way: Literal[-1, 1], by_stretch: bool = False) -> int | None:
        """The next (1) or previous (-1) doubtful frame; None if there is none.

        by_stretch: the first frame of the next or previous stretch of doubtful frames.
        """
        with self._lock:
            wanted: Mask = np.any(self._marks.doubtful, axis=1)
            start = self.extent.start
        if by_stretch:
            wanted[1:] &= ~wanted[:-1]
        found = np.flatnonzero(wanted) + start
        beside = found[found > frame][:1] if way > 0 else found[found < frame][-1:]
        return int(beside[0]) if len(beside) else None

    def solved(self, frame: int) -> SolvedFrame | None:
        """A frame; None where it is not known."""
        return self._solved.get(frame)

    def lacks(self, frame: int, *, settled: bool) -> bool:
        """Whether a frame of the range, or its settled solution, is not known."""
        known = self._solved.get(frame)
        return frame in self.frames and (known is None or (settled and not known.settled))

    def last_gap(self, start: int = 0) -> range | None:
        """The last missing frames, from a start on, before the newest."""
        with self._lock:
            first = max(start, self.extent.start)
            end = first if self.newest is None else max(first, self.newest)
            known = self._marks.known[first - self.extent.start : end - self.extent.start].copy()
        missing = np.flatnonzero(~known)
        if not len(missing):
            return None
        before = np.flatnonzero(known[: missing[-1]])
        return range(first + (int(before[-1]) + 1 if len(before) else 0), first + int(missing[-1]) + 1)

    def sampled(self, most: int) -> Stretch:
        """Known frames, at equal distances over the extent, at most this many."""
        extent, solved_frames = self.extent, self._solved
        step = -(-len(extent) // most)
        known = [solved_frames[frame] for frame in extent[::step] if frame in solved_frames]
        numbers = np.array([solved.numbers for solved in known]).reshape(len(known), len(COLUMNS))
        poses = np.array([solved.pose for solved in known]).reshape(len(known), N_DOF)
        return Stretch(np.array([solved.frame for solved in known], np.int32), numbers, poses)

    def overview(self) -> Overview:
        """The extent in at most 600 bins."""
        with self._lock:
            frames = len(self._marks.known)
            bins = min(_MOST_BINS, frames)
            starts = -(-np.arange(bins) * frames // bins)
            return Overview(*(np.maximum.reduceat(marks, starts) for marks in vars(self._marks).values()))
