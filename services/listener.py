"""How clients listen to a coordinator: messages that wait are taken in, malformed ones dropped."""

import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Callable

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


def drop(error: MalformedMessage) -> None:
    """Count and log a message that cannot be understood."""
    DROPPED.inc()
    log.warning("dropped a malformed message: %s", error)


def hear(
    line: Line,
    take_in: Callable[[Message], None],
    refuse: Callable[[MalformedMessage], None] = drop,
    most: int = _MOST_AT_ONCE,
) -> None:
    """Take in the messages that wait on a line, at most so many, so that others get their turn.

    refuse: called where a message, or what `take_in` finds in it, is malformed.
    """
    for _ in range(most):
        try:
            message = line.receive()
            if message is None:
                return
            take_in(message)
        except MalformedMessage as error:
            refuse(error)


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
        drop(error)

    def listen(self, timeout_s: float) -> None:
        """Wait a moment for messages, and take them in."""
        wait([line.socket for line in self.lines], timeout_s)
        for line in self.lines:
            hear(line, self._note, self.refuse)
            line.tick()

    def _note(self, message: Message) -> None:
        self.heard_s = time.monotonic()
        self.take_in(message)

    def close(self) -> None:
        """Close the sockets, letting what was sent go out."""
        for line in self.lines:
            line.close()
        self.context.term()
