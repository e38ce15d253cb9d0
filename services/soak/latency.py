"""How long each frame of a run took, watched from outside as a viewer does."""

import threading
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import zmq

from proto.framing import MalformedMessage
from proto.link import Line
from proto.messages import Pose, Telemetry
from proto.sockets import receive, wait

_LOOK_S = 0.1


@dataclass(frozen=True)
class Latency:
    """What losing a worker has added to a frame."""

    way: str
    """How it was lost."""
    frame: int
    added_s: float
    """Over what the same frame took in an undisturbed run."""
    deadline_s: float
    """After which the coordinator gave a task to somebody else just then."""


class Stopwatch:
    """Follows the poses of a run in a thread of its own; a context manager."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="stopwatch", daemon=True)
        self.frame = 0
        """The frame that is being solved."""
        self.deadline_s = 0.0
        """The present one of limb tasks."""
        self.seconds: dict[int, float] = {}
        """What each frame took, from the one before on."""

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ending.set()
        self._thread.join()

    def _watch(self) -> None:
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        line = Line(context, self._endpoint, "poses")
        while not self._ending.is_set():
            wait([line.socket], _LOOK_S)
            self._read(line)
            line.tick()
        line.close()
        context.term()

    def _read(self, line: Line) -> None:
        try:
            while (message := receive(line.socket)) is not None:
                if isinstance(message, Telemetry):
                    self.deadline_s = message.deadline_s
                elif isinstance(message, Pose):
                    self.frame = message.frame + 1
                    self.seconds[message.frame] = message.seconds["frame"]
        except MalformedMessage:
            pass  # the coordinator's own messages are sound
