"""Sockets as this project uses them: small queues, short linger, dead peers noticed, loopback by default."""

import ipaddress
from urllib.parse import urlsplit

import zmq

from proto.framing import MAX_FRAME_BYTES, decode, encode
from proto.messages import Message
from proto.streams import AddressError

QUEUE_MESSAGES = 8
"""High-water mark of what is sent and of silhouettes received, all large; a long queue is only old data."""
_SMALL_QUEUE_MESSAGES = 10_000
"""High-water mark of all else that is received: beats, poses, results. It must never be reached: libzmq stops
reading for a full queue, so that pings go unanswered and a peer that is only busy loses its connection, and
once that is made anew it aborts the process (libzmq issues 3937 and 4767)."""
LINGER_MS = 500
PING_INTERVAL_MS = 500
PING_TIMEOUT_MS = 2500
"""libzmq pings from its own thread, so a peer that is busy still answers and one that hangs does not."""
_RECONNECT_MS, _RECONNECT_MAX_MS = 100, 4000


class OpenBindError(AddressError):
    """A socket was asked to listen beyond this machine without keys."""


def make_socket(context: "zmq.Context[zmq.Socket[bytes]]", kind: int) -> "zmq.Socket[bytes]":
    """Make a socket of a zmq kind with this project's options."""
    socket = context.socket(kind)
    socket.setsockopt(zmq.SNDHWM, QUEUE_MESSAGES)
    socket.setsockopt(zmq.RCVHWM, QUEUE_MESSAGES if kind == zmq.PULL else _SMALL_QUEUE_MESSAGES)
    socket.setsockopt(zmq.LINGER, LINGER_MS)
    socket.setsockopt(zmq.MAXMSGSIZE, MAX_FRAME_BYTES)
    socket.setsockopt(zmq.HEARTBEAT_IVL, PING_INTERVAL_MS)
    socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, PING_TIMEOUT_MS)
    socket.setsockopt(zmq.HEARTBEAT_TTL, PING_TIMEOUT_MS)
    socket.setsockopt(zmq.RECONNECT_IVL, _RECONNECT_MS)
    socket.setsockopt(zmq.RECONNECT_IVL_MAX, _RECONNECT_MAX_MS)
    if kind == zmq.ROUTER:
        socket.setsockopt(zmq.ROUTER_MANDATORY, 1)  # sending to a peer that is gone says so
    if kind == zmq.SUB:
        socket.setsockopt(zmq.SUBSCRIBE, b"")
    return socket


def bind(socket: "zmq.Socket[bytes]", endpoint: str) -> str:
    """Bind to tcp://host:port and return the real endpoint, the port known; beyond loopback is refused.

    Raises OpenBindError, or AddressError where the address is taken or not this machine's.
    """
    host = urlsplit(endpoint.replace("*", "0")).hostname or ""
    if not _is_loopback(host):
        raise OpenBindError(
            f"{endpoint}: listening beyond this machine would let anyone in; bind to tcp://127.0.0.1:PORT"
        )
    _allow_ipv6(socket, endpoint)
    try:
        socket.bind(endpoint)
    except zmq.ZMQError as error:
        raise AddressError(f"{endpoint}: cannot listen there ({error}): choose another address") from None
    return socket.getsockopt_string(zmq.LAST_ENDPOINT)


def connect(socket: "zmq.Socket[bytes]", endpoint: str) -> None:
    """Connect to tcp://host:port, now or once somebody listens there."""
    _allow_ipv6(socket, endpoint)
    socket.connect(endpoint)


def _allow_ipv6(socket: "zmq.Socket[bytes]", endpoint: str) -> None:
    """Switch to IPv6 for an address in brackets; for a name it would hide hosts that have IPv4 only."""
    socket.setsockopt(zmq.IPV6, "[" in endpoint)


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def send(socket: "zmq.Socket[bytes]", message: Message, to: bytes | None = None) -> bool:
    """Send without waiting; `to`: the peer's identity on a ROUTER. False: gone, or its queue is full."""
    frames = encode(message)
    try:
        socket.send_multipart(frames if to is None else [to, *frames], flags=zmq.DONTWAIT)
    except zmq.ZMQError as error:
        if error.errno in (zmq.EAGAIN, zmq.EHOSTUNREACH):
            return False
        raise
    return True


def receive(socket: "zmq.Socket[bytes]") -> Message | None:
    """Take one waiting message, or None if there is none; raises MalformedMessage."""
    try:
        return decode(socket.recv_multipart(flags=zmq.DONTWAIT))
    except zmq.Again:
        return None


def receive_from(socket: "zmq.Socket[bytes]") -> tuple[bytes, Message] | None:
    """Take one waiting message and its sender's identity from a ROUTER; raises MalformedMessage."""
    try:
        identity, *frames = socket.recv_multipart(flags=zmq.DONTWAIT)
    except zmq.Again:
        return None
    return identity, decode(frames)


def wait(sockets: "list[zmq.Socket[bytes]]", timeout_s: float) -> None:
    """Return when one of the sockets has a message waiting, at the latest after timeout_s."""
    poller = zmq.Poller()
    for socket in sockets:
        poller.register(socket, zmq.POLLIN)
    poller.poll(round(max(timeout_s, 0.0) * 1000))
