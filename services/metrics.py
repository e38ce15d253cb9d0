"""Metrics of a service for Prometheus, on an HTTP port: off by default, and only on loopback."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from prometheus_client import Counter, start_http_server

from services.mocap.errors import UserError

_ADDRESS = re.compile(r"(?:(?P<host>[\w.-]+|\[[0-9A-Fa-f:.]+\]):)?(?P<port>[0-9]{1,5})", re.ASCII)
_LAST_PORT = 65535
TIME_BUCKETS_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Upper bounds of the histogram of durations."""
DROPPED = Counter("xormocap_messages_dropped", "Malformed messages.")
"""For clients; xormocap_dropped has the coordinator's. Metrics of one service only are in its metrics.py."""


@contextmanager
def offering(address: str | None) -> Iterator[None]:
    """Serve metrics inside this block at PORT on loopback, or at HOST:PORT; None: not at all.

    Raises UserError if that is not an address, or the process cannot listen there.
    """
    if not address:
        yield
        return
    parts = _ADDRESS.fullmatch(address)
    port = int(parts["port"]) if parts else 0
    if parts is None or not 0 < port <= _LAST_PORT:
        raise UserError(f"--metrics {address}: expected a port from 1 to {_LAST_PORT}, or HOST:PORT")
    host = (parts["host"] or "127.0.0.1").strip("[]")
    try:
        server, thread = start_http_server(port, host)
    except OSError as problem:
        raise UserError(
            f"--metrics {address}: cannot listen there ({problem.strerror}): choose another"
        ) from None
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
