"""The message streams between the services in one table: where they listen, what they carry and how often.

Every stream ends at the coordinator, which listens on three ports in a row; the first port identifies all
three.
"""

import ipaddress
import math
import re
from dataclasses import dataclass
from typing import Literal

import zmq

DEFAULT_ENDPOINT = "tcp://127.0.0.1:5550"

StreamName = Literal["tasks", "silhouettes", "poses"]


@dataclass(frozen=True)
class Flow:
    """Messages that go one way over a stream."""

    types: tuple[str, ...]
    every_s: float = math.inf
    """How often one of them is sent at least, if only a beat or what was said before."""
    silence_s: float = math.inf
    """Time without any of them after which the sender counts as gone."""


@dataclass(frozen=True)
class Stream:
    """One listening socket of the coordinator and its messages."""

    port_offset: int
    coordinator: int
    client: int
    """Kinds of socket (zmq constants)."""
    incoming: tuple[Flow, ...] = ()
    """Towards the coordinator."""
    outgoing: tuple[Flow, ...] = ()


FROM_CLIENTS = Flow(
    (
        *("hello", "beat", "limb_result", "limb_refusal", "blob_request", "pose_request"),
        *("silhouettes_request", "recording", "recorded", "pose"),
    ),
    every_s=1.0,
    silence_s=10.0,
)
"""An idle worker that is silent gets no task until it is heard again."""
TO_CLIENTS = Flow(
    ("beat", "limb_task", "blob", "take_info", "pose", "pose_request", "silhouettes", "take_end"),
    every_s=0.2,
    silence_s=60.0,
)
"""The silence outlasts the coordinator's longest step between two looks, also with the slowest search on a
busy machine. One that died, was stopped or is cut off libzmq's pings notice."""
FROM_LIVE_CAMERAS = Flow(("live_sources",), every_s=0.5, silence_s=5.0)
PUBLISHED = Flow(("credit", "take_info", "pose", "telemetry", "take_end"), every_s=0.5, silence_s=2.0)
"""What is still true is published again for those who joined late, and how the take is doing."""

ASK_AGAIN_S = 0.5
"""After this time a client asks again for content and frames that have not come."""
ASK_PACE_AGAIN_S = 0.1
"""The same for the pace of live input before there is one."""
ASK_RECORDERS_AGAIN_S = 1.0
"""The same for poses that the coordinator asks recorders for."""
RECORDING_EVERY_S = 1.0
"""A recorder tells at most so often what it has."""
RESEND_S = 3.0
"""Silhouettes that the credit still asks for after this time were lost with a coordinator. They are sent
again."""

STREAMS: dict[StreamName, Stream] = {
    "tasks": Stream(
        0,
        zmq.ROUTER,
        zmq.DEALER,
        incoming=(FROM_CLIENTS, FROM_LIVE_CAMERAS),
        outgoing=(TO_CLIENTS, Flow(("live_pace",))),
    ),
    "silhouettes": Stream(1, zmq.PULL, zmq.PUSH, incoming=(Flow(("silhouettes", "live_silhouettes")),)),
    "poses": Stream(2, zmq.PUB, zmq.SUB, outgoing=(PUBLISHED,)),
}


class AddressError(ValueError):
    """An address cannot be used; the text says why and what to do."""


_ENDPOINT = re.compile(r"tcp://(?P<host>\[[0-9A-Fa-f:.]+\]|[\w.*-]+):(?P<port>[0-9]{1,5})", re.ASCII)
_LAST_PORT = 65535 - max(stream.port_offset for stream in STREAMS.values())


def is_loopback(host: str) -> bool:
    """Whether a host's name or number is this machine's own, which no other reaches."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _may_be_host(host: str) -> bool:
    """Whether an address in brackets is one; names are looked up later."""
    if not host.startswith("["):
        return True
    try:
        ipaddress.IPv6Address(host[1:-1])
    except ValueError:
        return False
    return True


def stream_endpoint(endpoint: str, stream: StreamName) -> str:
    """The endpoint of a stream, from the endpoint that names all; raises AddressError if that is not an
    address."""
    parts = _ENDPOINT.fullmatch(endpoint)
    port = int(parts["port"]) if parts else 0
    if parts is None or not 0 < port <= _LAST_PORT or not _may_be_host(parts["host"]):
        raise AddressError(
            f"{endpoint}: expected an address such as {DEFAULT_ENDPOINT}, its port from 1 to {_LAST_PORT}"
        )
    return f"tcp://{parts['host']}:{port + STREAMS[stream].port_offset}"
