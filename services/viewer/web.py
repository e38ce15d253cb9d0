"""The page's own files and its browsers' channels, on this machine's loopback only."""

import logging
import threading
from http import HTTPStatus
from importlib import resources
from urllib.parse import parse_qs, urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from services.address import LOOPBACK
from services.viewer.channel import MOST_ACTION_BYTES, Channel

CHANNEL_PATH = "/channel"
_TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript"}
_FILES = resources.files("services.viewer") / "page"
_HEADERS = {
    "Cache-Control": "no-cache",
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; "
    "style-src 'self' 'unsafe-inline'; connect-src 'self' ws: wss:",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class Web:
    """Serves files, and channels by their key, until `close`."""

    def __init__(self) -> None:
        logging.getLogger("websockets").setLevel(logging.CRITICAL)  # a browser that leaves is no error
        self._pages = {file.name: file.read_bytes() for file in _FILES.iterdir() if file.is_file()}
        self._channels: dict[str, Channel] = {}
        self._server = serve(
            self._serve, LOOPBACK, 0, process_request=self._answer, compression=None,
            max_size=MOST_ACTION_BYTES,
        )  # fmt: skip
        self.port: int = self._server.socket.getsockname()[1]
        self._thread = threading.Thread(target=self._server.serve_forever, name="web", daemon=True)
        self._thread.start()

    def add(self, channel: Channel) -> None:
        """Let a browser open a channel."""
        self._channels[channel.key] = channel

    def remove(self, channel: Channel) -> None:
        """Close a channel for good."""
        self._channels.pop(channel.key, None)
        channel.close()

    def _answer(self, _: ServerConnection, request: Request) -> Response | None:
        """Answer a request for a file; None for a channel."""
        parts = urlsplit(request.path)
        if parts.path == CHANNEL_PATH:
            known = self._channel_of(request) is not None
            return None if known else _response(HTTPStatus.FORBIDDEN, b"", "text/plain")
        name = parts.path.removeprefix("/") or "page.html"
        if name not in self._pages:
            return _response(HTTPStatus.NOT_FOUND, b"", "text/plain")
        return _response(HTTPStatus.OK, self._pages[name], _TYPES[name.rpartition(".")[2]])

    def _serve(self, connection: ServerConnection) -> None:
        channel = None if connection.request is None else self._channel_of(connection.request)
        if channel is not None:
            channel.serve(connection)

    def _channel_of(self, request: Request) -> Channel | None:
        return self._channels.get(parse_qs(urlsplit(request.path).query).get("key", [""])[0])

    def close(self) -> None:
        """Stop listening."""
        self._server.shutdown()


def _response(status: HTTPStatus, body: bytes, kind: str) -> Response:
    headers = Headers(_HEADERS | {"Content-Type": f"{kind}; charset=utf-8", "Content-Length": str(len(body))})
    headers["Connection"] = "close"
    return Response(status.value, status.phrase, headers, body)
