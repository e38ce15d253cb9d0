"""A client's side of a stream: reconnects where that helps, and says in one sentence what is wrong otherwise.

On the tasks stream it also sends hello and beats, and registers again after a loss.
"""

import logging
import time
from collections.abc import Callable

import zmq
from zmq.utils.monitor import recv_monitor_message

from proto.keys import ClientKeys
from proto.messages import Beat, Hello, Message
from proto.sockets import connect, make_socket, receive, send
from proto.streams import FROM_CLIENTS, STREAMS, TO_CLIENTS, StreamName, stream_endpoint

log = logging.getLogger(__name__)

_FIRST_RETRY_S, _LAST_RETRY_S = 1.0, 32.0
_SAY_FAILED_S, _SAY_SILENT_S = 3.0, 15.0
"""How long handshakes must fail, or nobody answer, before this is logged."""
_EVENTS = (
    zmq.EVENT_HANDSHAKE_SUCCEEDED
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
)
_FINAL = (zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL, zmq.EVENT_HANDSHAKE_FAILED_AUTH)
"""After these failures libzmq does not try again."""

Context = zmq.Context[zmq.Socket[bytes]]


class Line:
    """A client's socket of one stream, which reconnects until it succeeds.

    Each `tick` may replace `socket`.
    """

    def __init__(
        self, context: Context, endpoint: str, stream: StreamName, keys: ClientKeys | None = None
    ) -> None:
        self._context, self._stream, self._keys = context, stream, keys
        self._endpoint = stream_endpoint(endpoint, stream)
        self._retry_s = _FIRST_RETRY_S
        self._failure: int | None = None
        self._is_told = False
        self._down_s: float | None = time.monotonic()
        self._open()

    def _open(self) -> None:
        self.socket = make_socket(self._context, STREAMS[self._stream].client)
        self._monitor = self.socket.get_monitor_socket(_EVENTS)
        self._opened_s = time.monotonic()
        self._greetings = 0
        self._is_dead = False
        connect(self.socket, self._endpoint, self._keys)

    def send(self, message: Message) -> bool:
        """Send without waiting; False if the queue is full."""
        return send(self.socket, message)

    def receive(self) -> Message | None:
        """The next waiting message, or None; raises MalformedMessage."""
        return receive(self.socket)

    def reopen(self) -> None:
        """Close the socket, drop what it has not sent, and open another."""
        self.close(linger_ms=0)
        self._open()

    def tick(self) -> bool:
        """Check the connection; True if there is a new one, on which nothing has been sent yet."""
        is_anew, now = self._read_events(), time.monotonic()
        if self._is_dead and now - self._opened_s > self._retry_s:
            self._retry_s = min(self._retry_s * 2, _LAST_RETRY_S)
            self.reopen()
            is_anew = True
        if self._down_s is not None and not self._is_told:
            patience_s = _SAY_SILENT_S if self._failure is None else _SAY_FAILED_S
            if now - self._down_s > patience_s:
                self._is_told = True
                log.warning("%s", self._sentence())
        return is_anew

    def _read_events(self) -> bool:
        """Read handshake events; True if there was one after the socket's first."""
        is_anew = False
        while self._monitor.poll(0):
            event = recv_monitor_message(self._monitor)["event"]
            if event == zmq.EVENT_HANDSHAKE_SUCCEEDED:
                self._greetings += 1
                is_anew = self._greetings > 1
                self._down_s, self._failure, self._is_told = None, None, False
                self._retry_s = _FIRST_RETRY_S
            elif event & _EVENTS:
                self._failure, self._is_dead = event, event in _FINAL
                self._down_s = self._down_s or time.monotonic()
        return is_anew

    def _sentence(self) -> str:
        """What is probably wrong."""
        if self._failure is None:
            return f"{self._endpoint}: no answer: is the coordinator running, and is this its address?"
        if self._failure == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            return (
                f"{self._endpoint}: the coordinator refuses this service's key: it was revoked or was never "
                "on the list of clients, or the coordinator has not read that again yet (SIGHUP)"
            )
        if self._keys is None:
            return f"{self._endpoint}: the handshake failed: the coordinator requires keys: give --keys DIR"
        if self._failure == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL:
            return (
                f"{self._endpoint}: the handshake failed: the coordinator has no keys: start it with --keys"
            )
        return (
            f"{self._endpoint}: the handshake failed: server.key beside this service's keys is not this "
            "coordinator's, or the coordinator has no keys: start it with --keys"
        )

    def close(self, linger_ms: int | None = None) -> None:
        """Close the socket, by default after sending what is queued."""
        self.socket.disable_monitor()
        self._monitor.close(linger=0)
        self.socket.close(linger=linger_ms)


class Link(Line):
    """A client's socket of the tasks stream that keeps itself registered with the coordinator."""

    def __init__(
        self,
        context: Context,
        endpoint: str,
        hello: Hello,
        keys: ClientKeys | None = None,
        also: Callable[[], Message] | None = None,
    ) -> None:
        """also: makes a message that is sent after every hello."""
        super().__init__(context, endpoint, "tasks", keys)
        self._hello, self._also = hello, also
        self._hello_again_s = _FIRST_RETRY_S
        self._register()

    def _register(self) -> None:
        """Send hello to the present coordinator."""
        self._heard = self._sent = time.monotonic()
        self._answered = False
        send(self.socket, self._hello)
        if self._also is not None:
            send(self.socket, self._also())

    def send(self, message: Message) -> bool:
        """Send without waiting; False if the queue is full."""
        self._sent = time.monotonic()
        return send(self.socket, message)

    def receive(self) -> Message | None:
        """The next waiting message except beats; raises MalformedMessage."""
        while (message := receive(self.socket)) is not None:
            self._heard = time.monotonic()
            self._answered, self._hello_again_s = True, _FIRST_RETRY_S
            if not isinstance(message, Beat):
                return message
        return None

    def tick(self) -> bool:
        """Send a beat when it is time, and register again if the coordinator has been silent for long.

        True if it has registered again: the coordinator has then forgotten earlier tasks.
        """
        is_anew = super().tick()
        if is_anew:
            self._register()
        now = time.monotonic()
        patience_s = TO_CLIENTS.silence_s if self._answered else self._hello_again_s
        if now - self._heard > patience_s:
            self._hello_again_s = min(self._hello_again_s * 2, _LAST_RETRY_S)
            self.reopen()  # the old socket's unsent hello would reach a coordinator that comes back
            self._register()
            is_anew = True
        elif now - self._sent > FROM_CLIENTS.every_s:
            self.send(Beat())
        return is_anew
