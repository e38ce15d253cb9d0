"""How a viewer gets frames that it missed: requests to the coordinator, and the recorder's journal."""

import logging
import math
import os
import time
from pathlib import Path

import msgpack

from proto.framing import MalformedMessage, decode
from proto.messages import OPEN_END, Pose, TakeInfo
from proto.streams import ASK_AGAIN_S
from services.mocap.errors import TakeError
from services.mocap.take.journal import record_at, records
from services.pose_size import with_whole_poses
from services.viewer.frame_history import FrameHistory
from services.viewer.solved_frame import solved_frame_of

log = logging.getLogger(__name__)

CHUNK_FRAMES = 64
"""Most poses that the coordinator sends for one request."""


def read_journal(path: Path, run: str, history: FrameHistory) -> None:
    """Add to a history what it lacks of a run from the recorder's journal, which need not exist."""
    try:
        file = os.open(path, os.O_RDONLY)
    except FileNotFoundError:  # not yet, or no longer because the results are complete
        log.info("there is no journal at %s", path)
        return
    except OSError as problem:
        log.warning("the recorder's journal cannot be read: %s", problem)
        return
    try:
        for (frame, settled), offset in _places(file, path, run).items():
            found = record_at(file, offset) if history.lacks(frame, settled=settled) else None
            message = None if found is None else with_whole_poses(decode(found[0]))
            if isinstance(message, Pose):
                history.put(solved_frame_of(message, time.monotonic()))
    except (OSError, TakeError) as problem:
        log.warning("the recorder's journal cannot be read: %s", problem)
    except MalformedMessage:
        log.warning("%s was written by another version", path)
    finally:
        os.close(file)


def _places(file: int, path: Path, run: str) -> dict[tuple[int, bool], int]:
    """Where the poses of a run are in a journal, by frame and whether they are settled, without those of
    moments that another coordinator's frames replaced (Store.keep)."""
    places = dict[tuple[int, bool], int]()
    for offset, frames, _ in records(file, path):
        header = msgpack.unpackb(frames[0]) if frames else {}
        if header.get("run") != run:
            continue
        if header.get("type") == Pose.type:
            places[header["frame"], header.get("settled", False)] = offset
        elif header.get("type") == TakeInfo.type and header.get("end_frame") == OPEN_END:
            begun = header.get("continued_at") or OPEN_END
            places = {place: at for place, at in places.items() if place[0] < begun}
    return places


_AGAIN_S = 0.8 * ASK_AGAIN_S
"""A bit less than the time between two looks for missing frames (Follower.listen), which is measured from a
moment earlier: else every second look would pass without a request."""
_MOST = 3
"""Number of requests for the same frames before they are given up."""


class RetryRequests:
    """Remembers the requests."""

    def __init__(self) -> None:
        self.gone_end = 0
        """Frames before this one are not available."""
        self._frames, self._times, self._asked_s = range(0), 0, -math.inf

    def asks(self, frames: range, now_s: float, heard_s: float) -> bool:
        """Whether to request some frames now: different ones from before, or the same again after a while.

        heard_s: time of the coordinator's last message; requests to a silent coordinator do not count.
        """
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
