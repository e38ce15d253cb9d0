"""Metrics of a service for Prometheus, on an HTTP port: off by default, and only on loopback."""

from collections.abc import Iterator
from contextlib import contextmanager

from prometheus_client import Counter, start_http_server

from services.address import LOOPBACK, Address
from services.mocap.errors import UserError

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
    expected = "a port from 1 to 65535, or HOST:PORT"
    place = Address.of(address, "--metrics", expected, default_host=LOOPBACK)
    try:
        server, thread = start_http_server(place.port, place.host)
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
