"""What watching costs: frames per second without the viewer, with it, and with a browser that looks at it."""

import contextlib
import multiprocessing
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import msgpack
import numpy as np
import websockets.exceptions
import zstandard  # as websockets, it comes with viser
from rich.box import SIMPLE_HEAD
from rich.table import Table
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

from services.mocap.energy.settings import EngineSettings
from services.mocap.search.settings import SearchSettings
from services.mocap.take.folder import open_take
from services.runs.launcher import free_endpoint
from services.runs.track import Job, track

WAYS = ("no viewer", "viewer, no browser", "viewer, one browser")
_WORKERS = 4


@dataclass(frozen=True)
class Row:
    """One way of running, over some rounds."""

    way: str
    frames_per_s: list[float]
    """One figure a round."""

    @property
    def median(self) -> float:
        """Of the rounds."""
        return float(np.median(self.frames_per_s))


def measure(take: Path, rounds: int, tell: Callable[[str], None]) -> list[Row]:
    """Track a take in every way in turn, so many times over, and tell of each run; raises UserError."""
    found: dict[str, list[float]] = {way: [] for way in WAYS}
    for _ in range(rounds):
        for way in WAYS:
            found[way].append(_frames_per_s(take, way))
            tell(f"{way}: {found[way][-1]:.1f} frames per second")
    return [Row(way, figures) for way, figures in found.items()]


def _frames_per_s(take: Path, way: str) -> float:
    opened, port = open_take(take), int(free_endpoint().rpartition(":")[2])
    page = None if way == WAYS[0] else f"127.0.0.1:{port}"
    with tempfile.TemporaryDirectory() as folder, _browser(port if way == WAYS[2] else None):
        job = Job(
            opened,
            Path(folder) / "result",
            range(opened.settings.frames),
            _WORKERS,
            overlay=False,
            engine=EngineSettings(),
            search=SearchSettings(),
            page=page,
        )
        report = track(job, show=lambda _: None)
    return float(report["speed"]["frames_per_s"])


@contextlib.contextmanager
def _browser(port: int | None) -> Iterator[None]:
    """A process that does what a browser does but draw, as one on another machine would not here."""
    if port is None:
        yield
        return
    process = multiprocessing.get_context("spawn").Process(target=look, args=(port,), daemon=True)
    process.start()
    try:
        yield
    finally:
        process.terminate()
        process.join()


def look(port: int) -> None:
    """Open the page's websocket, say where the camera is, and answer all that wants an answer."""
    protocols = [Subprotocol(f"viser-v{version('viser')}")]
    for connection in _attempts(port, protocols):
        connection.send(_camera())
        with contextlib.suppress(websockets.exceptions.ConnectionClosed):
            while True:
                for message in _messages(connection.recv()):
                    if message["type"] == "LocalStorageGetItemRequestMessage":
                        connection.send(_answer(message["request_uuid"]))


def _attempts(port: int, protocols: list[Subprotocol]) -> Iterator[Connection]:
    """A connection, once somebody listens, and another whenever that is cut."""
    while True:
        try:
            with connect(
                f"ws://127.0.0.1:{port}", subprotocols=protocols, max_size=None, compression=None
            ) as connection:
                yield connection
        except OSError:
            continue


def _messages(window: str | bytes) -> list[dict[str, object]]:
    """What the page's server sent at once: sizes, then compressed msgpack, then arrays, which are left."""
    data = window if isinstance(window, bytes) else window.encode()
    length, packed = (int.from_bytes(data[at : at + 8], "little") for at in (0, 8))
    plain = zstandard.decompress(data[16 : 16 + packed], max_output_size=length)
    messages: list[dict[str, object]] = msgpack.unpackb(plain)["messages"]
    return messages


def _camera() -> bytes:
    size = {"image_height": 900, "image_width": 600, "fov": 0.9, "near": 0.01, "far": 100.0}
    pose = {
        "wxyz": [1.0, 0, 0, 0],
        "position": [3.0, 0, 1],
        "look_at": [0.0, 0, 1],
        "up_direction": [0.0, 0, 1],
    }
    return _packed({"type": "ViewerCameraMessage", **size, **pose, "up_direction": [0.0, 0, 1]})


def _answer(request: object) -> bytes:
    kind = "LocalStorageGetItemResponseMessage"
    return _packed({"type": kind, "value": None, "error": None, "request_uuid": request})


def _packed(message: dict[str, object]) -> bytes:
    return bytes(msgpack.packb(message))


def as_table(rows: list[Row]) -> Table:
    """The figures side by side, each with its share of the first."""
    table = Table(box=SIMPLE_HEAD)
    for name in ("way", "frames per second, median", "of the first", "rounds"):
        table.add_column(name, justify="left" if name == "way" else "right")
    for row in rows:
        share = f"{100 * row.median / rows[0].median:.1f} %"
        table.add_row(row.way, f"{row.median:.2f}", share, " ".join(f"{x:.1f}" for x in row.frames_per_s))
    return table
