"""A group's silhouettes of a shot are those that the same pictures get in a recorded take."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from proto.messages import LivePace
from services.mocap.camera.colour import ColourCorrection, write_colours
from services.mocap.energy.bitplanes import TriPlanes, unpack, unpack_classes
from services.mocap.take.fit_record import COLOUR_BINS, OCCLUDED, read_learnt, write_colour_tables
from services.mocap.take.folder import Take, open_take
from services.mocap.take.layout import video_path
from services.mocap.take.live import open_live
from services.mocap.take.video import VideoReader
from services.mocap.take.writer import write_picture
from services.mocap.types import Mask
from services.process import StopRequest
from services.segmentation.live import serving
from services.segmentation.live.empty_stage import see_empty_stage
from services.segmentation.live.group import Feed, Group
from services.segmentation.live.serving import Silhouetter, serve_live
from services.segmentation.live.shots import CoordinatorClock, Shot, Taken
from services.segmentation.segmenters import make_segmenter
from services.segmentation.silhouettes import packed

_NO_RED = ColourCorrection(np.diag([0.0, 1.0, 1.0, 0.0])[:3])
"""Before a grey wall a red ball can hardly be seen without it."""


@pytest.fixture
def folder(small_take: Callable[..., Path]) -> Path:
    folder = small_take("stage", n_cameras=3)
    cameras = "".join(f'[cameras.cam0{c}]\nsource = "videos/cam0{c}.mp4"\n' for c in (1, 2, 3))
    (folder / "live.toml").write_text(
        'name = "stage"\nfps = 10.0\nup = "z"\ncalibration = "calibration.toml"\nbackground = "background"\n'
        + cameras
    )
    return folder


def _shot(raw: Take) -> Shot:
    taken = {c: Taken(next(iter(raw.video(camera))), 0.0) for c, camera in enumerate(raw.cameras)}
    return Shot(0, 0.0, taken)


def _live(folder: Path, raw: Take, segmenter: str) -> TriPlanes:
    silhouetter = Silhouetter(open_live(folder / "live.toml"), range(3), segmenter)
    there, planes = silhouetter.planes(_shot(raw))
    assert there == [0, 1, 2]
    return planes


def _recorded(folder: Path, segmenter: str) -> TriPlanes:
    take = open_take(folder)
    made = make_segmenter(take, take.cameras, segmenter)
    return packed(next(made.trimaps(0, 1)), 64, 48)


def test_silhouettes_are_those_of_a_recorded_take(folder: Path) -> None:
    live, recorded = _live(folder, open_take(folder), "paper"), _recorded(folder, "paper")
    assert unpack(live.silhouettes, 3).any(axis=(1, 2)).all()
    assert not live.unsure.any()
    np.testing.assert_array_equal(live.silhouettes, recorded.silhouettes)
    np.testing.assert_array_equal(live.unsure, recorded.unsure)


def test_what_learns_of_a_take_ahead_is_nearly_as_good_live(folder: Path) -> None:
    live, recorded = (
        unpack(f.silhouettes, 3)
        for f in (_live(folder, open_take(folder), "auto"), _recorded(folder, "auto"))
    )
    shared, either = ((op(live, recorded)).sum(axis=(1, 2)) for op in (np.logical_and, np.logical_or))
    assert recorded.any(axis=(1, 2)).all()
    assert (shared / either > 0.8).all()


@pytest.mark.parametrize("segmenter", ["auto", "paper"])
def test_colours_are_corrected_before_silhouettes_are_made(folder: Path, segmenter: str) -> None:
    raw = open_take(folder)
    plain = _live(folder, raw, segmenter)
    write_colours(folder / "colour.toml", {f"cam0{c}": (_NO_RED, 9.0, 1.0) for c in (1, 2)})
    planes = _live(folder, raw, segmenter)
    changed = (unpack(planes.silhouettes, 3) != unpack(plain.silhouettes, 3)).any(axis=(1, 2))
    assert changed.tolist() == [True, True, False]


def test_what_a_fit_learnt_counts_live_as_in_a_recorded_take(folder: Path, tmp_path: Path) -> None:
    raw = open_take(folder)
    hidden: Mask = np.zeros(raw.cameras[1].shape_px, bool)
    hidden[:, 30:] = True
    tables = {"cam01": np.ones(COLOUR_BINS, np.uint8), "cam03": np.zeros(COLOUR_BINS, np.uint8)}
    tables["cam03"][:8], tables["cam03"][8:] = 2, 3
    write_picture(tmp_path / OCCLUDED / "cam02.png", hidden)
    write_colour_tables(tmp_path, tables)
    made = make_segmenter(raw, raw.cameras, "paper").knowing(*read_learnt(tmp_path, raw.cameras))
    moment = next(made.moments(0, 1))
    recorded = packed(moment.trimaps, 64, 48, moment.classes)
    silhouetter = Silhouetter(open_live(folder / "live.toml"), range(3), "paper", tmp_path)
    _, live = silhouetter.planes(_shot(raw))
    for name in ("silhouettes", "unsure", "sent_classes"):
        np.testing.assert_array_equal(getattr(live, name), getattr(recorded, name), name)
    assert unpack(live.unsure, 3).sum(axis=(1, 2)).tolist() == [0, hidden.sum(), 0]
    classes = unpack_classes(live.sent_classes, 3)
    assert [set(np.unique(of_camera)) for of_camera in classes[:2]] == [{0, 1}, {0}]
    assert set(np.unique(classes[2])) & {2, 3}
    there, two = silhouetter.planes(Shot(0, 0.0, {c: _shot(raw).taken[c] for c in (0, 2)}))
    assert there == [0, 2]
    np.testing.assert_array_equal(unpack_classes(two.sent_classes, 2), classes[[0, 2]])


def test_a_camera_without_a_picture_has_no_silhouette(folder: Path) -> None:
    raw = open_take(folder)
    silhouetter = Silhouetter(open_live(folder / "live.toml"), range(3), "auto")
    shot = _shot(raw)
    there, planes = silhouetter.planes(Shot(0, 0.0, {c: shot.taken[c] for c in (0, 2)}))
    assert there == [0, 2]
    assert unpack(planes.silhouettes, 2).any(axis=(1, 2)).all()


def test_pictures_are_recorded_as_they_are_and_reduced_for_silhouettes(folder: Path, tmp_path: Path) -> None:
    settings = folder / "live.toml"
    settings.write_text(f"longest_side = 32\n{settings.read_text()}")
    take, now_s = open_live(settings), time.monotonic()
    clock = CoordinatorClock("here")
    clock.hear(
        LivePace(
            take="stage", run="a" * 32, asked_s=now_s, answered_s=now_s, clock="here", shot=0,
            shot_s=now_s + 0.3, period_s=0.1,
        ),
        now_s,
    )  # fmt: skip
    group = Group(take, range(3), clock, tmp_path)
    try:
        group.begin()
        shot = group.shots.take(10.0)
        deadline_s = time.monotonic() + 10.0
        while not group.has_ended and time.monotonic() < deadline_s:
            time.sleep(0.01)
    finally:
        group.stop(4)
    group.check()
    assert shot is not None
    assert {taken.image.shape for taken in shot.taken.values()} == {(24, 32, 3)}
    for camera in take.cameras:
        with VideoReader(video_path(tmp_path, camera.name)) as video:
            assert [picture.shape for picture in video] == [(48, 64, 3)] * 4


def test_a_source_that_fails_in_an_unknown_way_ends_its_feed_and_says_so(folder: Path) -> None:
    def begin(_: threading.Event) -> None:
        raise RuntimeError("no driver")

    feed = Feed(open_take(folder).cameras[0], begin, lambda *_: None)
    feed.join()
    assert feed.has_ended
    assert str(feed.problem) == "cam01: cannot be read (RuntimeError: no driver)"


class _EnoughError(Exception):
    """What is tested has happened."""


def test_a_segmentation_that_is_started_again_does_not_look_at_the_stage_again(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By then the actor may be there."""
    live = replace(open_live(folder / "live.toml"), background_folder=None)
    made, looked = Mock(side_effect=_EnoughError), Mock(wraps=see_empty_stage)
    monkeypatch.setattr(serving, "Silhouetter", made)
    monkeypatch.setattr(serving, "see_empty_stage", looked)
    for _ in range(2):
        with StopRequest() as stop, pytest.raises(_EnoughError):
            serve_live(live, [0, 1, 2], "tcp://127.0.0.1:1", stop, None, "auto", None, None, tmp_path)
    assert looked.call_count == 1
    for call in made.call_args_list:
        assert call.args[0].background_folder == tmp_path / "background"
