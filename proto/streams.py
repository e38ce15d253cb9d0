"""The message streams between the services, in one table, and where they listen.

Every stream ends at the coordinator, which listens on three ports in a row; the first one names them all.
"""

import re
from dataclasses import dataclass
from typing import Literal

import zmq

DEFAULT_ENDPOINT = "tcp://127.0.0.1:5550"

StreamName = Literal["tasks", "silhouettes", "poses"]


@dataclass(frozen=True)
class Stream:
    """One listening socket of the coordinator and who talks to it."""

    port_offset: int
    coordinator: int
    client: int
    """Kinds of socket (zmq constants)."""
    carries: tuple[str, ...]
    """Message types, towards the coordinator and from it."""


STREAMS: dict[StreamName, Stream] = {
    "tasks": Stream(
        0,
        zmq.ROUTER,
        zmq.DEALER,
        (
            "hello",
            "beat",
            "limb_task",
            "limb_result",
            "limb_refusal",
            "blob_request",
            "blob",
            "take_info",
            "pose_request",
            "pose",
            "silhouettes_request",
            "silhouettes",
            "recording",
            "take_end",
            "live_sources",
            "live_pace",
            "recorded",
        ),
    ),
    "silhouettes": Stream(1, zmq.PULL, zmq.PUSH, ("silhouettes", "live_silhouettes")),
    "poses": Stream(2, zmq.PUB, zmq.SUB, ("credit", "take_info", "pose", "telemetry", "take_end")),
}


class AddressError(ValueError):
    """An address that cannot be used; the text says why and what to do."""


_ENDPOINT = re.compile(r"tcp://(?P<host>\[[0-9A-Fa-f:.]+\]|[\w.*-]+):(?P<port>[0-9]{1,5})", re.ASCII)
_LAST_PORT = 65535 - max(stream.port_offset for stream in STREAMS.values())


def stream_endpoint(endpoint: str, stream: StreamName) -> str:
    """Where a stream listens, from the endpoint that names them all; raises AddressError where it is none."""
    parts = _ENDPOINT.fullmatch(endpoint)
    port = int(parts["port"]) if parts else 0
    if parts is None or not 0 < port <= _LAST_PORT:
        raise AddressError(
            f"{endpoint}: expected an address such as {DEFAULT_ENDPOINT}, its port from 1 to {_LAST_PORT}"
        )
    return f"tcp://{parts['host']}:{port + STREAMS[stream].port_offset}"
