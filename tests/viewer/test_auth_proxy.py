"""The proxy: who comes in, and that nobody else does."""

import http.client
import socket
import threading
from collections.abc import Iterator
from contextlib import closing
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from services.address import Address
from services.mocap.errors import UserError
from services.viewer import auth_proxy as auth_proxy
from services.viewer.auth_proxy import AuthProxy, Head, MalformedHeadError

TOKEN = "a-long-enough-token"  # noqa: S105


class _Page(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        words = f"{self.path} cookie={self.headers.get('Cookie')}".encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(words)))
        self.end_headers()
        self.wfile.write(words)

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def proxy(monkeypatch: pytest.MonkeyPatch) -> Iterator[AuthProxy]:
    monkeypatch.setattr(auth_proxy, "_WRONG_S", 0.05)
    with ThreadingHTTPServer(("127.0.0.1", 0), _Page) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with closing(AuthProxy(Address("127.0.0.1", 0), TOKEN, lambda _: server.server_port)) as running:
            yield running
        server.shutdown()


def _get(proxy: AuthProxy, path: str, **headers: str) -> tuple[int, str, dict[str, str]]:
    connection = http.client.HTTPConnection("127.0.0.1", proxy.port, timeout=10)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    return answer.status, answer.read().decode(), dict(answer.getheaders())


def _cookie(proxy: AuthProxy) -> str:
    _, _, headers = _get(proxy, f"/?token={TOKEN}")
    return headers["Set-Cookie"].partition(";")[0]


def test_without_a_token_there_is_a_form(proxy: AuthProxy) -> None:
    status, page, _ = _get(proxy, "/index.html")
    assert status == 401
    assert "token" in page and "cookie=" not in page


def test_a_wrong_token_does_not_help(proxy: AuthProxy) -> None:
    status, page, headers = _get(proxy, "/?token=something-else")
    assert status == 401
    assert "token is wrong" in page
    assert "Set-Cookie" not in headers


def test_the_token_gives_a_cookie_that_does_not_tell_it(proxy: AuthProxy) -> None:
    status, _, headers = _get(proxy, f"/?token={TOKEN}")
    assert (status, headers["Location"]) == (303, "/")
    cookie = headers["Set-Cookie"]
    assert TOKEN not in cookie
    assert "HttpOnly" in cookie and "SameSite=Strict" in cookie


def test_the_cookie_opens_and_stays_outside(proxy: AuthProxy) -> None:
    status, page, _ = _get(proxy, "/a?b=c", Cookie=_cookie(proxy))
    assert (status, page) == (200, "/a?b=c cookie=None")
    assert _get(proxy, "/", Cookie=_cookie(proxy)[:-1] + "x")[0] == 401
    assert _get(proxy, "/", Cookie="")[0] == 401


def test_without_a_token_everybody_gets_in_but_other_sites_websockets() -> None:
    with ThreadingHTTPServer(("127.0.0.1", 0), _Page) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with closing(AuthProxy(Address("127.0.0.1", 0), None, lambda _: server.server_port)) as proxy:
            assert _get(proxy, "/a")[:2] == (200, "/a cookie=None")
            asks = {"Upgrade": "websocket", "Connection": "Upgrade", "Origin": "http://evil.example"}
            assert _get(proxy, "/a", **asks)[0] == 403
        server.shutdown()


def test_every_request_is_looked_at(proxy: AuthProxy) -> None:
    """A second request on a connection that was let in gets no answer: there is one a connection."""
    request = f"GET /{{}} HTTP/1.1\r\nHost: here\r\nCookie: {_cookie(proxy)}\r\n\r\n"
    with socket.create_connection(("127.0.0.1", proxy.port), timeout=10) as raw:
        raw.sendall((request.format("first") + "GET /second HTTP/1.1\r\nHost: here\r\n\r\n").encode())
        answer = b""
        while block := raw.recv(65536):
            answer += block
    assert b"/first" in answer and b"/second" not in answer


def test_websockets_of_other_sites_stay_outside(proxy: AuthProxy) -> None:
    asks = {"Cookie": _cookie(proxy), "Upgrade": "websocket", "Connection": "Upgrade"}
    ours = f"127.0.0.1:{proxy.port}"
    assert _get(proxy, "/", Host=ours, Origin="http://evil.example", **asks)[0] == 403
    assert _get(proxy, "/", Host=ours, **asks)[0] == 403
    assert _get(proxy, "/", Host=ours, Origin=f"http://{ours}", **asks)[0] == 200


@pytest.mark.parametrize(
    "noise",
    [b"\r\n\r\n", b"GET / HTTP/1.0\r\n\r\n", b"GET http://x/ HTTP/1.1\r\n\r\n", b"\x00" * 100 + b"\r\n\r\n"],
)
def test_noise_closes_the_connection(proxy: AuthProxy, noise: bytes) -> None:
    with socket.create_connection(("127.0.0.1", proxy.port), timeout=10) as raw:
        raw.sendall(noise)
        assert raw.recv(100) == b""
    assert _get(proxy, "/", Cookie=_cookie(proxy))[0] == 200


def test_endless_heads_are_refused(proxy: AuthProxy) -> None:
    with socket.create_connection(("127.0.0.1", proxy.port), timeout=10) as raw:
        raw.sendall(b"GET / HTTP/1.1\r\nA: " + b"a" * 100_000)
        assert raw.recv(12) == b"HTTP/1.1 431"


def test_a_port_that_is_taken_is_said(proxy: AuthProxy) -> None:
    with pytest.raises(UserError, match="cannot listen there"):
        AuthProxy(Address("127.0.0.1", proxy.port), TOKEN, lambda _: 1)


def test_a_head_is_passed_on_as_it_came() -> None:
    head = Head.of(
        b"GET /x?y HTTP/1.1\r\nHost: a\r\nConnection: keep-alive\r\nCookie: b=c\r\nX-Y:  z\r\n\r\n"
    )
    assert head.alone() == b"GET /x?y HTTP/1.1\r\nHost: a\r\nX-Y: z\r\nConnection: close\r\n\r\n"
    assert head.cookies == {"b": "c"}
    with pytest.raises(MalformedHeadError):
        Head.of(b"GET / HTTP/1.1\r\nno colon\r\n\r\n")
