"""A live configuration is checked before anything is opened, and what it records is a take."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from services.mocap.camera.colour import ColourCorrection, write_colours
from services.mocap.errors import TakeError, UserError
from services.mocap.take.folder import Take, open_take
from services.mocap.take.live import OPEN_END, LiveTake, open_live, open_source
from services.mocap.take.live_recording import finish_recording, part_of, recording_to
from services.mocap.take.writer import video_writer

_HEAD = 'name = "stage"\nfps = 10.0\nup = "z"\ncalibration = "calibration.toml"\n'
_CAMERAS = "".join(f'[cameras.cam0{c}]\nsource = "videos/cam0{c}.mp4"\n' for c in (1, 2, 3))
_HALF = ColourCorrection(np.hstack([0.5 * np.eye(3), np.zeros((3, 1))]))
SmallTake = Callable[..., Path]


@pytest.fixture
def folder(small_take: SmallTake) -> Path:
    return small_take("stage", n_cameras=3)


def _write(folder: Path, text: str) -> Path:
    path = folder / "live.toml"
    path.write_text(text)
    return path


def test_it_stands_in_for_a_take(folder: Path) -> None:
    path = _write(folder, _HEAD + 'background = "background"\nactor_height = 1.8\n' + _CAMERAS)
    take = open_source(path)
    assert isinstance(take, LiveTake)
    assert take.settings.frames == OPEN_END
    assert take.settings.actor_height == 1.8
    assert [source.source for source in take.sources] == [
        str(folder / f"videos/cam0{c}.mp4") for c in (1, 2, 3)
    ]
    assert all(source.is_file for source in take.sources)
    assert take.groups() == {"cameras": [0, 1, 2]}
    assert not any(take.has_video(camera) for camera in take.cameras)
    assert next(iter(take.background(take.cameras[0]))).shape == (48, 64, 3)
    assert take.inputs(from_videos=True)[0] == folder / "calibration.toml"
    assert take.live.reach_s == pytest.approx(0.06)
    assert not isinstance(open_source(folder), LiveTake)


def test_kinds_of_sources(folder: Path) -> None:
    cameras = (
        "[cameras.cam01]\nsource = 2\ngroup = 'left'\n"
        "[cameras.cam02]\nsource = 'rtsp://camera/1'\ngroup = 'left'\n"
        "[cameras.cam03]\nsource = 'http://camera/2'\ndelay_s = 0.1\n"
    )
    take = open_live(_write(folder, _HEAD + "elsewhere = ['left']\n" + cameras))
    assert [source.has_stamps for source in take.sources] == [True, True, False]
    assert [source.is_file for source in take.sources] == [False] * 3
    assert take.groups() == {"left": [0, 1], "cameras": [2]}
    assert not take.has_background(take.cameras[0])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (_HEAD, "cameras: is missing: expected a table [cameras.NAME] with its source for every camera"),
        (
            _HEAD + _CAMERAS.replace("cam03", "cam3"),
            "[cameras.cam3]: is no camera of calibration.toml: did you mean cam03",
        ),
        (
            _HEAD + _CAMERAS[: _CAMERAS.index("[cameras.cam03")],
            "[cameras.cam03] is missing: expected a table with its source",
        ),
        (
            _HEAD + _CAMERAS.replace('"videos/cam02.mp4"', "-1"),
            "[cameras.cam02] source: expected the number of a V4L2 device, 0 or more, found -1",
        ),
        (
            _HEAD + _CAMERAS.replace('"videos/cam02.mp4"', '"ftp://camera"'),
            "[cameras.cam02] source: expected an address that begins with rtsp:// or http://, or a file, "
            "found 'ftp://camera'",
        ),
        (_HEAD + _CAMERAS + "stamp = 'arrival'", "[cameras.cam03] stamp: unknown field: did you mean stamps"),
        (
            _HEAD.replace("10.0", "0.0") + _CAMERAS,
            "fps: expected the cameras' frames per second, above 0, found 0.0",
        ),
        (_HEAD + "tolerance = 0.1\n" + _CAMERAS, "tolerance: unknown field: did you mean tolerance_s"),
        (
            _HEAD + "least_cameras = 9\n" + _CAMERAS,
            "least_cameras: expected at most 3, the cameras of calibration.toml",
        ),
        (
            _HEAD + "elsewhere = ['camera']\n" + _CAMERAS,
            "elsewhere: camera: no camera is of that group: did you mean cameras",
        ),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(folder: Path, text: str, sentence: str) -> None:
    path = _write(folder, text)
    with pytest.raises(TakeError) as refused:
        open_live(path)
    assert str(refused.value) == f"{path}: {sentence}"


def test_an_empty_stage_that_is_not_there(folder: Path) -> None:
    (folder / "background" / "cam02.mp4").unlink()
    with pytest.raises(TakeError, match=r"background: has neither cam02\.png nor cam02\.mp4"):
        open_live(_write(folder, _HEAD + 'background = "background"\n' + _CAMERAS))


def test_colours_are_corrected_in_plates_and_in_what_is_recorded(folder: Path, tmp_path: Path) -> None:
    raw = open_live(_write(folder, _HEAD + 'background = "background"\n' + _CAMERAS))
    assert raw.colours == {}
    write_colours(folder / "colour.toml", {"cam02": (_HALF, 9.0, 1.0)})
    take = open_live(_write(folder, _HEAD + 'background = "background"\n' + _CAMERAS))
    assert list(take.colours) == ["cam02"]
    for camera in take.cameras:
        ours, theirs = next(iter(take.background(camera))), next(iter(open_take(folder).background(camera)))
        np.testing.assert_array_equal(ours, theirs)
        assert np.any(ours != next(iter(raw.background(camera)))) == (camera.name == "cam02")
    assert folder / "colour.toml" in take.inputs(from_videos=True)
    part = part_of(tmp_path / "recorded")
    with recording_to(tmp_path / "recorded"):
        shutil.copytree(folder / "videos", part / "videos")
    finish_recording(take, tmp_path / "recorded")
    recorded = open_take(tmp_path / "recorded")
    for ours, theirs in zip(
        recorded.video(recorded.cameras[1]), open_take(folder).video(take.cameras[1]), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs)


def test_a_file_of_colours_that_is_named_has_to_be_there(folder: Path) -> None:
    path = _write(folder, _HEAD + 'colour = "colours.toml"\nbackground = "background"\n' + _CAMERAS)
    with pytest.raises(
        TakeError, match=r"live\.toml: colour: .*colours\.toml is missing: expected a file of"
    ):
        open_live(path)


def _record(part: Path, take: Take, lengths: tuple[int, ...]) -> None:
    """Write so many pictures of each camera's video as a recording does."""
    (part / "videos").mkdir()
    for camera, frames in zip(take.cameras, lengths, strict=True):
        with video_writer(part / "videos" / f"{camera.name}.mp4", 64, 48, 10.0) as writer:
            for picture in take.video(camera, 0, frames):
                writer.write(picture)


def test_a_recording_is_a_take(folder: Path, tmp_path: Path) -> None:
    smaller = 'background = "background"\nfacing = 90.0\nlongest_side = 32\n'
    take = open_live(_write(folder, _HEAD + smaller + _CAMERAS))
    out = tmp_path / "recorded"
    with recording_to(out):
        _record(part_of(out), open_take(folder), (3, 3, 3))
    assert finish_recording(take, out) == []
    recorded = open_take(out)
    assert (recorded.settings.name, recorded.settings.frames) == ("recorded", 3)
    assert recorded.settings.facing is None
    assert {camera.size_px for camera in recorded.calibrated} == {(64, 48)}
    assert {camera.size_px for camera in recorded.cameras} == {(32, 24)}
    assert all(recorded.has_background(camera) for camera in recorded.cameras)
    assert not part_of(out).exists()
    with pytest.raises(UserError, match="already exists"), recording_to(out):
        pass


def test_a_run_that_fails_before_its_first_picture_leaves_no_recording(tmp_path: Path) -> None:
    for _ in range(2):
        with pytest.raises(TakeError, match="no such camera"), recording_to(tmp_path / "recorded"):
            (part_of(tmp_path / "recorded") / "videos").mkdir()
            raise TakeError("no such camera")
    assert list(tmp_path.iterdir()) == []


def test_videos_of_different_lengths_stay_where_they_are(folder: Path, tmp_path: Path) -> None:
    take = open_live(_write(folder, _HEAD + 'background = "background"\n' + _CAMERAS))
    with recording_to(tmp_path / "recorded"):
        _record(part_of(tmp_path / "recorded"), open_take(folder), (4, 2, 4))
    with pytest.raises(TakeError, match="cam02 was recorded for 2 frames, others for 4"):
        finish_recording(take, tmp_path / "recorded")
    with (
        pytest.raises(UserError, match=r"recorded\.part already exists"),
        recording_to(tmp_path / "recorded"),
    ):
        pass
