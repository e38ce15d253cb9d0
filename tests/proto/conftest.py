"""Sockets and short waits for tests of the wire."""

from collections.abc import Iterator

import pytest
import zmq

Context = zmq.Context[zmq.Socket[bytes]]


@pytest.fixture
def context() -> Iterator[Context]:
    """Whatever was opened in it is closed after the test without lingering."""
    context: Context = zmq.Context()
    yield context
    context.destroy(linger=0)


@pytest.fixture
def short_retries(monkeypatch: pytest.MonkeyPatch) -> None:
    """Clients try again soon."""
    monkeypatch.setattr("proto.link._FIRST_RETRY_S", 0.1)
    monkeypatch.setattr("proto.link._LAST_RETRY_S", 0.3)
    monkeypatch.setattr("proto.sockets._RECONNECT_MS", 10)
