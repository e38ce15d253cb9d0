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
from playwright.sync_api import Browser, FloatRect, Page, Request, ViewportSize

from playback import Playback
from services.mocap.result.words import ENERGY_IN_WORDS, IOU_IN_WORDS
from services.mocap.take.folder import Take
from services.mocap.types import Bytes
from services.runs import launcher

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
    """What the 3D scene shows in its middle."""
    box = page.locator("#scene").bounding_box()
    assert box is not None
    x, y, width, height = box["x"], box["y"], box["width"], box["height"]
    middle: FloatRect = {"x": x + width / 4, "y": y + height / 5, "width": width / 2, "height": 0.6 * height}
    png = page.screenshot(clip=middle)
    return np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), np.uint8)


def _frame(page: Page) -> int:
    """The shown frame, as the timeline says it."""
    return int(page.locator("#timeline").get_attribute("aria-valuenow") or -1)


def _moved(page: Page, before: Bytes) -> int:
    """How many pixels of the 3D scene have changed."""
    return int((np.abs(_body(page).astype(int) - before) > 30).any(axis=2).sum())


def _until(condition: Callable[[], bool], what: str, timeout_s: float = 40) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, what
        time.sleep(0.2)


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
    _until(lambda: _moved(page, body) > 60, "the body stands still")
    assert page.get_by_text("frames per second").count() > 0
    assert page.locator("#live").is_checked()
    page.screenshot(path=screenshots / "live.png")
    other = chromium.new_page(viewport=_SIZE)
    _open(other, free_port)
    other.bring_to_front()
    other.keyboard.press("Home")
    _until(lambda: _frames(other) == [0] * 8, "another browser cannot go back")
    _until(lambda: min(_frames(page)) > began[0] + 10, "the first browser went along with the other")
    other.close()
    first.kill()
    first.wait(10)
    before = max(_frames(page))
    start_viewer(*arguments)
    _until(lambda: len(seen := _frames(page)) == 8 and min(seen) > before, "the page does not come back", 90)


@pytest.fixture(scope="module")
def doubtful(
    write_true_result: Callable[[Path], Path],
    start_lasting_viewer: Start,
    tmp_path_factory: pytest.TempPathFactory,
) -> int:
    """The port of a viewer of results in which the left arm is doubtful in frames 5 to 7, the head in 15;
    nobody judged frame 12, and cam03 is the worst."""
    result = write_true_result(tmp_path_factory.mktemp("doubtful"))
    table = result / "poses.csv"
    rows = [line.split(",") for line in table.read_text().splitlines()]
    marks = {5: "left_arm", 6: "left_arm", 7: "left_arm", 15: "head"}
    parts = ("torso", "head", "left_arm", "right_arm", "left_leg", "right_leg")
    rows[0] += ["distrusted", *(f"confidence_{part}" for part in parts)]
    for n, row in enumerate(rows[1:]):
        judged = ["0.1" if marks.get(n) == part else "0.99" for part in parts]
        row += [marks.get(n, ""), *([""] * 6 if n == 12 else judged)]
    table.write_text("\n".join(",".join(row) for row in rows) + "\n")
    ious = [f"iou_cam{c:02}" for c in range(1, 9)]
    energies = ["frame," + ",".join([*(f"energy_{part}_px" for part in parts), *ious])]
    for n in range(24):
        values = [0.6 if name == "iou_cam03" else 0.93 for name in ious]
        energies.append(",".join(map(str, [n, *[100] * 6, *values])))
    (result / "energies.csv").write_text("\n".join(energies) + "\n")
    port = launcher.free_port()
    start_lasting_viewer(result, "--port", port, module=("services.cli", "view"))
    return port


def test_results(doubtful: int, page: Page, screenshots: Path) -> None:
    """Keys and clicks move all views together; doubts are named; tiles are judged, counted and enlarged."""
    _open(page, doubtful)
    assert page.title() == "walk · xormocap"
    assert page.locator("#doubts").inner_text().startswith("Doubtful: head in 1 (frame 15); left arm in 3")
    assert page.locator("#headline").inner_text().startswith("usable with gaps: 4 of 24 frames have doubtful")
    assert page.locator("#verdict").get_attribute("class") == "usable"
    cause = "cam03 agrees less with the body than the others (IoU 0.60, others 0.93)"
    assert page.locator("#first-cause").inner_text().startswith(cause)
    page.get_by_role("button", name="pause", exact=True).click()
    body: dict[int, Bytes] = {}
    for key, frame in (("Home", 0), ("ArrowRight", 1), ("End", 23), ("ArrowLeft", 22)):
        page.keyboard.press(key)
        words = page.get_by_text(re.compile(rf"^frame {frame} of 23,"))
        _until(lambda: _frames(page) == [frame] * 8, f"the pictures do not show frame {frame}")  # noqa: B023
        _until(lambda: words.count() == 1, f"the words do not say {frame}")  # noqa: B023
        if key in ("Home", "End"):
            time.sleep(1.0)  # the 3D scene is drawn when the browser likes
            body[frame] = _body(page)
        page.screenshot(path=screenshots / f"frame-{frame}.png")
    assert (np.abs(body[0].astype(int) - body[23]) > 30).any(axis=2).sum() > 100
    page.keyboard.press("Home")
    good = page.locator("#frame-verdict").get_by_text("good", exact=True)
    _until(lambda: good.count() == 1, "frame 0 is not judged")
    assert page.locator("#frame-verdict.good").count() == 0, "the results are not good, so nothing is green"
    for key, frame in (("n", 5), ("n", 6), ("Shift+N", 15), ("p", 7), ("Shift+P", 5)):
        page.keyboard.press(key)
        _until(lambda: _frame(page) == frame, f"{key} does not lead to frame {frame}")  # noqa: B023
        _until(lambda: _is_named_doubtful(page, frame), f"frame {frame} is not named")  # noqa: B023
    timeline = page.locator("#timeline")
    assert timeline.get_attribute("data-doubtful") == "head, left arm"
    assert timeline.get_attribute("data-unjudged") == "torso, head, left arm, right arm, left leg, right leg"
    assert page.locator(".chart canvas").first.get_attribute("data-shaded") == "4"
    assert page.locator("#energy").get_attribute("title") == ENERGY_IN_WORDS
    ious = page.locator(".tile .iou")
    assert {ious.nth(n).get_attribute("title") for n in range(8)} == {IOU_IN_WORDS}
    _check_help(page, screenshots)
    worst = page.locator(".tile.worst")
    assert worst.count() == 1 and worst.locator(".iou").text_content() == "worst IoU 0.60"
    assert worst.locator(".iou").inner_text() == "IoU 0.60", "a narrow tile leaves out what its frame says"
    _check_tiles(page, screenshots)


def _is_named_doubtful(page: Page, frame: int) -> bool:
    return page.locator("#frame-verdict").inner_text() == f"doubtful: {'head' if frame == 15 else 'left arm'}"


def _check_help(page: Page, screenshots: Path) -> None:
    """The dialog of keys also explains the numbers."""
    page.keyboard.press("?")
    assert page.locator("dialog[open]").count() == 1
    for name, words in (("energy", ENERGY_IN_WORDS), ("IoU", IOU_IN_WORDS)):
        row = page.locator("#keys tr", has=page.get_by_text(name, exact=True))
        assert row.locator("td").last.inner_text() == words
    page.screenshot(path=screenshots / "help.png")
    page.get_by_role("button", name="Close").click()


def _check_tiles(page: Page, screenshots: Path) -> None:
    """Enlarging by double click, counting differences, cutting out windows."""
    page.locator(".tile").nth(4).dblclick()
    _until(lambda: page.locator(".tile img").count() == 1, "the tile is not enlarged")
    assert page.locator(".tile img").get_attribute("alt") == "cam05"
    large = "images => images[0].naturalWidth >= 500 && images[0].clientWidth >= 400"
    _until(lambda: bool(page.eval_on_selector_all("#cameras img", large)), "the enlarged tile is small")
    page.screenshot(path=screenshots / "enlarged.png")
    page.locator(".tile").dblclick()
    _until(lambda: len(_frames(page)) == 8, "the enlarged tile does not go back")
    page.locator("#content").select_option("difference")
    _until(lambda: page.get_by_text(re.compile(r"cam01 · \d+ px")).count() == 1, "no differences are counted")
    assert page.get_by_text("model without actor").is_visible()
    page.locator("#part").select_option("left_arm")
    square = "images => images.every(i => i.naturalWidth == i.naturalHeight)"
    _until(lambda: bool(page.eval_on_selector_all("#cameras img", square)), "no windows are shown")
    page.screenshot(path=screenshots / "windows.png")


@pytest.mark.parametrize(("width", "height"), [(1600, 900), (1024, 700)])
def test_the_3d_view_has_room_and_clicks_on_time_axes_choose_frames(
    doubtful: int, page: Page, width: int, height: int
) -> None:
    page.set_viewport_size({"width": width, "height": height})
    _open(page, doubtful)
    room, last = page.locator("#room").bounding_box(), page.locator(".chart").first.bounding_box()
    assert room is not None and room["width"] > 0.5 * width and room["height"] > 0.45 * height
    assert last is not None and last["width"] == width and last["y"] + last["height"] <= height
    page.keyboard.press("Space")
    for axis in ("#timeline", ".chart canvas >> nth=0"):
        for frame in (15, 3):
            _click_at(page, axis, frame)
            _until(lambda: _frame(page) == frame, f"a click on {axis} does not lead to {frame}")  # noqa: B023
    time.sleep(1.0)
    all_in_view = _body(page)
    page.get_by_role("button", name="frame actor").click()
    _until(lambda: _moved(page, all_in_view) > 2000, "the actor does not fill the view")
    page.get_by_label("follow actor").check()
    time.sleep(2.0)
    page.keyboard.press("End")
    _until(lambda: _frames(page) == [23] * 8, "no last frame")
    time.sleep(2.0)
    assert _red_or_blue_share(page) > 0.5, "the actor has left the middle of the view"


def _click_at(page: Page, selector: str, frame: int) -> None:
    box = page.locator(selector).bounding_box()
    assert box is not None
    at = 84 + (frame + 0.5) / 24 * (box["width"] - 94)
    page.mouse.click(box["x"] + at, box["y"] + box["height"] - 8)


def _red_or_blue_share(page: Page) -> float:
    """The share of the body's coloured pixels in the view's middle half among those of the whole view."""
    box = page.locator("#scene").bounding_box()
    assert box is not None
    png = page.screenshot(clip={name: box[name] for name in ("x", "y", "width", "height")})  # type: ignore[misc]
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR).astype(int)
    coloured = np.ptp(picture, axis=2) > 60
    quarter = coloured.shape[1] // 4
    return float(coloured[:, quarter:-quarter].sum() / max(coloured.sum(), 1))


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
