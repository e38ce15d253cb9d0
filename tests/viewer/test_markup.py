"""The page's HTML."""

import xml.etree.ElementTree as ET

import numpy as np

from services.mocap.verdict.verdict import Cause, Doubt, Verdict
from services.viewer.frame_history import Overview
from services.viewer.markup import camera_grid, lines_of, timeline, verdict_strip
from services.viewer.tiles import Tile


def test_the_grid_has_a_picture_for_every_camera_and_no_foreign_markup() -> None:
    tiles = [Tile(0, b"\xff\xd8a", 12), Tile(1, b"\xff\xd8b", None, is_known=False)]
    html = camera_grid(tiles, ["<b>left", "right"], 7)
    tree = ET.fromstring(_closed(html))  # noqa: S314  (our own)
    images = tree.findall(".//img")
    assert [image.get("data-frame") for image in images] == ["7", "7"]
    assert [image.get("alt") for image in images] == ["<b>left", "right"]
    assert [span.text for span in tree.findall(".//span")] == [
        "<b>left · 12 px",
        "right · no picture of this frame",
    ]


def _closed(html: str) -> str:
    """HTML's void elements, closed as XML wants them."""
    return html.replace('"><span', '"/><span')


def test_the_timeline_shows_what_is_known_marks_and_the_present() -> None:
    known = np.array([True] * 6 + [False] * 4)
    distrusted = np.array([False, False, True, True, False, False, False, False, False, False])
    tree = ET.fromstring(timeline(Overview(known, np.arange(10.0), distrusted), at=0.25))  # noqa: S314
    rects = [(rect.get("x"), rect.get("width")) for rect in tree.findall("rect")]
    assert rects == [("0", "6"), ("2", "2")]
    line = tree.find("line")
    assert line is not None and line.get("x1") == "2.50"
    curve = tree.find("polyline")
    assert curve is not None and len(str(curve.get("points")).split()) == 6


def test_tables_show_words_as_they_are() -> None:
    assert "a &lt;b&gt;" in lines_of([("take", "a <b>")])


def test_the_verdict_has_its_words_and_is_hatched_where_it_is_not_good() -> None:
    cause = Cause(what="cam01 <late>", remedy="run xormocap sync", level="usable with gaps")
    doubt = Doubt(part="left_arm", frames=2, spans=((3, 4),))
    known = {"frames": 9, "lost_frames": 0, "iou": {}}
    gaps = Verdict(level="usable with gaps", doubtful_frames=2, doubts=(doubt,), causes=(cause,), **known)
    strip = verdict_strip(gaps)
    for words in ("2 of 9 frames", "left arm in 2 (frames 3 to 4)", "cam01 &lt;late&gt;: run xormocap sync"):
        assert words in strip
    assert "repeating-linear-gradient" in strip
    good = Verdict(level="good", doubtful_frames=0, doubts=(), causes=(), **known)
    assert "repeating-linear-gradient" not in verdict_strip(good)
