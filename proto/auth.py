"""Access control: the list of clients, and the thread that checks every handshake against it.

libzmq asks only once, at the handshake. So every receiver also asks `Admission.admits` for every message: a
client whose key is removed from the list loses access at once, although its connection stays.
"""

import logging
import threading
from pathlib import Path

import zmq
from zmq.utils import z85
from zmq.utils.monitor import recv_monitor_message

from proto.keys import allowed_clients, server_keys

log = logging.getLogger(__name__)

ZAP_DOMAIN = b"xormocap"
"""Without a domain, libzmq would accept every client while no thread answers."""
_ZAP_ENDPOINT = "inproc://zeromq.zap.01"
_ZAP_REQUEST_FRAMES = 6
_LOOK_MS = 100
_MOST_TOLD = 1000
"""At most this many different refusals are logged between two readings of the list; more are only counted."""
_FAILURES = (
    zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
)
_STRANGERS: dict[int, str] = {
    zmq.PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH: "a client without keys",
    zmq.PROTOCOL_ERROR_ZMTP_CRYPTOGRAPHIC: "a client whose server.key is not this coordinator's",
}


class Admission:
    """The coordinator's keys and its list of clients, which is read again on request.

    Raises KeysError without keys. Any thread may ask; only one may call `refresh`.
    """

    def __init__(self, folder: Path) -> None:
        self.keys = server_keys(folder)
        self._names = allowed_clients(self.keys.clients)
        self._former: dict[bytes, str] = {}
        self._asked = self._answered = 0
        self.revocations = 0
        """How often clients were removed from the list since the start."""
        log.info("%d clients have access: %s", len(self._names), ", ".join(self._names.values()) or "nobody")

    def ask_again(self) -> None:
        """Request another reading of the list; safe in a signal handler."""
        self._asked += 1

    def refresh(self) -> bool:
        """Read the list if that was requested; returns whether it was."""
        asked = self._asked
        if asked == self._answered:
            return False
        self._answered = asked
        before, now = self._names, allowed_clients(self.keys.clients)
        gone = {key: name for key, name in before.items() if key not in now}
        self._former = {key: name for key, name in (self._former | gone).items() if key not in now}
        self._names = now
        self.revocations += bool(gone)
        added = [name for key, name in now.items() if key not in before]
        log.info("read the list of clients again: %d have access; new: %s; revoked: %s", len(now),
                 ", ".join(added) or "none", ", ".join(gone.values()) or "none")  # fmt: skip
        return True

    def admits(self, key: bytes | None) -> bool:
        """Whether the client with this public key has access."""
        return key in self._names

    def why_not(self, key: bytes) -> str:
        """Why a client has no access, in words."""
        if key in self._former:
            return f"the key of {self._former[key]} was revoked"
        return f"its key {key.decode()} is not on the list in {self.keys.clients}"


class Doorkeeper:
    """Answers libzmq's question at every handshake of a context's sockets, and counts the refused ones.

    Make it before any socket of the context listens. Call `watch` for each socket before it listens, then
    `start`.
    """

    def __init__(self, context: "zmq.Context[zmq.Socket[bytes]]", admission: Admission) -> None:
        self._admission = admission
        self._zap = context.socket(zmq.REP)
        self._zap.setsockopt(zmq.LINGER, 0)
        self._zap.bind(_ZAP_ENDPOINT)
        self._watched: list[zmq.Socket[bytes]] = []
        self._monitors: dict[zmq.Socket[bytes], str] = {}
        self._told: set[str] = set()
        self._thread = threading.Thread(target=self._keep, name="doorkeeper", daemon=True)
        self._closing = False
        self.refused = 0
        """Number of handshakes that failed."""

    def watch(self, name: str, socket: "zmq.Socket[bytes]") -> None:
        """Monitor a socket that will listen."""
        self._watched.append(socket)
        self._monitors[socket.get_monitor_socket(_FAILURES)] = name

    def start(self) -> None:
        """Start to answer; until then handshakes wait."""
        self._thread.start()

    def _keep(self) -> None:
        poller = zmq.Poller()
        for socket in (self._zap, *self._monitors):
            poller.register(socket, zmq.POLLIN)
        while not self._closing:
            ready = [socket for socket, _ in poller.poll(_LOOK_MS)]
            if self._admission.refresh():
                self._told.clear()
            for socket in ready:
                if socket is self._zap:
                    self._answer(self._zap.recv_multipart())
                else:
                    self._note_failure(socket)

    def _answer(self, request: list[bytes]) -> None:
        """Answer one question of libzmq's (ZeroMQ RFC 27)."""
        if len(request) < _ZAP_REQUEST_FRAMES:
            request += [b""] * _ZAP_REQUEST_FRAMES
        version, request_id, domain, address, _, mechanism, *credentials = request
        key = z85.encode(credentials[0]) if mechanism == b"CURVE" and credentials else None
        welcome = domain == ZAP_DOMAIN and self._admission.admits(key)
        if key is not None and not welcome:
            who = address.decode(errors="replace")
            self._tell_once(f"refused a client at {who}: {self._admission.why_not(key)}")
        status, user = (b"200", key or b"") if welcome else (b"400", b"")
        self._zap.send_multipart([version, request_id, status, b"", user, b""])

    def _note_failure(self, monitor: "zmq.Socket[bytes]") -> None:
        event = recv_monitor_message(monitor)
        if not event["event"] & _FAILURES:
            return  # the monitor has ended
        stream = self._monitors[monitor]
        self.refused += 1
        if event["event"] == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL:
            who = _STRANGERS.get(event["value"], "a client that does not speak ZeroMQ's protocol")
            self._tell_once(f"refused a client at the stream {stream}: {who}")

    def _tell_once(self, sentence: str) -> None:
        if sentence not in self._told and len(self._told) < _MOST_TOLD:
            self._told.add(sentence)
            log.warning("%s", sentence)

    def close(self) -> None:
        """End the thread. Call this in the thread of the sockets' owner, while the sockets are still open."""
        for socket in self._watched:
            socket.disable_monitor()  # the thread keeps reading meanwhile, so that libzmq never waits for it
        self._closing = True
        if self._thread.ident is not None:
            self._thread.join()
        for socket in (self._zap, *self._monitors):
            socket.close(linger=0)
