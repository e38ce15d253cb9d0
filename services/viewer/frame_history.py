"""The frames that a page can show: the latest in a ring of stated size, older ones fetched when asked for."""

import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from services.mocap.body.kinematics import N_DOF
from services.mocap.take.marks import PARTS
from services.mocap.types import Floats, Ints, Mask
from services.viewer.metrics import FRAMES

RING_FRAMES = 4096
"""Frames kept in memory, at about 0.5 KB each; two to three minutes of a take at 25 frames per second."""
STAGES = ("torso", "limbs", "head", "left_arm", "right_arm", "left_leg", "right_leg", "frame")
"""What a frame's time is told of; limbs are solved side by side, frame is all from one to the next."""
_FETCHED_FRAMES = 512
"""Older frames that are kept after somebody asked for them."""
_MOST_BINS = 600
_ROW = np.dtype(
    [
        ("frame", "i4"),
        ("time_s", "f8"),
        ("pose", "f8", N_DOF),
        ("energy_px", "f8"),
        ("confidence", "f8", len(PARTS)),
        ("distrusted", "?", len(PARTS)),
        ("part_px", "f8", len(PARTS)),
        ("seconds", "f8", len(STAGES)),
        ("arrived_s", "f8"),
    ]
)
_CURVES = ("frame", "energy_px", "confidence", "part_px", "seconds", "arrived_s")


@dataclass(frozen=True, eq=False)
class SolvedFrame:
    """One solved frame."""

    frame: int
    time_s: float
    pose: Floats
    """(D,) in metres and radians, z-up world."""
    energy_px: float
    confidence: Floats
    """(6,) of PARTS, 0 to 1; NaN where a part was not judged."""
    distrusted: Mask
    """(6,) parts that must not be trusted."""
    part_px: Floats
    """(6,) of PARTS, the energy near each; NaN where nobody counted it."""
    seconds: Floats
    """(8,) of STAGES; NaN where it is not known."""
    arrived_s: float = np.nan
    """When the viewer got it (time.monotonic); NaN for finished takes."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """Consecutive known frames (N), in increasing order, as arrays: what curves are drawn from."""

    frames: Ints
    energy_px: Floats
    confidence: Floats
    """(N, 6)"""
    part_px: Floats
    """(N, 6)"""
    seconds: Floats
    """(N, 8)"""
    arrived_s: Floats


@dataclass(frozen=True, eq=False)
class Overview:
    """The whole take in B equal bins: what a timeline is drawn from."""

    known: Mask
    """(B,) bins with a solved frame."""
    energy_px: Floats
    """(B,) the largest; 0 where nothing is known."""
    distrusted: Mask
    """(B,) bins with a frame of which some part must not be trusted."""


class Older(Protocol):
    """Where frames are that have left the ring; for any thread."""

    def solved(self, frame: int) -> SolvedFrame | None:
        """A frame that is at hand."""
        ...

    def ask(self, frame: int) -> None:
        """Have a frame sent that is not at hand; it may be put into the history later, or never."""
        ...

    def why_missing(self, frame: int) -> str:
        """Why a frame is not there, as what follows its number in a sentence."""
        ...


class FrameHistory:
    """Solved frames of a take's range; written by one thread, read by any number.

    Memory does not grow with the take.
    """

    def __init__(
        self,
        frames: range,
        capacity: int = RING_FRAMES,
        older: Older | None = None,
        *,
        is_open: bool = False,
    ) -> None:
        """is_open: whether nobody knows yet how many frames come; then their end is the last that may."""
        self.frames, self.capacity = frames, min(capacity, max(len(frames), 1))
        self.extent = frames[:_MOST_BINS] if is_open else frames
        """What the timeline spans: all frames, or twice as many whenever those of an open take exceed it."""
        self._older = older
        self._rows: NDArray[np.void] = np.zeros(self.capacity, _ROW)
        self._rows["frame"] = -1
        self._fetched: OrderedDict[int, SolvedFrame] = OrderedDict()
        bins = min(_MOST_BINS, max(len(self.extent), 1))
        self._known, self._distrusted = np.zeros(bins, bool), np.zeros(bins, bool)
        self._energy_px = np.zeros(bins)
        self._lock = threading.Lock()
        self.newest: int | None = None
        """The frame that was solved last."""
        self.is_over = False
        """Whether no further frame will come."""

    def put(self, solved: SolvedFrame) -> None:
        """Take in a frame; one outside the range is left out, one before the newest may fill a gap."""
        if solved.frame not in self.frames:
            return
        FRAMES.inc()
        row = self._rows[solved.frame % self.capacity]
        with self._lock:
            self._mark(solved)
            if self.newest is None or solved.frame > self.newest:
                self.newest = solved.frame
            if solved.frame <= self.newest - self.capacity:
                self._keep_fetched(solved)
                return
            self._fill(row, solved)

    def _mark(self, solved: SolvedFrame) -> None:
        while solved.frame not in self.extent:
            self._widen()
        at = (solved.frame - self.extent.start) * len(self._known) // len(self.extent)
        self._known[at] = True
        self._energy_px[at] = max(self._energy_px[at], solved.energy_px)
        self._distrusted[at] |= bool(solved.distrusted.any())

    def _widen(self) -> None:
        """Let the timeline span twice as many frames, two bins becoming one."""
        self.extent = range(self.extent.start, self.extent.start + 2 * len(self.extent))
        self._known, self._energy_px, self._distrusted = (
            np.append(bins.reshape(-1, 2).max(axis=1), np.zeros_like(bins[::2]))
            for bins in (self._known, self._energy_px, self._distrusted)
        )

    def _keep_fetched(self, solved: SolvedFrame) -> None:
        self._fetched[solved.frame] = solved
        while len(self._fetched) > _FETCHED_FRAMES:
            self._fetched.popitem(last=False)

    def solved(self, frame: int) -> SolvedFrame | None:
        """A frame; None where it is not known (yet): one that left the ring is asked for by that."""
        with self._lock:
            row = self._rows[frame % self.capacity].copy()
        if row["frame"] == frame:
            return _solved(row)
        found = self._at_hand(frame)
        if found is None and self._older is not None and self._is_past(frame):
            self._older.ask(frame)
        return found

    def _is_past(self, frame: int) -> bool:
        """Whether a frame was solved, as far as is known."""
        return frame in self.frames and self.newest is not None and frame <= self.newest

    def why_missing(self, frame: int) -> str:
        """Why a frame is not there, as what follows its number in a sentence."""
        if self._older is None or not self._is_past(frame):
            return "is not known yet"
        return self._older.why_missing(frame)

    def last_gap(self, start: int = 0) -> range | None:
        """The last frames, from a start on, that the ring could hold and lacks, before the newest."""
        if self.newest is None:
            return None
        start = max(start, self.frames.start, self.newest - self.capacity + 1)
        with self._lock:
            wanted = np.arange(start, self.newest)
            lacking = wanted[self._rows["frame"][wanted % self.capacity] != wanted]
        if not lacking.size:
            return None
        jumps = np.flatnonzero(np.diff(lacking) > 1)
        return range(int(lacking[jumps[-1] + 1 if jumps.size else 0]), int(lacking[-1]) + 1)

    def stretch(self, start: int, stop: int) -> Stretch:
        """What is at hand of frames start up to and without stop."""
        wanted = np.arange(max(start, self.frames.start), min(stop, self.frames.stop))
        if not len(wanted):
            return Stretch(*(self._rows[name][:0].copy() for name in _CURVES))
        with self._lock:
            rows = self._rows[wanted % self.capacity]
        for n in np.flatnonzero(rows["frame"] != wanted).tolist():
            self._fill(rows[n], self._at_hand(int(wanted[n])))
        rows = rows[rows["frame"] == wanted]
        return Stretch(*(rows[name].copy() for name in _CURVES))

    def _at_hand(self, frame: int) -> SolvedFrame | None:
        """A frame that has left the ring, without asking anybody for it."""
        with self._lock:
            found = self._fetched.get(frame)
        if found is None and self._older is not None and self._is_past(frame):
            found = self._older.solved(frame)
            if found is not None:
                with self._lock:
                    self._mark(found)
                    self._keep_fetched(found)
        return found

    @staticmethod
    def _fill(row: np.void, solved: SolvedFrame | None) -> None:
        if solved is not None:
            for name in _ROW.names or ():
                row[name] = getattr(solved, name)

    def overview(self) -> Overview:
        """The whole take, in at most 600 bins."""
        with self._lock:
            return Overview(self._known.copy(), self._energy_px.copy(), self._distrusted.copy())


def _solved(row: np.void) -> SolvedFrame:
    """A row of the ring, its numbers as Python's own."""
    fields = {name: row[name] for name in _ROW.names or ()}
    return SolvedFrame(**{name: value if value.ndim else value.item() for name, value in fields.items()})
