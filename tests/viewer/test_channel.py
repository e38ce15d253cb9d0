"""The page's files and channels: who may open one, what goes through it, and what closes it."""

import http.client
import json
import threading
from collections.abc import Iterator
from contextlib import closing

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from services.viewer.actions import StepBy
from services.viewer.channel import Channel
from services.viewer.web import Web


@pytest.fixture
def web() -> Iterator[Web]:
    with closing(Web()) as running:
        yield running


@pytest.fixture
def channel(web: Web) -> Channel:
    found = Channel()
    web.add(found)
    return found


def _open(web: Web, key: str) -> ClientConnection:
    return connect(f"ws://127.0.0.1:{web.port}/channel?key={key}", open_timeout=10, close_timeout=1)


def _fields(message: str | bytes) -> tuple[dict[str, object], bytes]:
    """A message's header, and its blobs one after another."""
    assert isinstance(message, bytes)
    end = 4 + int.from_bytes(message[:4], "little")
    return json.loads(message[4:end]), message[end:]


@pytest.mark.parametrize(
    ("path", "status", "kind"),
    [
        ("/", 200, "text/html"),
        ("/main.js", 200, "text/javascript"),
        ("/page.css", 200, "text/css"),
        ("/nothing.js", 404, "text/plain"),
        ("/../server.py", 404, "text/plain"),
        ("/channel", 403, "text/plain"),
    ],
)
def test_files(web: Web, path: str, status: int, kind: str) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", web.port, timeout=10)
    connection.request("GET", path)
    answer = connection.getresponse()
    assert answer.status == status
    assert str(answer.headers["Content-Type"]).startswith(kind)
    assert "default-src 'self'" in answer.headers["Content-Security-Policy"]


def test_only_a_known_key_opens_a_channel(web: Web, channel: Channel) -> None:
    for key in ("", "wrong", channel.key[:-1]):
        with pytest.raises(InvalidStatus):
            _open(web, key)
    with _open(web, channel.key):
        assert channel.await_open(5)
    web.remove(channel)
    with pytest.raises(InvalidStatus):
        _open(web, channel.key)


def test_messages_have_blobs_and_are_answered(web: Web, channel: Channel) -> None:
    channel.send("early", words="nobody hears this")
    with _open(web, channel.key) as browser:
        assert channel.await_open(5)
        assert channel.await_seen(0.1), "whoever opens it owes no answer"
        channel.send("grid", [b"abc", b"de"], frame=7)
        fields, blobs = _fields(browser.recv(timeout=5))
        assert (fields["kind"], fields["frame"], fields["blobs"], blobs) == ("grid", 7, [3, 2], b"abcde")
        assert not channel.await_seen(0.1)
        browser.send(json.dumps({"do": "seen", "number": fields["number"]}))
        assert channel.await_seen(5)
        browser.send('{"do": "step", "frames": 2}')
        assert channel.actions.get(timeout=5) == StepBy(do="step", frames=2)
    channel.send("late")
    assert channel.await_seen(5), "a browser that has left owes no answer"


@pytest.mark.parametrize("noise", ["", "{}", '{"do": "seek"}', "x" * 5000, b"\xff\x00"])
def test_noise_closes_the_channel_and_it_can_be_opened_again(
    web: Web, channel: Channel, noise: str | bytes
) -> None:
    with _open(web, channel.key) as browser:
        assert channel.await_open(5)
        browser.send(noise)
        with pytest.raises(ConnectionClosed):
            browser.recv(timeout=10)
    with _open(web, channel.key):
        assert channel.await_open(5)
        assert channel.opened == 2


def test_a_browser_that_floods_is_cut_off(web: Web, channel: Channel) -> None:
    with _open(web, channel.key) as browser, pytest.raises(ConnectionClosed):
        for _ in range(10_000):
            browser.send('{"do": "step", "frames": 1}')
        browser.recv(timeout=10)
    assert channel.actions.full()


def test_the_second_browser_with_a_key_replaces_the_first(web: Web, channel: Channel) -> None:
    with _open(web, channel.key) as first, _open(web, channel.key) as second:
        with pytest.raises(ConnectionClosed):
            first.recv(timeout=10)
        sender = threading.Thread(target=channel.send, args=("hello",))
        sender.start()
        assert _fields(second.recv(timeout=10))[0]["kind"] == "hello"
        sender.join()
