"""Keys on real sockets: who comes in, who does not, who no longer does, and what each is told."""

import logging
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zmq
import zmq.auth

from patience import until
from proto.auth import Admission
from proto.keys import ClientKeys, KeysError, allowed_clients, client_keys, server_keys
from proto.link import Line, Link
from proto.messages import Beat, Credit, Hello, Message
from proto.sockets import connect, make_socket, receive, send
from proto.streams import AddressError
from services.coordinator.ports import Ports
from services.runs.launcher import free_endpoint

_CREDIT = Credit(take="walk", run="0" * 32, next_frame=0, end_frame=8)
Context = zmq.Context[zmq.Socket[bytes]]


@pytest.fixture(autouse=True)
def short_times(monkeypatch: pytest.MonkeyPatch, short_retries: None) -> None:  # noqa: ARG001
    monkeypatch.setattr("proto.link._SAY_FAILED_S", 0.2)
    monkeypatch.setattr("proto.link._SAY_SILENT_S", 0.4)


def make_keys(folder: Path, *clients: str) -> Path:
    (folder / "coordinator" / "clients").mkdir(parents=True)
    zmq.auth.create_certificates(folder / "coordinator", "server")
    for name in clients:
        (folder / name).mkdir()
        zmq.auth.create_certificates(folder / name, "client")
        shutil.copy(folder / "coordinator" / "server.key", folder / name)
        shutil.copy(folder / name / "client.key", folder / "coordinator" / "clients" / f"{name}.key")
    for secret in folder.glob("*/*.key_secret"):
        secret.chmod(0o600)
    return folder


def list_file(folder: Path, name: str) -> Path:
    return folder / "coordinator" / "clients" / f"{name}.key"


class Coordinator:
    """Ports with keys, which say hello back to whoever says hello."""

    def __init__(self, folder: Path) -> None:
        self.admission = Admission(folder)
        self.endpoint = free_endpoint()
        self.ports = Ports(self.endpoint, self.admission)
        self.heard: list[tuple[bytes, Message]] = []

    def turn(self) -> None:
        self.ports.wait(0.01)
        self.ports.publish(_CREDIT)
        while (arrived := self.ports.receive("tasks")) is not None:
            self.heard.append(arrived)
            self.ports.send(arrived[0], Beat())
        while (sent := self.ports.receive("silhouettes")) is not None:
            self.heard.append(sent)

    def reread(self) -> None:
        """Have the list read again, and wait until it was."""
        self.admission.ask_again()
        until(lambda: self.admission._asked == self.admission._answered)
        time.sleep(0.02)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_keys(tmp_path / "keys", "ann", "bob")


@pytest.fixture
def coordinator(folder: Path) -> Iterator[Coordinator]:
    made = Coordinator(folder)
    yield made
    made.ports.close()


def link_of(context: Context, coordinator: Coordinator, keys: ClientKeys | None, name: str = "ann") -> Link:
    hello = Hello(role="limb_worker", name=name, backend="cpu")
    return Link(context, coordinator.endpoint, hello, keys)


def names(coordinator: Coordinator) -> set[str]:
    return {message.name for _, message in coordinator.heard if isinstance(message, Hello)}


def both(coordinator: Coordinator, *lines: Link | Line) -> Callable[[], None]:
    def turn() -> None:
        coordinator.turn()
        for line in lines:
            if isinstance(line, Link):
                line.receive()
            line.tick()

    return turn


def test_who_is_on_the_list_comes_in_on_all_streams(
    context: Context, folder: Path, coordinator: Coordinator
) -> None:
    keys = client_keys(folder, "ann")
    link = link_of(context, coordinator, keys)
    poses = Line(context, coordinator.endpoint, "poses", keys)
    silhouettes = Line(context, coordinator.endpoint, "silhouettes", keys)
    until(lambda: bool(names(coordinator)), turn=both(coordinator, link, poses, silhouettes))
    until(lambda: receive(poses.socket) == _CREDIT, turn=both(coordinator, poses))
    assert send(silhouettes.socket, _CREDIT)
    until(lambda: (b"", _CREDIT) in coordinator.heard, turn=both(coordinator, silhouettes))
    identity = next(i for i, message in coordinator.heard if isinstance(message, Hello))
    assert coordinator.ports.send(identity, _CREDIT)
    until(lambda: link.receive() == _CREDIT, turn=coordinator.turn)
    assert coordinator.ports.counts() == {"malformed": 0, "unwelcome": 0, "handshakes_failed": 0}
    for line in (link, poses, silhouettes):
        line.close()


def _unknown(folder: Path, tmp_path: Path) -> ClientKeys:
    stranger = client_keys(make_keys(tmp_path / "other", "eve"), "eve")
    return ClientKeys(stranger.public, stranger.secret, client_keys(folder, "ann").server)


def _misled(folder: Path, tmp_path: Path) -> ClientKeys:
    ann = client_keys(folder, "ann")
    return ClientKeys(ann.public, ann.secret, client_keys(make_keys(tmp_path / "other", "eve"), "eve").server)


def _swapped(folder: Path, tmp_path: Path) -> ClientKeys:  # noqa: ARG001
    """Somebody else's public key, which is no secret, with a secret key of one's own."""
    ann, bob = client_keys(folder, "ann"), client_keys(folder, "bob")
    return ClientKeys(ann.public, bob.secret, ann.server)


@pytest.mark.parametrize(
    ("wrong", "client_says", "coordinator_says"),
    [
        (_unknown, "the coordinator refuses this service's key", "is not on the list in"),
        (_misled, "server.key beside this service's keys is not this", "whose server.key is not"),
        (lambda *_: None, "the coordinator requires keys: give --keys DIR", "a client without keys"),
        (_swapped, "the handshake failed", ""),
    ],
    ids=["unknown", "misled", "none", "swapped"],
)
@pytest.mark.parametrize("stream", ["tasks", "silhouettes", "poses"])
def test_who_has_no_right_key_stays_out_and_is_told(
    wrong, client_says: str, coordinator_says: str, stream, context, folder, tmp_path, coordinator, caplog
) -> None:
    line = Line(context, coordinator.endpoint, stream, wrong(folder, tmp_path))
    heard = []

    def turn() -> None:
        coordinator.turn()
        line.tick()
        if stream == "poses":
            heard.append(receive(line.socket))
        else:
            send(line.socket, _CREDIT)

    def told(sentence: str) -> list[str]:
        return [text for text in caplog.messages if sentence in text]

    with caplog.at_level(logging.WARNING):
        until(lambda: bool(told(client_says)) and bool(told(coordinator_says)), turn=turn)
        failed = coordinator.ports.counts()["handshakes_failed"]
        until(lambda: coordinator.ports.counts()["handshakes_failed"] > failed + 2, turn=turn)
    assert coordinator.heard == []
    assert not any(heard)
    assert len(told(client_says)) == 1
    if coordinator_says:
        assert len(told(coordinator_says)) == 1
    line.close()


def test_who_is_revoked_is_out_although_connected(
    context: Context, folder: Path, coordinator: Coordinator, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    links = [link_of(context, coordinator, client_keys(folder, name), name) for name in ("ann", "bob")]
    lines = [Line(context, coordinator.endpoint, "poses", client_keys(folder, n)) for n in ("ann", "bob")]
    turn = both(coordinator, *links, *lines)
    until(lambda: names(coordinator) == {"ann", "bob"}, turn=turn)
    until(lambda: all(bool(line.socket.poll(1)) for line in lines), turn=turn)
    ann, bob = (
        {i for i, m in coordinator.heard if isinstance(m, Hello) and m.name == n} for n in ("ann", "bob")
    )
    list_file(folder, "ann").unlink()
    coordinator.reread()
    assert not any(coordinator.ports.send(identity, _CREDIT) for identity in ann)
    assert any(coordinator.ports.send(identity, _CREDIT) for identity in bob)
    coordinator.turn()  # cuts off the poses
    for line in lines:
        time.sleep(0.1)
        while receive(line.socket) is not None:
            pass
    coordinator.heard.clear()
    links[0].send(_CREDIT)
    until(lambda: coordinator.ports.counts()["unwelcome"] > 0, turn=turn)
    until(lambda: bool(lines[1].socket.poll(1)), turn=turn)  # bob is back
    for _ in range(50):
        turn()
    assert not lines[0].socket.poll(0)
    assert not [message for _, message in coordinator.heard if message == _CREDIT]
    assert "ann" not in names(coordinator)
    until(lambda: "the key of ann was revoked" in caplog.text, turn=turn)
    shutil.copy(folder / "ann" / "client.key", list_file(folder, "ann"))  # and comes in again
    coordinator.reread()
    until(lambda: bool(lines[0].socket.poll(1)), turn=turn)
    for link in (*links, *lines):
        link.close()


def test_who_is_added_comes_in_without_a_restart(
    context: Context, folder: Path, coordinator: Coordinator
) -> None:
    list_file(folder, "ann").unlink()
    coordinator.reread()
    link = link_of(context, coordinator, client_keys(folder, "ann"))
    turn = both(coordinator, link)
    until(lambda: coordinator.ports.counts()["handshakes_failed"] > 1, turn=turn)
    shutil.copy(folder / "ann" / "client.key", list_file(folder, "ann"))
    coordinator.reread()
    until(lambda: names(coordinator) == {"ann"}, turn=turn)
    link.close()


def test_a_coordinator_without_keys_is_told_by_who_has_some(
    context: Context, folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    ports = Ports(endpoint := free_endpoint())
    line = Line(context, endpoint, "tasks", client_keys(folder, "ann"))
    until(lambda: "the coordinator has no keys: start it with --keys" in caplog.text, turn=line.tick)
    line.close()
    ports.close()


def test_nobody_who_answers_is_told(context: Context, caplog: pytest.LogCaptureFixture) -> None:
    line = Line(context, free_endpoint(), "tasks")
    until(lambda: "no answer: is the coordinator running" in caplog.text, turn=line.tick)
    line.close()


def test_junk_at_the_door_changes_nothing(context: Context, folder: Path, coordinator: Coordinator) -> None:
    """Bytes that are no ZMTP at all, from many connections, while a client comes in."""
    raw = context.socket(zmq.STREAM)
    raw.setsockopt(zmq.LINGER, 0)
    for k in range(50):
        raw.connect(coordinator.endpoint)
        identity = raw.recv_multipart()[0]
        raw.send_multipart([identity, b"GET / HTTP/1.1\r\n\r\n" * (k + 1)])
    link = link_of(context, coordinator, client_keys(folder, "ann"))
    until(lambda: names(coordinator) == {"ann"}, turn=both(coordinator, link))
    link.close()


@pytest.mark.parametrize("endpoint", ["tcp://0.0.0.0:5550", "tcp://coordinator:5550", "tcp://192.0.2.7:5550"])
def test_connecting_beyond_this_machine_needs_keys(context: Context, folder: Path, endpoint: str) -> None:
    with pytest.raises(AddressError, match="--keys DIR"):
        connect(make_socket(context, zmq.DEALER), endpoint)
    if "coordinator" not in endpoint:
        connect(make_socket(context, zmq.DEALER), endpoint, client_keys(folder, "ann"))


def test_one_folder_for_all_or_one_each(folder: Path) -> None:
    assert client_keys(folder, "ann") == client_keys(folder / "ann", "whatever")
    assert server_keys(folder) == server_keys(folder / "coordinator")
    assert client_keys(folder, "ann").server == server_keys(folder).public
    assert set(allowed_clients(server_keys(folder).clients).values()) == {"ann", "bob"}
    assert b"secret" not in repr(server_keys(folder)).encode()
    assert repr(server_keys(folder).secret) not in repr(server_keys(folder))


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (
            lambda own: (own / "client.key_secret").unlink(),
            "expected the keys client.key_secret, there or in",
        ),
        (lambda own: (own / "server.key").unlink(), "server.key: cannot be read (it is missing)"),
        (lambda own: (own / "server.key").write_text("nothing"), "server.key: contains no public key"),
        (lambda own: (own / "server.key").write_text("public-key"), "server.key: contains no public key"),
        (lambda own: (own / "server.key").write_bytes(b"public-key = \xff\xff"), "contains a damaged key"),
        (lambda own: (own / "server.key").write_text(f'public-key = "{"#" * 40}"'), "contains a damaged key"),
        (lambda own: (own / "server.key").write_text(f'public-key = "{"~" * 40}"'), "contains a damaged key"),
        (lambda own: shutil.copy(own / "client.key", own / "client.key_secret"), "contains no secret key"),
    ],
)
def test_keys_that_cannot_be_used_are_one_sentence(folder: Path, damage, sentence: str) -> None:
    damage(folder / "ann")
    with pytest.raises(KeysError) as refused:
        client_keys(folder, "ann")
    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value)


def test_keys_of_somebody_else_are_one_sentence(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path) -> bool:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "exists", refuse)
    with pytest.raises(KeysError, match="ann: cannot be read by the user of this service"):
        client_keys(folder / "ann", "ann")


def test_a_damaged_entry_of_the_list_lets_nobody_in(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    list_file(folder, "bob").write_text("")
    assert set(allowed_clients(folder / "coordinator" / "clients").values()) == {"ann"}
    assert "bob.key: contains no public key" in caplog.text


def test_a_secret_that_others_can_read_is_told(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    (folder / "ann" / "client.key_secret").chmod(0o640)
    client_keys(folder, "ann")
    assert "chmod 600" in caplog.text
