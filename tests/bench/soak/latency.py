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
from services.mocap.search.chains import LIMBS

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
    limb_s: float
    """What one search of the slowest limb took in that frame."""

    @property
    def is_within(self) -> bool:
        """Whether it is what a lost task explains: the deadline, and one more search by somebody else."""
        return self.added_s <= self.deadline_s + self.limb_s

    def as_json(self) -> dict[str, object]:
        """For a file."""
        return {**vars(self), "is_within": self.is_within}


@dataclass(frozen=True)
class Lap:
    """What a frame took, from the one before on."""

    seconds: float
    limb_s: float
    """One search of its slowest limb, in the mean of its passes."""
    deadline_s: float
    """The longest of limb tasks meanwhile, as far as the coordinator told of it."""

    @classmethod
    def of(cls, pose: Pose, deadline_s: float) -> Self:
        """As a solved frame tells of it."""
        searches = [pose.seconds[limb] for limb in LIMBS if limb in pose.seconds]
        return cls(pose.seconds["frame"], max(searches, default=0.0) / max(pose.passes, 1), deadline_s)


class Stopwatch:
    """Follows the poses of a run in a thread of its own; a context manager."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="stopwatch", daemon=True)
        self.frame = 0
        """The frame that is being solved."""
        self._deadline_s = self._longest_s = 0.0
        self.laps: dict[int, Lap] = {}
        """By frame."""

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
                    self._deadline_s = message.deadline_s
                    self._longest_s = max(self._longest_s, message.deadline_s)
                elif isinstance(message, Pose):
                    self.frame = message.frame + 1
                    self.laps[message.frame] = Lap.of(message, self._longest_s)
                    self._longest_s = self._deadline_s
        except MalformedMessage:
            pass  # the coordinator's own messages are sound
