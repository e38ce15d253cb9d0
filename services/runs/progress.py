"""How far a run is, as its poses tell whoever listens."""

import time
from dataclasses import dataclass

import zmq

from proto.framing import MalformedMessage
from proto.messages import Pose
from proto.sockets import connect, make_socket, receive, wait
from proto.streams import stream_endpoint

_LOOK_S = 0.2


@dataclass(frozen=True)
class Progress:
    """How far a run is."""

    frames_done: int
    frames_per_s: float
    energy_px: float
    stage: str
    """What is being done, in words."""


class PoseWatch:
    """Follows the poses of a run for its progress."""

    def __init__(self, endpoint: str, frames: range) -> None:
        self._start, self._end = frames.start, frames.start
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket = make_socket(self._context, zmq.SUB)
        connect(self._socket, stream_endpoint(endpoint, "poses"))
        self._frames: set[int] = set()
        self._started_s = time.monotonic()
        self._first_s: float | None = None
        self._energy_px = 0.0

    def look(self, ended: bool) -> Progress:
        """Wait a moment for poses; returns the state of things."""
        wait([self._socket], _LOOK_S)
        try:
            while (message := receive(self._socket)) is not None:
                if isinstance(message, Pose):
                    self._first_s = self._first_s or time.monotonic()
                    self._frames.add(message.frame)
                    self._end = max(self._end, message.frame + 1)
                    self._energy_px = message.energy_px
        except MalformedMessage:
            pass  # progress only; the recorder counts
        stage = "writing results" if ended else "tracking" if self._frames else "finding the first pose"
        seen, elapsed_s = len(self._frames), time.monotonic() - (self._first_s or self._started_s)
        frames_per_s = max(seen - 1, 0) / elapsed_s if elapsed_s > 0 else 0.0
        return Progress(self._end - self._start, frames_per_s, self._energy_px, stage)

    def close(self) -> None:
        """Listen no longer."""
        self._socket.close()
        self._context.term()
