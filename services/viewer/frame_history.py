"""The frames that a page can show: the latest of a stated number, older ones fetched when asked for."""

import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import Literal

import numpy as np

from services.blob_store import keep_latest
from services.mocap.body.kinematics import N_DOF
from services.mocap.take.marks import PARTS, doubtful_parts, judged_parts
from services.mocap.types import Floats, Mask
from services.viewer.archive import Archive
from services.viewer.metrics import FRAMES
from services.viewer.solved_frame import COLUMNS, SolvedFrame, Stretch

KEPT_FRAMES = 4096
"""Frames kept in memory, at about 2 KB each; two to three minutes of a take at 25 frames per second."""
_FETCHED_FRAMES = 512
"""Number of fetched older frames that are kept."""
_MOST_BINS = 600


@dataclass(frozen=True, eq=False)
class Overview:
    """The whole take in B equal bins, for a timeline."""

    known: Mask
    """(B,) bins with a solved frame."""
    energy_px: Floats
    """(B,) the largest energy; 0 if unknown."""
    doubtful: Mask
    """(B, 6) bins with a frame in which a part is doubtful, by part."""
    unjudged: Mask
    """(B, 6) bins with a frame in which nobody judged a part."""


class FrameHistory:
    """Solved frames of a take's range; written by one thread, read by any number.

    Memory does not grow with the take.
    """

    def __init__(
        self,
        frames: range,
        capacity: int = KEPT_FRAMES,
        older: Archive | None = None,
        *,
        is_open: bool = False,
    ) -> None:
        """older: where frames are that have left memory. is_open: whether the number of frames is not known
        yet; then the end of `frames` is only a limit."""
        self.frames, self.capacity = frames, capacity
        self.extent = frames[:_MOST_BINS] if is_open else frames
        """The range of the timeline: all frames; for an open take it doubles whenever it is exceeded."""
        self._older = older
        self._latest: dict[int, SolvedFrame] = {}
        self._fetched: OrderedDict[int, SolvedFrame] = OrderedDict()
        bins = min(_MOST_BINS, max(len(self.extent), 1))
        none = np.zeros((bins, len(PARTS)), bool)
        self._overview = Overview(np.zeros(bins, bool), np.zeros(bins), none, none.copy())
        self._doubtful: Mask = np.zeros(len(frames), bool)
        """Of each frame of the range, also of those that have left memory: one byte a frame."""
        self.version = 0
        """Incremented by every frame that is learnt of."""
        self._lock = threading.Lock()
        self.newest: int | None = None
        """The last solved frame."""
        self.is_over = False
        """Whether no more frames will come."""

    def put(self, solved: SolvedFrame) -> None:
        """Add a frame; one outside the range is ignored, one before the newest may fill a gap."""
        if solved.frame not in self.frames:
            return
        FRAMES.inc()
        with self._lock:
            known = self._latest.get(solved.frame) or self._fetched.get(solved.frame)
            if known is not None and known.settled and not solved.settled:
                return  # it was asked for before it was settled
            self._mark(solved)
            if self.newest is None:
                self.newest = solved.frame
            for next_frame in range(self.newest + 1, solved.frame + 1):
                self._latest.pop(next_frame - self.capacity, None)
                self.newest = next_frame
            if solved.frame > self.newest - self.capacity:
                self._latest[solved.frame] = solved
            else:
                keep_latest(self._fetched, solved.frame, solved, _FETCHED_FRAMES)

    def _mark(self, solved: SolvedFrame) -> None:
        while solved.frame not in self.extent:  # twice as many frames, two bins becoming one
            self.extent = range(self.extent.start, self.extent.start + 2 * len(self.extent))
            for bins in vars(self._overview).values():
                half = bins.reshape(-1, 2, *bins.shape[1:]).max(axis=1)
                bins[: len(half)], bins[len(half) :] = half, 0
        overview = self._overview
        at, before = (
            (frame - self.extent.start) * len(overview.known) // len(self.extent)
            for frame in (solved.frame, solved.frame - 1)
        )
        if solved.settled and at != before:  # settled frames come in order, and replace the first ones
            overview.energy_px[at], overview.doubtful[at], overview.unjudged[at] = 0.0, False, False
        overview.known[at] = True
        overview.energy_px[at] = max(overview.energy_px[at], solved.energy_px)
        overview.doubtful[at] |= doubtful_parts(solved.distrusted)
        overview.unjudged[at] |= ~judged_parts(solved.of("confidence"), solved.distrusted)
        self._doubtful[solved.frame - self.frames.start] = solved.distrusted.any()
        self.version += 1

    def doubtful_beside(self, frame: int, way: Literal[-1, 1], by_stretch: bool = False) -> int | None:
        """The next (1) or previous (-1) doubtful frame; None if there is none.

        by_stretch: the first frame of the next or previous stretch of doubtful frames.
        """
        with self._lock:
            wanted = self._doubtful.copy()
        if by_stretch:
            wanted[1:] &= ~self._doubtful[:-1]
        found = np.flatnonzero(wanted) + self.frames.start
        beside = found[found > frame][:1] if way > 0 else found[found < frame][-1:]
        return int(beside[0]) if len(beside) else None

    def solved(self, frame: int) -> SolvedFrame | None:
        """A frame; None where it is not known (yet): one that left memory is then requested."""
        with self._lock:
            found = self._latest.get(frame) or self._fetched.get(frame)
        if found is None and self._older is not None and self._is_past(frame):
            found = self._older.solved(frame)
            if found is None:
                self._older.ask(frame)
                return None
            with self._lock:
                self._mark(found)
                keep_latest(self._fetched, frame, found, _FETCHED_FRAMES)
        return found

    def _is_past(self, frame: int) -> bool:
        """Whether a frame is known to be solved."""
        return frame in self.frames and self.newest is not None and frame <= self.newest

    def why_missing(self, frame: int) -> str:
        """Why a frame is missing, as the end of a sentence that begins with its number."""
        if self._older is None or not self._is_past(frame):
            return "is not known yet"
        return self._older.why_missing(frame)

    def last_gap(self, start: int = 0) -> range | None:
        """The last frames, from a start on, that memory could hold and lacks, before the newest."""
        if self.newest is None:
            return None
        start, end = max(start, self.frames.start, self.newest - self.capacity + 1), self.newest
        while end > start and end - 1 in self._latest:
            end -= 1
        first = end
        while first > start and first - 1 not in self._latest:
            first -= 1
        return range(first, end) if first < end else None

    def sampled(self, most: int) -> Stretch:
        """Frames in memory, at equal distances over the extent, at most this many."""
        step = -(-len(self.extent) // most)
        with self._lock:
            known = [self._latest[frame] for frame in self.extent[::step] if frame in self._latest]
        numbers = np.array([solved.numbers for solved in known]).reshape(len(known), len(COLUMNS))
        poses = np.array([solved.pose for solved in known]).reshape(len(known), N_DOF)
        return Stretch(np.array([solved.frame for solved in known], np.int32), numbers, poses)

    def overview(self) -> Overview:
        """The whole take, in at most 600 bins."""
        with self._lock:
            return Overview(*(bins.copy() for bins in vars(self._overview).values()))
