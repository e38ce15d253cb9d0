"""What hostile messages are fired with, and who is watched meanwhile."""

from contextlib import suppress

import zmq

from bench.soak.fuzz import rss_mib
from bench.soak.hostile import Frames
from proto.sockets import connect, make_socket, take
from proto.streams import StreamName, stream_endpoint
from services.runs.launcher import Launcher

PATIENCE_S = 240.0
"""How long a service may take for what it must do at last."""
BURST = 200
"""Messages after which one looks whether the service is well."""
BREATH_S, LOOK_S = 0.01, 0.1
"""Waits for a queue to have room, and for something to happen."""
TARGETS: dict[StreamName, int] = {"tasks": zmq.DEALER, "silhouettes": zmq.PUSH}
"""The coordinator's streams that take something in, and with what kind of socket."""


class BrokenServiceError(Exception):
    """A service did what it must not; the text says what."""


class Fire:
    """Sends hostile messages to one socket."""

    def __init__(self, context: "zmq.Context[zmq.Socket[bytes]]", endpoint: str, stream: StreamName) -> None:
        self.socket = make_socket(context, TARGETS[stream])
        self._monitor = self.socket.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED)
        connect(self.socket, stream_endpoint(endpoint, stream))

    @property
    def is_heard(self) -> bool:
        """Whether somebody has answered its handshake."""
        return bool(self._monitor.poll(0))

    def shoot(self, frames: Frames) -> bool:
        """Send without waiting; False if the queue is full."""
        while self.socket.type == zmq.DEALER and take(self.socket) is not None:
            pass  # answers are not what this is about
        return sent(self.socket, frames)


def sent(socket: "zmq.Socket[bytes]", frames: Frames) -> bool:
    """Send without waiting; False if the queue is full."""
    try:
        socket.send_multipart(frames or [b""], flags=zmq.DONTWAIT)
    except zmq.Again:
        return False
    return True


class Memory:
    """Follows the memory of a service's process."""

    def __init__(self, launcher: Launcher, name: str) -> None:
        self._launcher, self._name = launcher, name
        self._seen_mib: list[float] = []

    def look(self) -> None:
        """Note what it takes now."""
        with suppress(OSError, IndexError):  # it may just have ended
            self._seen_mib.append(rss_mib(self._launcher.pids(self._name)[0]))

    @property
    def growth_mib(self) -> float:
        """The end's over the first tenth's, by when everything has been in use."""
        seen = self._seen_mib
        return round(seen[-1] - max(seen[: 1 + len(seen) // 10]), 1) if seen else 0.0
