"""How late a browser behind a slow line is: age of the body and of the pictures when they come."""

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table
from websockets.exceptions import WebSocketException

from bench.fake_browser import Messages, watch
from bench.line import Line, SlowProxy
from bench.looped import looped
from bench.playback import Playback
from services.mocap.errors import UserError
from services.mocap.take.folder import open_take
from services.runs.launcher import free_endpoint, free_port, last_line
from services.viewer.address import LOOPBACK

FRAMES_PER_S = 25.0
"""How fast the coordinator that is played back is; as fast as tracking is on two cores."""
_START_S = 30.0
_SETTLED_S = 2.0
"""What a viewer is given before a browser comes."""
_LEAST = 2
"""Frames of a kind, for an age to be told."""
_BODY = re.compile(r">(\d+) of \d+,")
_PICTURES = re.compile(r'id="cameras".*?data-frame="(\d+)"')


@dataclass(frozen=True)
class Row:
    """One kind of view of one browser, over the second half of the time."""

    view: str
    lags_s: list[float] = field(repr=False)
    """How old each frame was when it came."""
    ages_s: list[float] = field(repr=False)
    """How old each was by the time that the next one came."""
    seconds: float

    @property
    def per_s(self) -> float:
        """How many came in a second."""
        return len(self.lags_s) / self.seconds


def measure(take: Path, line: Line, seconds: float) -> list[Row]:
    """Look at a take for so long, from behind a line; raises UserError."""
    with tempfile.TemporaryDirectory() as folder:
        n_frames = round((seconds + _START_S + _SETTLED_S) * FRAMES_PER_S)
        take_to_play = looped(open_take(take), n_frames, Path(folder) / "take")
        frames = take_to_play.settings.frames
        playing = Playback(take_to_play, free_endpoint(), frames=frames, period_s=1 / FRAMES_PER_S)
        viewer = _viewer(playing, take_to_play.folder, Path(folder))
        with playing, viewer as port, SlowProxy(port, line) as slow:
            came = _look(playing, slow.port, seconds)
    return [_row(view, came[view], seconds) for view in came]


@contextmanager
def _viewer(playing: Playback, take: Path, folder: Path) -> Iterator[int]:
    """The viewer's process; yields its port."""
    port = free_port()
    command = [sys.executable, "-m", "services.viewer", "--connect", playing.endpoint]
    where = ["--take", str(take), "--bind", f"{LOOPBACK}:{port}"]
    log = folder / "viewer.log"
    with log.open("w") as file:
        process = subprocess.Popen([*command, *where], stdout=file, stderr=file)
    try:
        deadline_s = time.monotonic() + _START_S
        while "look at http" not in log.read_text():
            if process.poll() is not None or time.monotonic() > deadline_s:
                raise UserError(f"the viewer does not start: {last_line(log)}")
            time.sleep(0.1)
        time.sleep(_SETTLED_S)
        yield port
    finally:
        process.terminate()
        process.wait()


def _look(playing: Playback, port: int, seconds: float) -> dict[str, list[tuple[float, float]]]:
    """When each body and each sheet of pictures came, and when its frame had been sent."""
    came: dict[str, list[tuple[float, float]]] = {"body": [], "pictures": []}
    end_s, shown = time.monotonic() + seconds, dict.fromkeys(came, -1)
    try:
        for messages in watch(port):
            now = time.monotonic()
            for view, frame in frames_shown(messages):
                if frame != shown[view]:
                    shown[view] = frame
                    came[view].append((now, playing.sent_s[frame]))
            if now > end_s:
                break
    except (OSError, WebSocketException) as error:
        raise UserError(f"the page was cut off before its time: {error}") from None
    return came


def frames_shown(messages: Messages) -> Iterator[tuple[str, int]]:
    """The frames that messages show."""
    for message in messages:
        updates = message.get("updates")
        content = str((updates if isinstance(updates, dict) else message).get("content", ""))
        for view, pattern in (("body", _BODY), ("pictures", _PICTURES)):
            found = pattern.search(content)
            if found is not None:
                yield view, int(found[1])


def _row(view: str, came: list[tuple[float, float]], seconds: float) -> Row:
    late = [(at, sent) for at, sent in came if at > came[-1][0] - 0.5 * seconds]
    if len(late) < _LEAST:
        raise UserError(f"too little {view} came in {seconds:.0f} s: a faster line or more time is needed")
    ages = [after - sent for (_, sent), (after, _) in pairwise(late)]
    return Row(view, [at - sent for at, sent in late], ages, 0.5 * seconds)


def as_table(rows: list[Row], line: Line) -> Table:
    """How late each view is."""
    where = f"{line.bytes_per_s / 1e3:.0f} KB/s, {1e3 * line.latency_s:.0f} ms"
    table = Table(box=SIMPLE_HEAD, title=f"slow browser, {where}")
    names = (
        "view",
        "lag when it comes, median",
        "95 %",
        "when the next one comes, median",
        "95 %",
        "per second",
    )
    for name in names:
        table.add_column(name, justify="left" if name == "view" else "right")
    for row in rows:
        figures = [f"{np.percentile(x, p):.2f} s" for x in (row.lags_s, row.ages_s) for p in (50, 95)]
        table.add_row(row.view, *figures, f"{row.per_s:.1f}")
    return table
