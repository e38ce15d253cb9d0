"""Sockets: who may listen where, and that sending never waits and says when nobody is there."""

import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
import zmq

from patience import until
from proto.framing import MalformedMessage
from proto.messages import Beat, Credit, Hello, Silhouettes
from proto.sockets import QUEUE_MESSAGES, bind, connect, make_socket, receive, send, wait
from proto.streams import AddressError
from router import receive_from

Socket = zmq.Socket[bytes]
_PATIENCE_S = 10.0
_HELLO = Hello(role="recorder", name="recorder@test:1", backend="")


@pytest.fixture
def make() -> Iterator[Callable[[int], Socket]]:
    """`make(kind)`: a socket of the project's kind, closed after the test without lingering."""
    context: zmq.Context[Socket] = zmq.Context()
    yield lambda kind: make_socket(context, kind)
    context.destroy(linger=0)


def acquainted(make: Callable[[int], Socket]) -> tuple[Socket, Socket, bytes]:
    """A ROUTER and a DEALER that have met, and the DEALER's identity."""
    router, dealer = make(zmq.ROUTER), make(zmq.DEALER)
    connect(dealer, bind(router, "tcp://127.0.0.1:*"))
    assert send(dealer, _HELLO)
    wait([router], _PATIENCE_S)
    arrived = receive_from(router)
    assert arrived is not None
    assert arrived[1] == _HELLO
    return router, dealer, arrived[0]


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp://0.0.0.0:0", "tcp://0.0.0.0:5550", "tcp://*:*", "tcp://*:5550", "tcp://[::]:5550", "tcp://[::0]:5550",
        "tcp://0:5550", "tcp://10.0.0.1:5550", "tcp://192.168.1.2:*", "tcp://somewhere:5550", "tcp://eth0:5550",
        "tcp://localhost.example.com:5550", "tcp://127.0.0.1.example.com:5550", "tcp://127.0.0.1@0.0.0.0:5550",
        "tcp://:5550", "ipc:///tmp/xormocap-test", "",
    ],
)  # fmt: skip
def test_listening_beyond_this_machine_is_refused(make: Callable[[int], Socket], endpoint: str) -> None:
    socket = make(zmq.ROUTER)
    with pytest.raises(AddressError, match=r"bind to tcp://127\.0\.0\.1:PORT$") as refused:
        bind(socket, endpoint)
    assert str(refused.value).startswith(f"{endpoint}: ")
    assert socket.getsockopt_string(zmq.LAST_ENDPOINT) == ""


@pytest.mark.parametrize(
    ("endpoint", "real"),
    [
        ("tcp://127.0.0.1:*", "tcp://127.0.0.1:"),
        ("tcp://127.1.2.3:*", "tcp://127.1.2.3:"),
        ("tcp://localhost:*", "tcp://127.0.0.1:"),
        ("tcp://[::1]:*", "tcp://[::1]:"),
    ],
)
def test_loopback_carries_messages(make: Callable[[int], Socket], endpoint: str, real: str) -> None:
    pull, push = make(zmq.PULL), make(zmq.PUSH)
    try:
        address = bind(pull, endpoint)
    except zmq.ZMQError as error:
        pytest.skip(f"this machine has no {endpoint}: {error}")
    assert address.startswith(real)
    connect(push, address)
    until(lambda: send(push, Beat()))
    wait([pull], _PATIENCE_S)
    assert receive(pull) == Beat()


def test_a_taken_address_is_an_error(make: Callable[[int], Socket]) -> None:
    first = make(zmq.PULL)
    address = bind(first, "tcp://127.0.0.1:*")
    with pytest.raises(AddressError, match="choose another address"):
        bind(make(zmq.PULL), address)


def test_router_knows_a_peer_that_is_gone(make: Callable[[int], Socket]) -> None:
    router, dealer, identity = acquainted(make)
    assert send(router, Beat(), identity)
    dealer.close(linger=0)
    until(lambda: not send(router, Beat(), identity))
    assert not send(router, Beat(), b"stranger")


def test_push_without_a_peer_does_not_wait(make: Callable[[int], Socket]) -> None:
    push = make(zmq.PUSH)
    assert not send(push, Beat())
    connect(push, "tcp://127.0.0.1:9")  # nobody listens; messages queue up to the high-water mark
    began = time.monotonic()
    sent = sum(send(push, Beat()) for _ in range(4 * QUEUE_MESSAGES))
    assert sent <= QUEUE_MESSAGES
    assert time.monotonic() - began < _PATIENCE_S


def test_nothing_waiting_is_none(make: Callable[[int], Socket]) -> None:
    pull, router = make(zmq.PULL), make(zmq.ROUTER)
    bind(pull, "tcp://127.0.0.1:*")
    bind(router, "tcp://127.0.0.1:*")
    assert receive(pull) is None
    assert receive_from(router) is None


def test_malformed_ones_are_told_and_the_next_is_read(make: Callable[[int], Socket]) -> None:
    router, dealer, identity = acquainted(make)
    dealer.send_multipart([b"\xc1", b"nonsense"])
    dealer.send(b"")
    send(dealer, Beat())
    for _ in range(2):
        wait([router], _PATIENCE_S)
        with pytest.raises(MalformedMessage):
            receive_from(router)
    wait([router], _PATIENCE_S)
    assert receive_from(router) == (identity, Beat())


def test_published_to_all_who_listen(make: Callable[[int], Socket]) -> None:
    pub, subs = make(zmq.PUB), [make(zmq.SUB), make(zmq.SUB)]
    address = bind(pub, "tcp://127.0.0.1:*")
    credit = Credit(take="walk", run="0" * 32, next_frame=0, end_frame=8)
    for sub in subs:
        connect(sub, address)
        until(lambda sub=sub: send(pub, credit) and bool(sub.poll(10)))  # type: ignore[misc]
        assert receive(sub) == credit


def test_arrays_arrive_whole(make: Callable[[int], Socket]) -> None:
    pull, push = make(zmq.PULL), make(zmq.PUSH)
    connect(push, bind(pull, "tcp://127.0.0.1:*"))
    planes = np.random.default_rng(1).integers(0, 256, (2, 480, 640), np.uint8)
    until(
        lambda: send(push, Silhouettes(take="t", run="0" * 32, frame=1, cameras=[*range(9)], planes=planes))
    )
    wait([pull], _PATIENCE_S)
    arrived = receive(pull)
    assert isinstance(arrived, Silhouettes)
    np.testing.assert_array_equal(arrived.planes, planes)


def test_a_client_that_is_busy_keeps_its_connection(
    make: Callable[[int], Socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full receive queue would stop libzmq's pings, cut the connection and then abort the process."""
    monkeypatch.setattr("proto.sockets.PING_INTERVAL_MS", 40)
    monkeypatch.setattr("proto.sockets.PING_TIMEOUT_MS", 200)
    router, dealer, identity = acquainted(make)
    beats = 5 * QUEUE_MESSAGES
    for _ in range(beats):  # the client solves a limb and does not look at its socket
        assert send(router, Beat(), identity)
        time.sleep(0.02)
    time.sleep(0.5)
    assert send(router, Beat(), identity)
    got = 0
    while got < beats + 1:
        wait([dealer], _PATIENCE_S)
        assert receive(dealer) == Beat()
        got += 1


def test_a_peer_that_hangs_is_noticed(make: Callable[[int], Socket], monkeypatch: pytest.MonkeyPatch) -> None:
    """The other end stays connected but does not answer pings, like a host that was cut off."""
    monkeypatch.setattr("proto.sockets.PING_INTERVAL_MS", 50)
    monkeypatch.setattr("proto.sockets.PING_TIMEOUT_MS", 200)
    router = make(zmq.ROUTER)
    events = router.get_monitor_socket(zmq.EVENT_DISCONNECTED)
    address = bind(router, "tcp://127.0.0.1:*")
    raw = make(zmq.STREAM)
    raw.connect(address)  # says the ZMTP greeting by hand, then nothing more
    identity = raw.recv_multipart()[0]
    greeting = b"\xff" + bytes(8) + b"\x7f" + b"\x03\x00" + b"NULL".ljust(20, b"\0") + b"\0" + bytes(31)
    ready = b"\x05READY\x0bSocket-Type\x00\x00\x00\x06DEALER\x08Identity\x00\x00\x00\x00"
    raw.send_multipart([identity, greeting])
    raw.send_multipart([identity, b"\x04" + bytes([len(ready)]) + ready])
    until(lambda: bool(events.poll(50)))
