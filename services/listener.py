"""What every client does that listens to a coordinator's poses: recorder, viewer, status."""

import logging
import time
from abc import ABC, abstractmethod

import zmq

from proto.framing import MalformedMessage
from proto.keys import ClientKeys
from proto.link import Line, Link
from proto.messages import Message
from proto.sockets import wait
from services.metrics import DROPPED

_MOST_AT_ONCE = 500
"""Messages that are taken in before anything else gets its turn."""

log = logging.getLogger(__name__)


class PosesListener(ABC):
    """Listens to a coordinator's poses stream, on which nobody registers, so that nobody waits for it."""

    def __init__(self, endpoint: str, keys: ClientKeys | None) -> None:
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.lines: list[Line | Link] = [Line(self.context, endpoint, "poses", keys)]
        """What is listened to, in this order."""
        self.heard_s = time.monotonic()
        """Time of the last message (time.monotonic)."""

    @abstractmethod
    def take_in(self, message: Message) -> None:
        """A message has come; raises MalformedMessage for one that cannot be understood."""

    def refuse(self, error: MalformedMessage) -> None:
        """A message has come that cannot be understood."""
        DROPPED.inc()
        log.warning("dropped a malformed message: %s", error)

    def listen(self, timeout_s: float) -> None:
        """Wait a moment for messages, and take them in."""
        wait([line.socket for line in self.lines], timeout_s)
        for line in self.lines:
            for _ in range(_MOST_AT_ONCE):
                try:
                    message = line.receive()
                    if message is None:
                        break
                    self.heard_s = time.monotonic()
                    self.take_in(message)
                except MalformedMessage as error:
                    self.refuse(error)
            line.tick()

    def close(self) -> None:
        """Close the sockets, letting what was sent go out."""
        for line in self.lines:
            line.close()
        self.context.term()
