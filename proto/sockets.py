"""ZeroMQ sockets with this project's options: small queues, short linger, detection of dead peers, loopback
by default."""

import time
from urllib.parse import urlsplit

import zmq

from proto.auth import ZAP_DOMAIN
from proto.framing import MAX_FRAME_BYTES, MAX_HEADER_BYTES, decode, encode
from proto.keys import ClientKeys, ServerKeys
from proto.messages import Message
from proto.streams import AddressError, is_loopback

QUEUE_MESSAGES = 8
"""High-water mark for sending and for received silhouettes. These messages are large, and a long queue only
holds old data."""
_SMALL_QUEUE_MESSAGES = 10_000
"""High-water mark for all other received messages: beats, poses, results. It must never be reached: libzmq
stops reading when a queue is full, so pings go unanswered and a peer that is only busy loses its connection;
when it reconnects, libzmq aborts the process (libzmq issues 3937 and 4767)."""
MAX_REPLY_BYTES = 2 * MAX_HEADER_BYTES
"""The longest frame that a ROUTER accepts: nothing large is sent to the coordinator on the tasks stream, and
its queue is long."""
_CURVE_BYTES = 64
"""More than encryption adds to a frame; libzmq compares the encrypted frame with its limit."""
LINGER_MS = 500
PING_INTERVAL_MS = 500
PING_TIMEOUT_MS = 2500
"""libzmq pings from its own thread, so a peer that is busy still answers and one that hangs does not."""
_RECONNECT_MS, _RECONNECT_MAX_MS = 100, 4000
"""Exponential backoff between connection attempts up to the longest wait; none on the same machine, where an
attempt is cheap."""
_POLLIN = int(zmq.POLLIN)
_REBIND_TRIES, _REBIND_S = 200, 0.005


def make_socket(context: "zmq.Context[zmq.Socket[bytes]]", kind: int) -> "zmq.Socket[bytes]":
    """Make a socket of a zmq kind with this project's options."""
    socket = context.socket(kind)
    socket.setsockopt(zmq.SNDHWM, QUEUE_MESSAGES)
    socket.setsockopt(zmq.RCVHWM, QUEUE_MESSAGES if kind == zmq.PULL else _SMALL_QUEUE_MESSAGES)
    socket.setsockopt(zmq.LINGER, 0 if kind == zmq.SUB else LINGER_MS)  # it sends only subscriptions
    longest = MAX_REPLY_BYTES if kind == zmq.ROUTER else MAX_FRAME_BYTES
    socket.setsockopt(zmq.MAXMSGSIZE, longest + _CURVE_BYTES)
    socket.setsockopt(zmq.HEARTBEAT_IVL, PING_INTERVAL_MS)
    socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, PING_TIMEOUT_MS)
    socket.setsockopt(zmq.HEARTBEAT_TTL, PING_TIMEOUT_MS)
    socket.setsockopt(zmq.RECONNECT_IVL, _RECONNECT_MS)
    socket.setsockopt(zmq.RECONNECT_IVL_MAX, _RECONNECT_MAX_MS)
    if kind == zmq.ROUTER:
        socket.setsockopt(zmq.ROUTER_MANDATORY, 1)  # sending to a peer that is gone is an error
    if kind == zmq.SUB:
        socket.setsockopt(zmq.SUBSCRIBE, b"")
    return socket


def bind(socket: "zmq.Socket[bytes]", endpoint: str, keys: ServerKeys | None = None) -> str:
    """Bind to tcp://host:port and return the endpoint with the real port; beyond loopback only with keys.

    With keys, only a Doorkeeper of the context admits clients. Raises AddressError, also if the
    address is in use or not on this machine.
    """
    if keys is not None:
        socket.setsockopt(zmq.CURVE_SERVER, 1)
        socket.setsockopt(zmq.CURVE_SECRETKEY, keys.secret)
        socket.setsockopt(zmq.ZAP_DOMAIN, ZAP_DOMAIN)
        socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)
    elif not _is_here(endpoint):
        raise AddressError(
            f"{endpoint}: listening beyond this machine without keys lets everybody in: make keys with "
            "xormocap keys new DIR and give --keys DIR, or bind to tcp://127.0.0.1:PORT"
        )
    _allow_ipv6(socket, endpoint)
    try:
        socket.bind(endpoint)
    except zmq.ZMQError as error:
        raise AddressError(f"{endpoint}: cannot listen there ({error}): choose another address") from None
    return socket.getsockopt_string(zmq.LAST_ENDPOINT)


def connect(socket: "zmq.Socket[bytes]", endpoint: str, keys: ClientKeys | None = None) -> None:
    """Connect to tcp://host:port, now or as soon as a server listens there; beyond loopback only with keys.

    Raises AddressError.
    """
    if _is_here(endpoint):
        socket.setsockopt(zmq.RECONNECT_IVL_MAX, 0)
    if keys is not None:
        socket.setsockopt(zmq.CURVE_PUBLICKEY, keys.public)
        socket.setsockopt(zmq.CURVE_SECRETKEY, keys.secret)
        socket.setsockopt(zmq.CURVE_SERVERKEY, keys.server)
    elif not _is_here(endpoint):
        raise AddressError(
            f"{endpoint}: connecting beyond this machine needs keys: give --keys DIR, the folder that "
            "xormocap keys made for this service where the coordinator runs"
        )
    _allow_ipv6(socket, endpoint)
    try:
        socket.connect(endpoint)
    except zmq.ZMQError as error:
        raise AddressError(f"{endpoint}: cannot connect to it ({error}): name a host and a port") from None


def cut_all(socket: "zmq.Socket[bytes]", endpoint: str) -> None:
    """Close every connection of a listening socket; clients with access reconnect.

    libzmq can close connections only together with their listener, and only all at once.
    """
    socket.unbind(endpoint)
    for _ in range(_REBIND_TRIES):
        try:
            socket.bind(endpoint)
        except zmq.ZMQError:  # libzmq's thread has not released the port yet
            time.sleep(_REBIND_S)
        else:
            return
    raise AddressError(f"{endpoint}: cannot listen there again: choose another address")


def _allow_ipv6(socket: "zmq.Socket[bytes]", endpoint: str) -> None:
    """Switch to IPv6 for an address in brackets. For a host name this would exclude hosts with only IPv4."""
    socket.setsockopt(zmq.IPV6, "[" in endpoint)


def _is_here(endpoint: str) -> bool:
    return is_loopback(urlsplit(endpoint.replace("*", "0")).hostname or "")


def send(socket: "zmq.Socket[bytes]", message: Message, to: bytes | None = None) -> bool:
    """Send without waiting; `to`: the peer's identity on a ROUTER. Returns False if the peer is gone or its
    queue is full."""
    frames = encode(message)
    try:
        socket.send_multipart(frames if to is None else [to, *frames], flags=zmq.DONTWAIT)
    except zmq.ZMQError as error:
        if error.errno in (zmq.EAGAIN, zmq.EHOSTUNREACH):
            return False
        raise
    return True


def take(socket: "zmq.Socket[bytes]") -> tuple[list[bytes], bytes | None] | None:
    """Take the frames of one waiting message, undecoded, and its sender's key; None if there is none.

    On a ROUTER the first frame is the sender's identity. The key is in Z85, proved by the handshake; it is
    None without keys.
    """
    try:
        first = socket.recv(flags=zmq.DONTWAIT, copy=False)
    except zmq.Again:
        return None
    frames = [first.bytes]
    while socket.getsockopt(zmq.RCVMORE):
        frames.append(socket.recv())
    try:
        key = str(first.get("User-Id")).encode() or None
    except zmq.ZMQError:  # only a Doorkeeper sets this property
        key = None
    return frames, key


def receive(socket: "zmq.Socket[bytes]") -> Message | None:
    """Take one waiting message, or None if there is none; raises MalformedMessage."""
    taken = take(socket)
    return None if taken is None else decode(taken[0])


def wait(sockets: "list[zmq.Socket[bytes]]", timeout_s: float) -> "list[zmq.Socket[bytes]]":
    """Wait for a message on some of the sockets, at most timeout_s; returns the sockets that have one."""
    ready = zmq.zmq_poll([(socket, _POLLIN) for socket in sockets], round(max(timeout_s, 0.0) * 1000))
    waiting = {id(socket) for socket, _ in ready}
    return [socket for socket in sockets if id(socket) in waiting]
