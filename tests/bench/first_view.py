"""How soon a page that is opened while everything starts shows all that there is, in a real browser."""

import multiprocessing
import socket
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.table import Table

from bench.chromium import open_chromium
from bench.page_cost import job_of
from services.address import LOOPBACK
from services.mocap.body.skeleton import SEGMENT_NAMES
from services.mocap.errors import UserError
from services.mocap.take.folder import open_take
from services.runs.launcher import free_port
from services.runs.track import track

if TYPE_CHECKING:
    from playwright.sync_api import Browser

SIGHTS = ("page", "body", "pictures", "curves")
_PATIENCE_S = 120.0
"""How long a run may take until it offers the page, and that until all is seen."""
_LOOK_S, _CLOSING_S = 0.1, 5.0
_SEGMENTS = len(SEGMENT_NAMES)
_FEWEST_INDICES = 300
"""More than anything in the scene has but the body's segments."""
_WATCH = """
(() => {
  const seen = window.firstSeen = {}, segments = new Set();
  const began = window.top.performance.timeOrigin;  // the 3D scene is in a frame of its own
  const note = (sight) => { seen[sight] ??= (performance.timeOrigin + performance.now() - began) / 1000; };
  const gl = WebGL2RenderingContext.prototype, draw = gl.drawElements, bind = gl.bindVertexArray;
  let shape = null;
  gl.bindVertexArray = function (array) { shape = array; return bind.call(this, array); };
  gl.drawElements = function (mode, count, ...rest) {
    if (count > FEWEST) segments.add(shape);
    if (segments.size >= SEGMENTS) note("body");
    return draw.call(this, mode, count, ...rest);
  };
  setInterval(() => {
    if (document.querySelector("#timeline")) note("page");
    const images = [...document.querySelectorAll("#cameras img")];
    if (images.length && images.every((i) => i.complete && i.naturalWidth > 0)) note("pictures");
    if (document.querySelector(".chart canvas")?.dataset.points > 0) note("curves");
  }, 50);
})();
""".replace("FEWEST", str(_FEWEST_INDICES)).replace("SEGMENTS", str(_SEGMENTS))
"""Notes when each sight is there first; of the body, when all segments have been drawn in the scene."""


@dataclass(frozen=True)
class Row:
    """One opening of the page."""

    offered_s: float
    """When the page was there, from the start of the run."""
    sights_s: dict[str, float]
    """When each of SIGHTS was there, from the opening of the page."""

    @property
    def whole_s(self) -> float:
        """When all were there."""
        return max(self.sights_s.values())


def measure(take: Path, screenshot: Path | None = None) -> Row:
    """Track a take and open its page as soon as that is offered; raises UserError.

    screenshot: a PNG of the page, as it is when all is seen.
    """
    port, spawning = free_port(), multiprocessing.get_context("spawn")
    ours, theirs = spawning.Pipe()
    browser = spawning.Process(target=_look, args=(theirs, port, screenshot), daemon=True)
    browser.start()
    theirs.close()
    try:
        _received(ours)  # it is open
        began_s = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            track(job_of(open_take(take), Path(folder), f"{LOOPBACK}:{port}"), show=lambda _: None)
        offered_s, sights_s = _received(ours)
    finally:
        browser.join(_CLOSING_S)
        browser.terminate()
        browser.join()
        ours.close()
    return Row(offered_s - began_s, sights_s)


def _received(pipe: Connection) -> tuple[float, dict[str, float]]:
    """What the browser's process says next; raises UserError where that is why it cannot go on."""
    try:
        said = pipe.recv() if pipe.poll(_PATIENCE_S) else "the page was not seen in time"
    except EOFError:
        said = "the browser has ended"
    if isinstance(said, str):
        raise UserError(said)
    offered_s, sights_s = said
    return offered_s, sights_s


def _look(pipe: Connection, port: int, screenshot: Path | None) -> None:
    """The browser's process: says when it is open, and then what it saw when."""
    try:
        with open_chromium() as browser:
            pipe.send((0.0, {}))
            pipe.send(_first_seen(browser, port, screenshot))
    except UserError as error:
        pipe.send(str(error))


def _first_seen(browser: "Browser", port: int, screenshot: Path | None) -> tuple[float, dict[str, float]]:
    """When the page was offered, on the clock that processes share, and when each sight was there then."""
    tab = browser.new_page(viewport={"width": 1280, "height": 720})
    tab.add_init_script(_WATCH)
    _wait_for(port)
    offered_s = time.monotonic()
    tab.goto(f"http://{LOOPBACK}:{port}")
    seen: dict[str, float] = {}
    while not set(SIGHTS) <= set(seen):
        if time.monotonic() - offered_s > _PATIENCE_S:
            missing = ", ".join(sight for sight in SIGHTS if sight not in seen)
            raise UserError(f"the page did not show within {_PATIENCE_S:.0f} s: {missing}")
        tab.wait_for_timeout(1e3 * _LOOK_S)
        for frame in tab.frames:
            seen |= frame.evaluate("window.firstSeen")
    if screenshot is not None:
        tab.screenshot(path=screenshot)
    return offered_s, {sight: seen[sight] for sight in SIGHTS}


def _wait_for(port: int) -> None:
    """Wait until somebody listens; raises UserError where nobody does."""
    deadline_s = time.monotonic() + _PATIENCE_S
    while time.monotonic() < deadline_s:
        with suppress(OSError), socket.create_connection((LOOPBACK, port), timeout=1.0):
            return
        time.sleep(_LOOK_S)
    raise UserError(f"the run offered no page within {_PATIENCE_S:.0f} s")


def as_table(row: Row) -> Table:
    """When what was seen."""
    table = Table(box=SIMPLE_HEAD, title="first view")
    table.add_column("seconds from")
    for name in ("page offered", *SIGHTS, "all"):
        table.add_column(name, justify="right")
    table.add_row("the start of the run", f"{row.offered_s:.1f}")
    figures = [f"{row.sights_s[sight]:.1f}" for sight in SIGHTS]
    table.add_row("the opening of the page", "", *figures, f"{row.whole_s:.1f}")
    return table
