"""A browser's side of the page's two websockets: it answers as a browser does, and draws nothing."""

import json
import re
import threading
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import version
from typing import Any, TypeAlias

import msgpack
import zstandard  # as websockets, it comes with viser
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

from services.address import LOOPBACK

Messages: TypeAlias = list[dict[str, Any]]
_SILENCE_S = 30.0


def watch(port: int) -> Iterator[Messages]:
    """Open the page's websocket, say where the camera is, and answer all that wants an answer.

    Yields what came at once. Raises OSError where nobody listens or nothing comes any more, and websockets'
    WebSocketException where somebody else listens, or at the end.
    """
    protocols = [Subprotocol(f"viser-v{version('viser')}")]
    where = f"ws://{LOOPBACK}:{port}/scene"
    with connect(where, subprotocols=protocols, max_size=None, compression=None) as connection:
        connection.send(_camera())
        while True:
            messages = _messages(connection.recv(timeout=_SILENCE_S))
            _answer(connection, messages)
            for key in re.findall(r'data-key="([\w-]+)"', str(messages)):
                threading.Thread(target=_follow, args=(port, key), daemon=True).start()
            yield messages


def _follow(port: int, key: str) -> None:
    """Take in all that the channel sends, until it is closed."""
    with (
        suppress(OSError, WebSocketException),
        connect(f"ws://{LOOPBACK}:{port}/channel?key={key}", max_size=None) as channel,
    ):
        for message in channel:
            data = message if isinstance(message, bytes) else message.encode()
            header = json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])
            channel.send(json.dumps({"do": "seen", "number": header["number"]}))


def _answer(connection: Connection, messages: Messages) -> None:
    for message in messages:
        if message["type"] == "LocalStorageGetItemRequestMessage":
            kind, request = "LocalStorageGetItemResponseMessage", message["request_uuid"]
            connection.send(_packed({"type": kind, "value": None, "error": None, "request_uuid": request}))


def _messages(window: str | bytes) -> Messages:
    """What the page's server sent at once: sizes, then compressed msgpack, then arrays, which are left."""
    data = window if isinstance(window, bytes) else window.encode()
    length, packed = (int.from_bytes(data[at : at + 8], "little") for at in (0, 8))
    plain = zstandard.decompress(data[16 : 16 + packed], max_output_size=length)
    messages: Messages = msgpack.unpackb(plain)["messages"]
    return messages


def _camera() -> bytes:
    size = {"image_height": 900, "image_width": 600, "fov": 0.9, "near": 0.01, "far": 100.0}
    pose = {"wxyz": [1.0, 0.0, 0.0, 0.0], "position": [3.0, 0.0, 1.0]}
    view = {"look_at": [0.0, 0.0, 1.0], "up_direction": [0.0, 0.0, 1.0]}
    return _packed({"type": "ViewerCameraMessage", **size, **pose, **view})


def _packed(message: dict[str, object]) -> bytes:
    return bytes(msgpack.packb(message))
