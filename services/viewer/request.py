"""The head of an HTTP request, as far as the proxy looks at it."""

from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Self
from urllib.parse import urlsplit

MOST_HEAD_BYTES = 32768


class MalformedHeadError(ValueError):
    """Bytes that are no head of an HTTP/1.1 request."""


@dataclass(frozen=True)
class Head:
    """Request line and headers."""

    line: str
    target: str
    """What is asked for: path and query."""
    headers: tuple[tuple[str, str], ...]
    """Names as they came, and values."""

    @classmethod
    def of(cls, text: bytes) -> Self:
        """Read a head up to and with its empty line; raises MalformedHeadError."""
        lines = text.decode("latin-1").split("\r\n")[:-2]
        words = lines[0].split(" ")
        if len(words) != 3 or words[2] != "HTTP/1.1" or not words[1].startswith("/"):
            raise MalformedHeadError("expected a request of HTTP/1.1")
        pairs = [line.partition(":") for line in lines[1:]]
        if any(not colon or not name or name != name.strip() for name, colon, _ in pairs):
            raise MalformedHeadError("expected headers of a name, a colon and a value")
        return cls(lines[0], words[1], tuple((name, value.strip()) for name, _, value in pairs))

    def value(self, name: str) -> str:
        """A header's value; empty where there is none."""
        return next((value for key, value in self.headers if key.lower() == name.lower()), "")

    @property
    def is_websocket(self) -> bool:
        """Whether the connection is to become a websocket."""
        return self.value("Upgrade").lower() == "websocket"

    @property
    def is_from_elsewhere(self) -> bool:
        """Whether a page of another site wants a websocket."""
        origin = self.value("Origin")
        return self.is_websocket and urlsplit(origin).netloc.lower() != self.value("Host").lower()

    @property
    def cookies(self) -> dict[str, str]:
        """What the browser was given before."""
        try:
            return {name: morsel.value for name, morsel in SimpleCookie(self.value("Cookie")).items()}
        except CookieError:
            return {}

    def alone(self) -> bytes:
        """The head as the only one of its connection, without the cookie, which is none of the server's."""
        left_out = {"cookie"} if self.is_websocket else {"cookie", "connection"}
        kept = [(name, value) for name, value in self.headers if name.lower() not in left_out]
        if not self.is_websocket:
            kept.append(("Connection", "close"))
        lines = [self.line, *(f"{name}: {value}" for name, value in kept)]
        return ("\r\n".join(lines) + "\r\n\r\n").encode("latin-1")
