"""What watching costs: frames per second without the viewer, with it, and with a browser that looks at it."""

import contextlib
import multiprocessing
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table
from websockets.exceptions import WebSocketException  # it comes with viser

from bench.fake_browser import watch
from services.address import LOOPBACK
from services.mocap.energy.settings import EngineSettings
from services.mocap.search.settings import SearchSettings
from services.mocap.take.folder import Take, open_take
from services.runs.launcher import free_port
from services.runs.track import TakeJob, track

WAYS = ("no viewer", "viewer, no browser", "viewer, one browser")
_WORKERS = 4
_LOOK_S = 0.1


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
    opened, port = open_take(take), free_port()
    page = None if way == WAYS[0] else f"{LOOPBACK}:{port}"
    with tempfile.TemporaryDirectory() as folder, _browser(port if way == WAYS[2] else None):
        report = track(job_of(opened, Path(folder), page), show=lambda _: None)
    return float(report["speed"]["frames_per_s"])


def job_of(take: Take, folder: Path, page: str | None) -> TakeJob:
    """Tracking a whole take as measurements of the page want it, with results below a folder."""
    return TakeJob(
        take=take,
        out=folder / "result",
        frames=range(take.settings.frames),
        workers=_WORKERS,
        overlay=False,
        engine=EngineSettings(),
        search=SearchSettings(),
        page=page,
    )


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
    """Look at the page once somebody listens, and again whenever that is cut."""
    while True:
        with contextlib.suppress(OSError, WebSocketException):
            for _ in watch(port):
                pass
        time.sleep(_LOOK_S)


def as_table(rows: list[Row]) -> Table:
    """The figures side by side, each with its share of the first."""
    table = Table(box=SIMPLE_HEAD)
    for name in ("way", "frames per second, median", "of the first", "rounds"):
        table.add_column(name, justify="left" if name == "way" else "right")
    for row in rows:
        share = f"{100 * row.median / rows[0].median:.1f} %"
        table.add_row(row.way, f"{row.median:.2f}", share, " ".join(f"{x:.1f}" for x in row.frames_per_s))
    return table
