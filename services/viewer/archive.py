"""Frames that are no longer in a viewer's memory: from the recorder's journal, results, or the
coordinator."""

import math
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import msgpack
import numpy as np

from proto.framing import MalformedMessage, decode
from proto.messages import Pose, PoseRequest, TakeInfo
from proto.streams import ASK_AGAIN_S
from services.mocap.errors import TakeError
from services.mocap.result.layout import journal_of
from services.mocap.take.journal import FIRST, record_at, records
from services.mocap.take.quantities import numbers_of
from services.viewer.finished import FinishedTake
from services.viewer.solved_frame import ON_PAGE, SolvedFrame

CHUNK_FRAMES = 64
"""Most poses that the coordinator sends for one request."""
_HEAD_BYTES = 8
"""The first record's length and check sum, by which one journal is told from the next in its place."""


class Archive:
    """Where frames are that have left a FrameHistory's memory; for any thread."""

    def __init__(
        self,
        info: TakeInfo,
        frames: range,
        results: Path | None,
        ask: Callable[[PoseRequest], None],
        heard_s: Callable[[], float],
    ) -> None:
        """results: the path of the recorder's results on this host; None: not on this host.

        ask: sends a request to the coordinator, whose answers go to the history. heard_s: time of its last
        message.
        """
        self.is_over = False
        """Whether the take has ended: only then results can be those of this run."""
        self._run, self._ask, self._heard_s = info.run, ask, heard_s
        self._finished = FinishedTake(results, info.take)
        self._journal = None if results is None else JournalIndex(journal_of(results), info.run, frames)
        self._problem = "this viewer does not know the results folder (--results)" if results is None else ""
        self._requests = RetryRequests()

    def solved(self, frame: int) -> SolvedFrame | None:
        """A frame, if it is on disk."""
        if self._journal is None:
            return None
        try:
            record = self._journal.pose(frame)
            self._problem = f"{self._journal.path} does not contain it"
            message = None if record is None else decode(record)
            return solved_frame_of(message) if isinstance(message, Pose) else None
        except FileNotFoundError:  # not yet, or no longer because the results are complete
            self._problem = f"there is no journal at {self._journal.path}"
            return self._finished.solved(frame) if self.is_over else None
        except (OSError, TakeError) as problem:
            self._problem = f"the recorder's journal cannot be read: {problem}"
        except MalformedMessage:
            self._problem = f"{self._journal.path} was written by another version"
        return None

    def ask(self, frame: int) -> None:
        """Request a frame and the following ones from the coordinator, if it may have them; they may
        come into the history later, or never."""
        if self._requests.asks(range(frame, frame + 1), time.monotonic(), self._heard_s()):
            end = frame + CHUNK_FRAMES
            self._ask(PoseRequest(run=self._run, first_frame=frame, end_frame=end))

    def why_missing(self, frame: int) -> str:
        """Why a frame is missing, as the end of a sentence that begins with its number."""
        if frame >= self._requests.gone_end:
            return "was asked for"
        return f"is no longer in the viewer's or the coordinator's memory, and {self._problem}"


def solved_frame_of(message: Pose) -> SolvedFrame:
    """A frame as it was published."""
    return SolvedFrame(
        frame=message.frame,
        time_s=message.time_s,
        pose=message.pose,
        numbers=np.array([number for row in ON_PAGE for number in numbers_of(message, row, row.labels)]),
        iou=np.array(message.measured.get("iou", ()), np.float64),
        settled=message.settled,
    )


class JournalIndex:
    """Finds the poses of one run in a journal that another process is still writing, in any order; remembers
    where they are, reads them when asked. For any thread."""

    def __init__(self, path: Path, run: str, frames: range) -> None:
        """path: need not exist yet. frames: the range of possible frames."""
        self.path, self._run, self._frames = path, run, frames
        self._lock = threading.Lock()
        self._offsets: dict[int, int] = {}
        self._end = FIRST
        self._begun: tuple[int, int, bytes] | None = None

    def pose(self, frame: int) -> list[bytes] | None:
        """The record of a frame; None while the journal has none.

        Raises OSError if it cannot be read or does not exist, TakeError if it is not a journal.
        """
        if frame not in self._frames:
            return None
        with self._lock:
            file = os.open(self.path, os.O_RDONLY)
            try:
                return self._found(file, frame)
            finally:
                os.close(file)

    def _found(self, file: int, frame: int) -> list[bytes] | None:
        status = os.fstat(file)
        begun = status.st_dev, status.st_ino, os.pread(file, _HEAD_BYTES, FIRST)
        if begun != self._begun:  # the file was replaced or started again
            self._begun, self._offsets, self._end = begun, {}, FIRST
        if frame not in self._offsets:
            for offset, frames, end in records(file, self.path, self._end):
                self._end = end
                header = msgpack.unpackb(frames[0]) if frames else {}
                is_ours = header.get("type") == Pose.type and header["run"] == self._run
                if is_ours and header["frame"] in self._frames:
                    self._offsets[header["frame"]] = offset
        found = record_at(file, self._offsets[frame]) if frame in self._offsets else None
        return None if found is None else found[0]


_AGAIN_S = 0.8 * ASK_AGAIN_S
"""A bit less than the time between two looks for missing frames (Follower.listen), which is measured from a
moment earlier: else every second look would pass without a request."""
_MOST = 3
"""Number of requests for the same frames before they are given up."""


class RetryRequests:
    """Remembers the requests; for any thread."""

    def __init__(self) -> None:
        self.gone_end = 0
        """Frames before this one are not available."""
        self._frames, self._times, self._asked_s = range(0), 0, -math.inf
        self._lock = threading.Lock()

    def asks(self, frames: range, now_s: float, heard_s: float) -> bool:
        """Whether to request some frames now: different ones from before, or the same again after a while.

        heard_s: time of the coordinator's last message; requests to a silent coordinator do not count.
        """
        with self._lock:
            if frames.start < self.gone_end or now_s - self._asked_s < _AGAIN_S:
                return False
            if frames != self._frames:
                self._frames, self._times = frames, 0
            elif heard_s > self._asked_s:
                self._times += 1
            if self._times >= _MOST:
                self.gone_end = frames.stop
                return False
            self._asked_s = now_s
            return True
