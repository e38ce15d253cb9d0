"""One browser's connection for everything but the 3D scene: messages to it, its user's actions from it."""

import contextlib
import json
import logging
import queue
import secrets
import threading
from collections.abc import Sequence
from typing import Any

from pydantic import ValidationError
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection

from services.viewer.actions import ACTIONS, Action, Seen

MOST_ACTION_BYTES = 4096
_LENGTH_BYTES = 4
_MOST_WAITING = 256
"""Most actions that wait for the page's thread; a browser that sends more is cut off."""

log = logging.getLogger(__name__)


class Channel:
    """A browser opens it with the key that it finds in the 3D scene's page, and again after an interruption.

    A message is the length of a header (4 bytes, little-endian), the header as JSON, and its blobs.
    """

    def __init__(self) -> None:
        self.key = secrets.token_urlsafe(16)
        self.actions: queue.Queue[Action] = queue.Queue(_MOST_WAITING)
        self.opened = 0
        """How often it was opened; whoever opens it has seen nothing."""
        self._connection: ServerConnection | None = None
        self._sent = self._seen = 0
        self._changed = threading.Condition()

    def serve(self, connection: ServerConnection) -> None:
        """Take in what a browser sends, until it leaves."""
        with self._changed:
            before, self._connection = self._connection, connection
            self._seen = self._sent
            self.opened += 1
            self._changed.notify_all()
        if before is not None:
            before.close()
        try:
            for message in connection:
                self._hear(message)
        except (ConnectionClosed, ValidationError, queue.Full) as problem:
            log.info("a browser's connection ends: %s", type(problem).__name__)
        finally:
            with self._changed:
                if self._connection is connection:
                    self._connection = None
                    self._changed.notify_all()
            connection.close()

    def _hear(self, message: str | bytes) -> None:
        action = ACTIONS.validate_json(message)
        if not isinstance(action, Seen):
            self.actions.put_nowait(action)
            return
        with self._changed:
            self._seen = max(self._seen, min(action.number, self._sent))
            self._changed.notify_all()

    def send(self, kind: str, blobs: Sequence[bytes] = (), **fields: Any) -> None:
        """Send a message; nothing happens while no browser is connected."""
        with self._changed:
            connection = self._connection
            self._sent += 1
            number = self._sent
        header = {"kind": kind, "number": number, "blobs": [len(blob) for blob in blobs], **fields}
        text = json.dumps(header, allow_nan=False).encode()
        if connection is not None:
            with contextlib.suppress(ConnectionClosed):  # it has left; its page ends, or it comes back
                connection.send(b"".join([len(text).to_bytes(_LENGTH_BYTES, "little"), text, *blobs]))

    def await_open(self, timeout_s: float) -> bool:
        """Wait until a browser has opened it; False if none has."""
        with self._changed:
            return self._changed.wait_for(lambda: self._connection is not None, timeout_s)

    def await_seen(self, timeout_s: float) -> bool:
        """Wait until the browser has taken in all messages, or has left; False if it has not."""
        with self._changed:
            return self._changed.wait_for(
                lambda: self._connection is None or self._seen >= self._sent, timeout_s
            )

    def close(self) -> None:
        """Cut the browser off."""
        with self._changed:
            connection = self._connection
        if connection is not None:
            connection.close()
