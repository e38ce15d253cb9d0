"""The page in a real browser."""

import re
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, Request, ViewportSize

from playback import Playback
from services.mocap.take.folder import Take
from services.mocap.types import Bytes

pytestmark = pytest.mark.timeout(280)

_SEEN_S = 60
"""Seconds that a browser without a GPU may take on a busy machine."""
_SIZE: ViewportSize = {"width": 1280, "height": 720}
Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def page(chromium: Browser) -> Iterator[Page]:
    """A tab of its own; whatever it asks for beyond this machine fails the test."""
    context = chromium.new_context(viewport=_SIZE)
    elsewhere: list[str] = []

    def note(request: Request) -> None:
        parts = urlsplit(request.url)
        if parts.scheme not in ("data", "blob") and parts.hostname != "127.0.0.1":
            elsewhere.append(request.url)

    context.on("request", note)
    tab = context.new_page()
    yield tab
    assert elsewhere == []
    context.close()


def _open(page: Page, port: int) -> None:
    page.goto(f"http://127.0.0.1:{port}")
    page.bring_to_front()
    _until(lambda: len(_frames(page)) == 8, "there are no pictures", _SEEN_S)


def _frames(page: Page) -> list[int]:
    """The frame that each picture of the grid shows."""
    found = page.eval_on_selector_all("#cameras img", "images => images.map(i => i.dataset.frame)")
    return [int(frame) for frame in found]


def _body(page: Page) -> Bytes:
    """What the 3D scene shows."""
    png = page.screenshot(clip={"x": 550, "y": 200, "width": 320, "height": 500})  # between the panels
    return np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), np.uint8)


def _cursor(page: Page) -> float:
    """Where the timeline's cursor stands, 0 to 1."""
    bins = float(str(page.locator("#timeline").get_attribute("viewBox")).split()[2])
    return float(str(page.locator("#timeline line").get_attribute("x1"))) / bins


def _until(condition: Callable[[], bool], what: str, timeout_s: float = 40) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, what
        time.sleep(0.2)


def _choose(page: Page, now: str, then: str) -> None:
    """Choose an option of a dropdown by the one that it shows."""
    page.locator(f"input[value='{now}']").first.click()
    page.get_by_role("option", name=then, exact=True).click()


def test_live(
    walk: Take,
    playback: Playback,
    start_viewer: Start,
    free_port: int,
    page: Page,
    chromium: Browser,
    screenshots: Path,
) -> None:
    """Eight pictures and a body that move, another browser that stands, a viewer that comes back."""
    arguments = ("--connect", playback.endpoint, "--take", walk.folder, "--bind", f"127.0.0.1:{free_port}")
    first = start_viewer(*arguments)
    _open(page, free_port)
    began, body = _frames(page), _body(page)
    assert len(began) == 8
    assert len(set(began)) == 1
    _until(lambda: min(_frames(page)) > began[0], "the pictures stand still")
    are_drawn = "images => images.length == 8 && images.every(i => i.naturalWidth >= 120)"
    _until(lambda: bool(page.eval_on_selector_all("#cameras img", are_drawn)), "some picture is not drawn")
    _until(lambda: (np.abs(_body(page).astype(int) - body) > 30).sum() > 200, "the body stands still")
    assert page.get_by_text("frames per second").count() > 0
    page.screenshot(path=screenshots / "live.png")
    other = chromium.new_page(viewport=_SIZE)
    _open(other, free_port)
    other.bring_to_front()
    other.get_by_role("slider").first.press("Home")
    _until(lambda: _frames(other) == [0] * 8, "another browser cannot go back")
    _until(lambda: min(_frames(page)) > began[0] + 10, "the first browser went along with the other")
    other.close()
    first.kill()
    first.wait(10)
    before = max(_frames(page))
    start_viewer(*arguments)
    _until(lambda: len(seen := _frames(page)) == 8 and min(seen) > before, "the page does not come back", 90)


def test_results(result: Path, start_viewer: Start, free_port: int, page: Page, screenshots: Path) -> None:
    """Scrubbing moves all views together; differences are counted; windows are cut out."""
    start_viewer(result, "--port", free_port, module=("services.cli", "view"))
    _open(page, free_port)
    page.get_by_role("button", name="pause", exact=True).click()
    slider = page.get_by_role("slider").first
    seen: list[tuple[Bytes, float]] = []
    for key, frame in (("Home", 0), ("End", 23)):
        slider.press(key)
        words = page.get_by_text(re.compile(rf"^{frame} of 23,"))
        _until(lambda: _frames(page) == [frame] * 8, f"the pictures do not show frame {frame}")  # noqa: B023
        _until(lambda: words.count() == 1, f"the words do not say {frame}")  # noqa: B023
        time.sleep(1.0)  # the 3D scene is drawn when the browser likes
        seen.append((_body(page), _cursor(page)))
        page.screenshot(path=screenshots / f"scrubbed-{frame}.png")
    (before, at_begin), (after, at_end) = seen
    assert (at_begin, at_end) == (pytest.approx(0.5 / 24, abs=0.01), pytest.approx(23.5 / 24, abs=0.01))
    assert (np.abs(before.astype(int) - after) > 30).sum() > 500
    _choose(page, "pictures", "difference")
    _until(lambda: page.get_by_text(re.compile(r"cam01 · \d+ px")).count() == 1, "no differences are counted")
    page.screenshot(path=screenshots / "difference.png")
    _choose(page, "whole pictures", "left arm's window")
    square = "images => images.every(i => i.naturalWidth == i.naturalHeight)"
    _until(lambda: bool(page.eval_on_selector_all("#cameras img", square)), "no windows are shown")
    page.screenshot(path=screenshots / "windows.png")


def test_beyond_this_machine_the_token_opens(
    walk: Take, playback: Playback, start_viewer: Start, free_port: int, page: Page, tmp_path: Path
) -> None:
    token = tmp_path / "token"
    token.write_text("open-sesame-1")
    where = ("--bind", f"0.0.0.0:{free_port}", "--token-file", token)
    start_viewer("--connect", playback.endpoint, "--take", walk.folder, *where)
    answer = page.goto(f"http://127.0.0.1:{free_port}")
    assert answer is not None and answer.status == 401
    assert page.get_by_label("token").count() == 1
    page.goto(f"http://127.0.0.1:{free_port}/?token=open-sesame-1")
    _until(lambda: len(_frames(page)) == 8, "the token does not open", _SEEN_S)
    assert "token" not in page.url
