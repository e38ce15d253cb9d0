"""Whether a service is well, as it says itself, on a socket of its own: `python -m services.health` asks.

Where that socket is, the environment says; without a word there is none. A container's probe asks every few
seconds, so that this module imports next to nothing.
"""

import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import zmq

VARIABLE = "XORMOCAP_HEALTH"
"""Path of the socket on which a service answers."""
SILENCE_S = 60.0
"""A service whose loop has not come round for so long counts as hung; the first pose takes some seconds."""
_PATIENCE_MS = 2000
_LOOK_MS = 200
_CLOCK_DIGITS = 3


class _Answers:
    """A thread that tells whoever asks when the service's loop last came round."""

    def __init__(self, path: str, service: str, looked_s: Callable[[], float | None]) -> None:
        self._service, self._looked_s = service, looked_s
        self._began_s = time.monotonic()
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket = self._context.socket(zmq.REP)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.bind(f"ipc://{path}")
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._answer_all, name="health", daemon=True)
        self._thread.start()

    def _answer_all(self) -> None:
        while not self._ending.is_set():
            if self._socket.poll(_LOOK_MS):
                self._socket.recv_multipart()
                self._socket.send_json(self._state())
        self._socket.close()

    def _state(self) -> dict[str, object]:
        now, looked_s = time.monotonic(), self._looked_s()
        silent_s = None if looked_s is None else round(now - looked_s, _CLOCK_DIGITS)
        return {
            "service": self._service,
            "state": "starting" if silent_s is None else "working" if silent_s < SILENCE_S else "hung",
            "silent_s": silent_s,
            "up_s": round(now - self._began_s, _CLOCK_DIGITS),
        }

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self._context.term()


@contextmanager
def answering(service: str, looked_s: Callable[[], float | None]) -> Iterator[None]:
    """Answer for a service inside this block, if the environment names a place for that.

    looked_s: when the service's loop last came round (time.monotonic), None before its first round.
    """
    path = os.environ.get(VARIABLE)
    if not path:
        yield
        return
    answers = _Answers(path, service, looked_s)
    try:
        yield
    finally:
        answers.close()


def ask(path: Path) -> Mapping[str, object]:
    """What the service that answers at a path says; raises TimeoutError where none does."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    socket = context.socket(zmq.REQ)
    socket.setsockopt(zmq.LINGER, 0)
    try:
        socket.connect(f"ipc://{path}")
        socket.send(b"")
        if not socket.poll(_PATIENCE_MS):
            raise TimeoutError(f"{path}: no service answers there")
        answer = json.loads(socket.recv())
        assert isinstance(answer, dict)  # noqa: S101  (our own socket, for mypy)
        return answer
    finally:
        socket.close()
        context.term()


def health() -> None:
    """Ask the service whose socket XORMOCAP_HEALTH names whether it works, as a container's probe does."""
    path = os.environ.get(VARIABLE)
    if not path:
        sys.exit(f"{VARIABLE}: expected the path of a service's socket for health")
    try:
        answer = ask(Path(path))
    except TimeoutError as error:
        sys.exit(str(error))
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.exit(0 if answer["state"] == "working" else 1)


if __name__ == "__main__":
    health()
