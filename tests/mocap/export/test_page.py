"""report.html: whole by itself, and it says what the result's files say."""

import base64
import html
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from services.mocap.errors import TakeError
from services.mocap.export.page.charts import trust
from services.mocap.export.page.html_report import key_frames, write_report
from services.mocap.result.frame_files import read_frame_file, write_frame_file, write_frame_files
from services.mocap.result.result import load_result
from services.mocap.result.words import ENERGY_IN_WORDS, IOU_IN_WORDS
from services.mocap.take.fit_record import FitRecord, write_record
from services.mocap.take.marks import PARTS
from services.mocap.take.writer import video_writer

VOID = {"meta", "br", "img", "hr", "link", "input"}


class Reader(HTMLParser):
    """Holds that tags close in order, and collects what a page would load."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.loads: list[str] = []
        self.seen: list[str] = []
        self.feed(page)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append(tag)
        self.loads += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture
def folder(bare_result: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(bare_result, tmp_path / "<b>mine"))


def page_of(folder: Path) -> str:
    write_report(folder / "report.html", load_result(folder))
    return (folder / "report.html").read_text(encoding="utf-8")


def write_overlay(folder: Path, n_frames: int) -> None:
    with video_writer(folder / "overlay.mp4", 64, 48, 10.0, crf=20) as video:
        for frame in range(n_frames):
            video.write(np.full((48, 64, 3), 10 * frame, np.uint8))


def test_with_poses_and_actor_alone(folder: Path) -> None:
    page = page_of(folder)
    read = Reader(page)
    assert read.seen.count("svg") == 3  # energy, trust, angles
    assert "img" not in read.seen
    assert "<b>" not in page
    assert "&lt;b&gt;mine" in page
    assert "usable with gaps: 1 of 16 frames has doubtful parts" in page
    assert "Doubtful: left arm in 1 (frame 103)." in page
    assert "16, from 100 to 115" in page
    for words in (ENERGY_IN_WORDS, IOU_IN_WORDS):
        before, _, after = html.unescape(page).partition(words)
        assert "<dl>" in after and "<dl>" not in before, "explained before the first number"
        assert words not in after


def test_it_needs_nothing_but_itself(folder: Path) -> None:
    write_overlay(folder, 16)
    page = page_of(folder)
    read = Reader(page)
    outside = [target for target in read.loads if not target.startswith(("data:image/", "#"))]
    assert outside == []
    assert "script" not in read.seen
    assert not re.search(r"url\((?!#)|@import", page)
    assert "default-src 'none'" in page


def test_curves_are_well_formed(folder: Path) -> None:
    charts = re.findall(r"<svg.*?</svg>", page_of(folder), re.DOTALL)
    for chart in charts:
        ElementTree.fromstring(chart)  # noqa: S314  (our own)
    assert "energy (pixels)" in charts[0]  # letters, not outlines


def test_equal_results_give_equal_pages(folder: Path) -> None:
    assert page_of(folder) == page_of(folder)


def test_all_that_a_run_knows_is_told(folder: Path) -> None:
    run = {
        "take": {"name": "dance & more", "fps": 29.97, "frames": 16},
        "versions": {"xormocap": "9.8.7"},
        "settings": {"backend": "cpu", "search": {"max_passes": 3, "camera_weights": [], "windows": True}},
        "output": {"smooth": "rts", "cutoff_hz": 5.0},
        "speed": {"frames_per_s": 12.345, "first_frame_s": 0.76},
        "accuracy": {"mean_mm": 5.31, "p95_mm": 10.92, "lost_limbs": [1], "mean_by_joint_mm": {"neck": 2.72}},
        "fit": {
            "first_frame": 0,
            "end_frame": 10,
            "energy_after_px": [90.0] * 4,
            "iou_after": {"cam01": 0.951, "cam02": 0.62},
        },
    }
    (folder / "run.json").write_text(json.dumps(run))
    frames = np.arange(100, 116, dtype=np.int32)
    seconds = {"frame": np.full(16, 0.05), "torso": np.full(16, 0.01)}
    write_frame_file(folder / "timings.csv", frames, {"seconds": seconds})
    dips = np.full(16, 0.9)
    dips[7] = 0.3
    part_px = {part: np.full(16, 50.0) for part in PARTS}
    energies = {"part_px": part_px, "iou": {"cam01": np.full(16, 0.9), "cam <2>": dips}}
    write_frame_file(folder / "energies.csv", frames, energies)
    page = page_of(folder)
    for words in (
        *("left arm", "cam01 (0.900)", "cam &lt;2&gt; (0.863)"),
        *("dance &amp; more", "9.8.7", "max passes", "mean 5.3 mm, 95 % below 10.9 mm", "2.7 mm"),
        *("12.3 frames per second", "cam02", "0.620", "whole frame", "4 frames from 0 to 9"),
    ):
        assert words in page, words
    assert Reader(page).seen.count("svg") == 7


def test_energies_go_there_and_back(tmp_path: Path) -> None:
    frames, rng = np.array([4, 5, 6], np.int32), np.random.default_rng(0)
    part_px = {part: np.floor(100 * rng.random(3)) for part in PARTS}
    iou = {camera: np.round(rng.random(3), 4) for camera in ("a, b", "c")}
    path = tmp_path / "energies.csv"
    write_frame_file(path, frames, {"part_px": part_px, "iou": iou})
    found_frames, found = read_frame_file(path)
    np.testing.assert_array_equal(found_frames, frames)
    np.testing.assert_equal(found, {"part_px": part_px, "iou": iou})
    path.write_text(path.read_text().replace(f",{iou['c'][1]}", ",1.5"))
    with pytest.raises(TakeError, match=r"line 3: iou_c: expected a number from 0 to 1, found '1.5'"):
        read_frame_file(path)


def test_key_frames_are_the_overlays(folder: Path) -> None:
    write_overlay(folder, 16)
    energies_px = np.ones(16)
    energies_px[12] = 5.0
    frames = list(range(100, 116))
    shown = key_frames(folder / "overlay.mp4", frames, energies_px)
    assert [caption.split(",")[0] for caption, _ in shown] == [
        "first: frame 100", "middle: frame 107", "largest energy: frame 112", "last: frame 115",
    ]  # fmt: skip
    for (_, jpeg), grey in zip(shown, (0, 70, 120, 150), strict=True):
        content = np.frombuffer(base64.b64decode(jpeg), np.uint8)
        picture = cv2.imdecode(content, cv2.IMREAD_COLOR)
        assert picture.shape == (48, 64, 3)
        assert abs(float(picture.mean()) - grey) < 4


def test_the_most_doubtful_frame_is_a_key_frame(folder: Path) -> None:
    write_overlay(folder, 16)
    assert "most doubtful: frame 103" in page_of(folder)


def test_the_picture_of_the_fit_is_shown(folder: Path) -> None:
    (folder / "fit").mkdir()
    cv2.imwrite(str(folder / "fit" / "overlay.png"), np.full((48, 64, 3), 90, np.uint8))
    assert 'alt="the fitted body"' in page_of(folder)


def test_what_the_fit_warned_of_is_told(folder: Path) -> None:
    record = FitRecord(
        actor="0" * 64, first_frame=0, end_frame=1, hints={}, energy_before_px=[0.0], energy_after_px=[0.0],
        iou_before={}, iou_after={}, seconds={}, warnings=["something hides the actor from <cam02>"],
    )  # fmt: skip
    assert "The fitted body" not in page_of(folder)
    write_record(folder / "fit", record)
    assert "<p>something hides the actor from &lt;cam02&gt;</p>" in page_of(folder)


def test_every_curve_has_the_red_bands(folder: Path) -> None:
    charts = re.findall(r"<svg.*?</svg>", page_of(folder), re.DOTALL)
    bands = [len(re.findall("#d1242f", chart)) for chart in charts]
    n_angles = len(charts[-1].split("(°)")) - 1
    assert bands[0] == 1 and bands[-1] == n_angles  # one doubtful stretch in every curve


def test_nothing_is_green_where_the_body_is_doubtful_or_was_not_judged(folder: Path) -> None:
    result = load_result(folder)
    assert result.tracked.marks is not None
    result.distrusted[3:5] = np.array(PARTS) == "torso", np.array(PARTS) == "head"
    result.confidence[7:9, :] = np.nan
    figure = Figure()
    trust(figure, result)
    (picture,) = figure.axes[0].images
    shades = picture.to_rgba(picture.get_array())
    np.testing.assert_array_equal(shades[:, 7:9], np.broadcast_to(shades[0, 7], (6, 2, 4)))
    assert np.ptp(shades[0, 7, :3]) < 0.1, "grey"
    assert (shades[:, :7, 1] - shades[:, :7, 0]).min() > 0.2, "green"
    reds = [len(bars.get_paths()) for bars in figure.axes[0].collections]
    assert dict(zip(PARTS, reds, strict=True)) == dict.fromkeys(PARTS, 1) | {"head": 2}
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()][:2] == ["whole body", "head"]


def test_an_overlay_of_other_frames_or_a_broken_one_is_left_out(folder: Path) -> None:
    write_overlay(folder, 5)
    assert key_frames(folder / "overlay.mp4", list(range(16)), np.ones(16)) == []
    (folder / "overlay.mp4").write_bytes(b"no video")
    assert key_frames(folder / "overlay.mp4", list(range(16)), np.ones(16)) == []


def test_timings_go_there_and_back(tmp_path: Path) -> None:
    solved = [SimpleNamespace(measured={}, seconds=seconds) for seconds in ({"frame": 0.5}, {"head": 0.25})]
    write_frame_files(tmp_path, np.array([4, 5], np.int32), solved, ["frame", "head"], ["cam01"])
    assert [path.name for path in tmp_path.iterdir()] == ["timings.csv"], "nobody counted pixels"
    assert (tmp_path / "timings.csv").read_text().splitlines()[0] == "frame,frame_s,head_s"
    frames, found = read_frame_file(tmp_path / "timings.csv")
    assert frames.tolist() == [4, 5]
    assert {stage: values.tolist() for stage, values in found["seconds"].items()} == {
        "frame": [0.5, 0.0], "head": [0.0, 0.25],
    }  # fmt: skip
