"""A proxy in front of the page's servers: browsers see one address, and need its token if it has one.

A browser that gives the token gets in, and then has a cookie. The proxy forwards bytes and reads only the
first request of each connection. It makes the server close the connection after each answer, so that there
is no second request; a websocket may stay open.
"""

import asyncio
import contextlib
import hashlib
import hmac
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Self
from urllib.parse import parse_qs, urlsplit

from services.address import LOOPBACK, Address
from services.mocap.errors import UserError

MOST_HEAD_BYTES = 32768


class MalformedHeadError(ValueError):
    """The bytes are not the head of an HTTP/1.1 request."""


@dataclass(frozen=True)
class Head:
    """Request line and headers."""

    line: str
    target: str
    """Path and query."""
    headers: tuple[tuple[str, str], ...]
    """Names as received, and values."""

    @classmethod
    def of(cls, text: bytes) -> Self:
        """Parse a head including its empty line; raises MalformedHeadError."""
        lines = text.decode("latin-1").split("\r\n")[:-2]
        words = lines[0].split(" ")
        if len(words) != 3 or words[2] != "HTTP/1.1" or not words[1].startswith("/"):
            raise MalformedHeadError("expected a request of HTTP/1.1")
        pairs = [line.partition(":") for line in lines[1:]]
        if any(not colon or not name or name != name.strip() for name, colon, _ in pairs):
            raise MalformedHeadError("expected headers of a name, a colon and a value")
        return cls(lines[0], words[1], tuple((name, value.strip()) for name, _, value in pairs))

    def value(self, name: str) -> str:
        """A header's value; empty if there is none."""
        return next((value for key, value in self.headers if key.lower() == name.lower()), "")

    @property
    def is_websocket(self) -> bool:
        """Whether the client requests a websocket."""
        return self.value("Upgrade").lower() == "websocket"

    @property
    def is_from_elsewhere(self) -> bool:
        """Whether a page of another site requests a websocket."""
        origin = self.value("Origin")
        return self.is_websocket and urlsplit(origin).netloc.lower() != self.value("Host").lower()

    @property
    def cookies(self) -> dict[str, str]:
        """The browser's cookies."""
        try:
            return {name: morsel.value for name, morsel in SimpleCookie(self.value("Cookie")).items()}
        except CookieError:
            return {}

    def alone(self) -> bytes:
        """The head for the server: with `Connection: close`, and without the proxy's cookie."""
        left_out = {"cookie"} if self.is_websocket else {"cookie", "connection"}
        kept = [(name, value) for name, value in self.headers if name.lower() not in left_out]
        if not self.is_websocket:
            kept.append(("Connection", "close"))
        lines = [self.line, *(f"{name}: {value}" for name, value in kept)]
        return ("\r\n".join(lines) + "\r\n\r\n").encode("latin-1")


log = logging.getLogger(__name__)

_HEAD_S = 10.0
"""How long a browser may take to send its request."""
_WRONG_S = 1.0
"""Delay of the answer to a wrong token."""
_MOST_CONNECTIONS = 256
_BLOCK_BYTES = 65536
_END_S = 2.0
_FORM = """<!doctype html><html lang="en"><meta charset="utf-8"><title>xormocap</title>
<body style="font:16px system-ui,sans-serif;margin:20vh auto;max-width:22em"><form>
<h1 style="font-size:20px">xormocap</h1><p>{words}</p>
<input name="token" type="password" autofocus aria-label="token" style="font:inherit;width:15em">
<button style="font:inherit">Open</button></form></body></html>"""


class AuthProxy:
    """Listens at an address for browsers, in a thread of its own, until `close`."""

    def __init__(self, address: Address, token: str | None, port_for: Callable[[Head], int]) -> None:
        """token: None lets everybody in. port_for: the server on loopback for a request.

        Raises UserError if the address cannot be used.
        """
        self._token, self._port_for = token, port_for
        self._pass = hashlib.sha256(b"xormocap page " + (token or "").encode()).hexdigest()
        """The cookie's value, from which the token cannot be derived."""
        self._connections = 0
        self._loop = asyncio.new_event_loop()
        listening = asyncio.start_server(self._serve, address.host, address.port, limit=MOST_HEAD_BYTES)
        try:
            self._listener = self._loop.run_until_complete(listening)
        except OSError as error:
            self._loop.close()
            where = f"{address.host}:{address.port}"
            raise UserError(f"{where}: cannot listen there ({error.strerror}): choose another port") from None
        self.port: int = self._listener.sockets[0].getsockname()[1]
        self._cookie = f"xormocap-{self.port}"
        """The cookie's name, with the port: browsers share cookies between ports."""
        self._thread = threading.Thread(target=self._loop.run_forever, name="proxy", daemon=True)
        self._thread.start()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._connections += 1
        try:
            if self._connections <= _MOST_CONNECTIONS:
                await self._admit(reader, writer)
        except (TimeoutError, OSError, MalformedHeadError, asyncio.IncompleteReadError):
            pass  # the client left, was too slow or did not speak HTTP
        except asyncio.LimitOverrunError:
            await _answer(writer, "431 Request Header Fields Too Large", "")
        finally:
            self._connections -= 1
            writer.close()

    async def _admit(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        text = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _HEAD_S)
        head = Head.of(text)
        if self._token is None:
            await self._let_in(head, reader, writer)
            return
        given = parse_qs(urlsplit(head.target).query).get("token", [""])[-1]
        if given and hmac.compare_digest(given.encode(), self._token.encode()):
            cookie = f"Set-Cookie: {self._cookie}={self._pass}; Path=/; HttpOnly; SameSite=Strict\r\n"
            await _answer(writer, "303 See Other", "", f"Location: /\r\n{cookie}")
        elif hmac.compare_digest(head.cookies.get(self._cookie, "").encode(), self._pass.encode()):
            await self._let_in(head, reader, writer)
        else:
            if given:
                log.warning("a browser gave a wrong token")
                await asyncio.sleep(_WRONG_S)
            words = "This token is wrong." if given else "Enter the token; it is in the viewer's log."
            await _answer(writer, "401 Unauthorized", _FORM.format(words=words))

    async def _let_in(self, head: Head, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Connect a browser with the server until one of them closes the connection."""
        if head.is_from_elsewhere:
            await _answer(writer, "403 Forbidden", "")
            return
        from_server, to_server = await asyncio.open_connection(LOOPBACK, self._port_for(head))
        try:
            to_server.write(head.alone())
            ways = [_copy(reader, to_server), _copy(from_server, writer)]
            tasks = [asyncio.ensure_future(way) for way in ways]
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        finally:
            to_server.close()

    def close(self) -> None:
        """Stop listening and close all connections."""

        async def end() -> None:
            self._listener.close()
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)

        with contextlib.suppress(TimeoutError):
            asyncio.run_coroutine_threadsafe(end(), self._loop).result(_END_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(_END_S)
        if not self._thread.is_alive():
            self._loop.close()


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Forward bytes as fast as the receiver reads them."""
    while block := await reader.read(_BLOCK_BYTES):
        writer.write(block)
        await writer.drain()


async def _answer(writer: asyncio.StreamWriter, status: str, page: str, more: str = "") -> None:
    """Answer with a page, and close the connection."""
    body = page.encode()
    head = (
        f"HTTP/1.1 {status}\r\nContent-Type: text/html; charset=utf-8\r\nContent-Length: {len(body)}\r\n"
        f"Cache-Control: no-store\r\nReferrer-Policy: no-referrer\r\nConnection: close\r\n{more}\r\n"
    )
    writer.write(head.encode() + body)
    await writer.drain()
