"""A client keeps itself registered, whoever goes away and comes back."""

import time
from dataclasses import replace

import numpy as np
import pytest
import zmq

from proto.framing import MalformedMessage
from proto.link import Link
from proto.messages import Beat, Blob, Hello, Message, TakeEnd
from proto.sockets import bind, make_socket, send, wait
from proto.streams import FROM_CLIENTS, TO_CLIENTS
from router import receive_from

_HELLO = Hello(role="limb_worker", name="limb_worker@test:1", backend="cpu")
_PATIENCE_S = 10.0
Context = zmq.Context[zmq.Socket[bytes]]


@pytest.fixture(autouse=True)
def short_times(monkeypatch: pytest.MonkeyPatch, short_retries: None) -> None:  # noqa: ARG001
    monkeypatch.setattr("proto.link.FROM_CLIENTS", replace(FROM_CLIENTS, every_s=0.05))
    monkeypatch.setattr("proto.link.TO_CLIENTS", replace(TO_CLIENTS, silence_s=0.4))


class Coordinator:
    """The coordinator's end: answers hellos and beats of those it knows, as the real one does."""

    def __init__(self, context: Context, endpoint: str) -> None:
        self.socket = make_socket(context, zmq.ROUTER)
        self.endpoint = bind(self.socket, endpoint)
        self.known: dict[bytes, str] = {}
        self.beats = 0

    def turn(self) -> None:
        wait([self.socket], 0.01)
        while (arrived := receive_from(self.socket)) is not None:
            identity, message = arrived
            if isinstance(message, Hello):
                self.known[identity] = message.name
            self.beats += isinstance(message, Beat)
            if identity in self.known:
                send(self.socket, Beat(), identity)

    def tell(self, message: Message) -> None:
        assert send(self.socket, message, next(reversed(self.known)))

    def die(self) -> None:
        self.socket.close(linger=0)


def both_until(link: Link, coordinator: Coordinator, registrations: int) -> None:
    """Let both ends work until so many identities have said hello."""
    deadline = time.monotonic() + _PATIENCE_S
    while len(coordinator.known) < registrations:
        assert time.monotonic() < deadline, "never registered"
        coordinator.turn()
        assert link.receive() is None
        link.tick()


def work(link: Link, seconds: float, coordinator: Coordinator | None = None) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if coordinator is None:
            time.sleep(0.01)
        else:
            coordinator.turn()
        link.receive()
        link.tick()


def reborn(context: Context, endpoint: str) -> Coordinator:
    """Bind where another was a moment ago."""
    deadline = time.monotonic() + _PATIENCE_S
    while True:
        try:
            return Coordinator(context, endpoint)
        except zmq.ZMQError:
            assert time.monotonic() < deadline
            time.sleep(0.02)


def test_registers_once_and_beats(context: Context) -> None:
    coordinator = Coordinator(context, "tcp://127.0.0.1:*")
    link = Link(context, coordinator.endpoint, _HELLO)
    both_until(link, coordinator, 1)
    work(link, 1.0, coordinator)
    assert list(coordinator.known.values()) == [_HELLO.name]
    assert coordinator.beats >= 3
    link.close()


def test_beats_are_not_handed_out_and_other_messages_are(context: Context) -> None:
    coordinator = Coordinator(context, "tcp://127.0.0.1:*")
    link = Link(context, coordinator.endpoint, _HELLO)
    both_until(link, coordinator, 1)
    for message in (Beat(), TakeEnd(take="walk", run="0" * 32, first_frame=0, end_frame=3), Beat()):
        coordinator.tell(message)
    wait([link.socket], _PATIENCE_S)
    deadline = time.monotonic() + _PATIENCE_S
    while (message := link.receive()) is None:  # type: ignore[assignment]
        assert time.monotonic() < deadline
    assert message == TakeEnd(take="walk", run="0" * 32, first_frame=0, end_frame=3)
    assert link.receive() is None


def test_malformed_messages_are_told(context: Context) -> None:
    coordinator = Coordinator(context, "tcp://127.0.0.1:*")
    link = Link(context, coordinator.endpoint, _HELLO)
    both_until(link, coordinator, 1)
    work(link, 0.1)
    coordinator.socket.send_multipart([next(iter(coordinator.known)), b"junk"])
    wait([link.socket], _PATIENCE_S)
    with pytest.raises(MalformedMessage):
        link.receive()
    assert link.receive() is None


def test_registers_again_with_a_coordinator_that_came_back(context: Context) -> None:
    first = Coordinator(context, "tcp://127.0.0.1:*")
    link = Link(context, first.endpoint, _HELLO)
    both_until(link, first, 1)
    work(link, 0.1, first)
    first.die()
    work(link, 0.7)
    second = reborn(context, first.endpoint)
    both_until(link, second, 1)
    assert list(second.known.values()) == [_HELLO.name]
    second.tell(TakeEnd(take="walk", run="0" * 32, first_frame=0, end_frame=3))
    work_until_message(link, TakeEnd(take="walk", run="0" * 32, first_frame=0, end_frame=3))
    link.close()


def test_registers_again_with_a_coordinator_that_forgot_it(context: Context) -> None:
    """The connection holds but beats go unanswered: only another hello helps."""
    coordinator = Coordinator(context, "tcp://127.0.0.1:*")
    link = Link(context, coordinator.endpoint, _HELLO)
    both_until(link, coordinator, 1)
    coordinator.known.clear()
    both_until(link, coordinator, 1)
    assert list(coordinator.known.values()) == [_HELLO.name]
    link.close()


def test_waits_for_a_coordinator_that_is_not_there_yet(context: Context) -> None:
    early = Coordinator(context, "tcp://127.0.0.1:*")
    early.die()
    link = Link(context, early.endpoint, _HELLO)
    work(link, 0.5)
    coordinator = reborn(context, early.endpoint)
    both_until(link, coordinator, 1)
    link.close()


def test_sending_without_a_coordinator_never_waits(context: Context) -> None:
    early = Coordinator(context, "tcp://127.0.0.1:*")
    early.die()
    link = Link(context, early.endpoint, _HELLO)
    content = Blob(hash="0" * 64, kind="rig", content=np.zeros(0, np.uint8))
    assert not all(link.send(content) for _ in range(50))
    link.close()


def work_until_message(link: Link, expected: Message) -> None:
    deadline = time.monotonic() + _PATIENCE_S
    while (message := link.receive()) is None:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert message == expected
