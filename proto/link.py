"""A client's side of the tasks stream: says hello, beats, and registers again after a loss."""

import time

import zmq

from proto.messages import Beat, Hello, Message
from proto.sockets import connect, make_socket, receive, send
from proto.streams import stream_endpoint

BEAT_S = 1.0
LIVENESS_S = 10.0
"""Silence after which the coordinator counts as lost; outlasts its longest step between two looks."""
_FIRST_RETRY_S, _LAST_RETRY_S = 1.0, 32.0


class Link:
    """A DEALER that keeps itself registered with the coordinator."""

    def __init__(self, context: "zmq.Context[zmq.Socket[bytes]]", endpoint: str, hello: Hello) -> None:
        self._context, self._hello = context, hello
        self._endpoint = stream_endpoint(endpoint, "tasks")
        self._retry_s = _FIRST_RETRY_S
        self._open()

    def _open(self) -> None:
        self.socket = make_socket(self._context, zmq.DEALER)
        connect(self.socket, self._endpoint)
        self._heard = self._sent = time.monotonic()
        self._answered = False
        send(self.socket, self._hello)

    def send(self, message: Message) -> bool:
        """Send without waiting; False where the queue is full."""
        self._sent = time.monotonic()
        return send(self.socket, message)

    def receive(self) -> Message | None:
        """The next waiting message, beats left out; raises MalformedMessage."""
        while (message := receive(self.socket)) is not None:
            self._heard = time.monotonic()
            self._answered, self._retry_s = True, _FIRST_RETRY_S
            if not isinstance(message, Beat):
                return message
        return None

    def tick(self) -> None:
        """Beat when it is time, and register anew when the coordinator has long been silent."""
        now = time.monotonic()
        patience_s = LIVENESS_S if self._answered else self._retry_s
        if now - self._heard > patience_s:
            self._retry_s = min(self._retry_s * 2, _LAST_RETRY_S)
            self.socket.close(linger=0)  # or its unsent hello would reach a coordinator that comes back
            self._open()
        elif now - self._sent > BEAT_S:
            self.send(Beat())

    def close(self) -> None:
        """Close the socket, letting what was sent go out."""
        self.socket.close()
