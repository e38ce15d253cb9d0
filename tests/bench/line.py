"""A line with a rate and a latency: a proxy on loopback between a browser and the page's server."""

import socket
import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import Self

from services.viewer.address import LOOPBACK

_READ_BYTES, _SEGMENT_BYTES = 16_384, 1460
_HELD_BYTES = 64_000
"""What a router keeps before it makes the sender wait."""
_SENDER_BYTES = 32_768
"""The socket's own buffer, which counts as much."""


@dataclass(frozen=True)
class Line:
    """What a browser is behind; as slow towards it, and as late both ways."""

    bytes_per_s: float
    latency_s: float
    """One way."""


class SlowProxy:
    """Listens at a port of its own, and passes on what comes, as late as the line says; a context manager."""

    def __init__(self, port: int, line: Line) -> None:
        """Port: the server's, on loopback."""
        self._server_port, self._line = port, line
        self._listener = socket.create_server((LOOPBACK, 0))
        self.port: int = self._listener.getsockname()[1]
        self._open: list[socket.socket] = [self._listener]

    def __enter__(self) -> Self:
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        for end in self._open:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def _accept(self) -> None:
        with suppress(OSError):  # closed
            while True:
                browser, _ = self._listener.accept()
                try:
                    server = socket.create_connection((LOOPBACK, self._server_port))
                except OSError:
                    browser.close()
                    continue
                self._join(browser, server)

    def _join(self, browser: socket.socket, server: socket.socket) -> None:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _SENDER_BYTES)
        for end in (browser, server):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._open += [browser, server]
        _Way(server, browser, self._line).start()
        _Way(browser, server, Line(float("inf"), self._line.latency_s)).start()


class _Way:
    """One direction of one connection, with a thread that reads and one that writes."""

    def __init__(self, source: socket.socket, target: socket.socket, line: Line) -> None:
        self._source, self._target, self._line = source, target, line
        self._held: deque[tuple[float, bytes]] = deque()
        self._held_bytes = 0
        self._is_cut = False
        """Whether nothing can be written any more."""
        self._changed = threading.Condition()

    def start(self) -> None:
        for work in (self._read, self._write):
            threading.Thread(target=work, daemon=True).start()

    def _read(self) -> None:
        data = b"begin"
        while data and not self._is_cut:
            try:
                data = self._source.recv(_READ_BYTES)
            except OSError:  # for the other side that is an end like any
                data = b""
            with self._changed:
                self._changed.wait_for(lambda: self._is_cut or self._held_bytes < _HELD_BYTES)
                self._held.append((time.monotonic() + self._line.latency_s, data))
                self._held_bytes += len(data)
                self._changed.notify_all()

    def _write(self) -> None:
        with suppress(OSError):
            self._pass_on()
            self._target.shutdown(socket.SHUT_WR)
        with self._changed:
            self._is_cut = True
            self._changed.notify_all()

    def _pass_on(self) -> None:
        """Write what is held, each when the line has carried it, up to the end."""
        free_s = time.monotonic()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._held)
                there_s, data = self._held.popleft()
            if not data:
                return
            free_s = max(free_s, there_s)
            for at in range(0, len(data), _SEGMENT_BYTES):
                segment = data[at : at + _SEGMENT_BYTES]
                free_s += len(segment) / self._line.bytes_per_s
                time.sleep(max(free_s - time.monotonic(), 0.0))
                self._target.sendall(segment)
            with self._changed:
                self._held_bytes -= len(data)
                self._changed.notify_all()
