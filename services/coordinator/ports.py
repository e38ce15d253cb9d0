"""The coordinator's three sockets, with access control by keys."""

import logging
from collections import OrderedDict

import zmq

from proto.auth import Admission, Doorkeeper
from proto.framing import MalformedMessage, decode
from proto.messages import Message
from proto.sockets import bind, cut_all, make_socket, send, take, wait
from proto.streams import STREAMS, StreamName, stream_endpoint
from services.blob_store import keep_latest
from services.pose_size import with_whole_poses

log = logging.getLogger(__name__)

_SENDERS_KEPT = 4096
"""Clients whose keys are remembered, the most recent ones; with keys, other clients are sent nothing."""
_MOST_DROPPED = 64
_HEARD: tuple[StreamName, ...] = ("silhouettes", "tasks")
"""Streams that receive messages."""
_QUEUED_POSES = 1000
"""For each subscriber: poses are small, and a recorder asks again for missed ones."""
_LIVE_SILHOUETTES = 128
"""For live input: silhouettes queue while the tracker searches for a person for some seconds, and are tracked
afterwards."""


class Ports:
    """Opens the streams at an endpoint; only `wait` blocks.

    With an admission, messages of clients without access are counted and dropped unread, and such clients are
    sent nothing. Raises AddressError.
    """

    def __init__(self, endpoint: str, admission: Admission | None = None, *, is_live: bool = False) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._admission = admission
        self._doorkeeper = None if admission is None else Doorkeeper(self._context, admission)
        self._sockets = {
            name: make_socket(self._context, stream.coordinator) for name, stream in STREAMS.items()
        }
        self._sockets["poses"].set(zmq.SNDHWM, _QUEUED_POSES)
        if is_live:
            self._sockets["silhouettes"].set(zmq.RCVHWM, _LIVE_SILHOUETTES)
        if self._doorkeeper is not None:
            for name, socket in self._sockets.items():
                self._doorkeeper.watch(name, socket)
        keys = None if admission is None else admission.keys
        self._addresses = {
            name: bind(socket, stream_endpoint(endpoint, name), keys)
            for name, socket in self._sockets.items()
        }
        if self._doorkeeper is not None:
            self._doorkeeper.start()
        self._revocations = 0
        self._keys: OrderedDict[bytes, bytes] = OrderedDict()
        self._malformed = self._unwelcome = 0

    def counts(self) -> dict[str, int]:
        """Numbers of dropped and refused messages."""
        refused = self._doorkeeper.refused if self._doorkeeper else 0
        return {"malformed": self._malformed, "unwelcome": self._unwelcome, "handshakes_failed": refused}

    def publish(self, message: Message) -> None:
        """Send to all subscribers of poses."""
        self._cut_revoked()
        send(self._sockets["poses"], message)

    def _cut_revoked(self) -> None:
        """Disconnect all subscribers of poses after a client's access was revoked; the others reconnect in a
        moment.

        Subscribers cannot be told apart. What they miss meanwhile is published again or requested.
        """
        if self._admission is not None and self._revocations != self._admission.revocations:
            self._revocations = self._admission.revocations
            cut_all(self._sockets["poses"], self._addresses["poses"])

    def send(self, identity: bytes, message: Message) -> bool:
        """Send on the tasks stream; False if the peer is gone or has no access any more."""
        if self._admission is not None and not self._admission.admits(self._keys.get(identity)):
            return False
        return send(self._sockets["tasks"], message, identity)

    def wait(self, timeout_s: float) -> list[StreamName]:
        """Wait for a message, at most timeout_s; returns the streams that have one."""
        self._cut_revoked()
        ready = wait([self._sockets[name] for name in _HEARD], timeout_s)
        return [name for name in _HEARD if self._sockets[name] in ready]

    def receive(self, stream: StreamName) -> tuple[bytes, Message] | None:
        """The next message of a stream and, on tasks, its sender's identity; None when none is left.

        Also None after many dropped messages, so that other streams get their turn.
        """
        for _ in range(_MOST_DROPPED):
            taken = take(self._sockets[stream])
            if taken is None:
                break
            frames, key = taken
            if self._admission is not None and not self._admission.admits(key):
                self._unwelcome += 1
                continue
            identity = frames.pop(0) if stream == "tasks" else b""
            if key is not None and identity:
                keep_latest(self._keys, identity, key, _SENDERS_KEPT)
            try:
                return identity, with_whole_poses(decode(frames))
            except MalformedMessage as error:
                self._malformed += 1
                log.warning("dropped a malformed message: %s", error)
        return None

    def drop(self, message: Message) -> None:
        """Count and drop a message that is not for a coordinator."""
        self._malformed += 1
        log.warning("dropped a message that is not for a coordinator: %s", message.type)

    def close(self) -> None:
        """Close the sockets, letting what was sent go out."""
        if self._doorkeeper is not None:
            self._doorkeeper.close()
        for socket in self._sockets.values():
            socket.close()
        self._context.term()
