"""Videos taken upright and a calibration of pictures that lie, or the other way round."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from board_stage import write
from rotation_tag import tag_a_quarter_turn
from services.cli import app
from services.mocap.camera.calibration import read_calibration, write_calibration
from services.mocap.errors import UserError
from services.mocap.take.folder import open_take
from services.mocap.take.video import VideoReader
from services.mocap.take.writer import video_writer

_AT_MOST_S = 20
"""It takes a tenth of a second; importing and a busy machine may take longer."""
_TAGGED = (
    "videos/cam02.mp4: is 48x64 pixels, turned by a quarter turn as its rotation tag says, but [cam02] size "
    "in calibration.toml is 64x48: remove the tag (ffmpeg -display_rotation 0 -i IN -c copy OUT), or "
    "calibrate with clips that have the same tag"
)
_STORED = (
    "videos/cam02.mp4: is 48x64 pixels, but [cam02] size in calibration.toml is 64x48: turn the pictures by "
    "a quarter turn (ffmpeg -i IN -vf transpose=1 OUT; transpose=2 if they are then upside down), or "
    "calibrate with pictures as these"
)


def complaint(*words: object) -> str:
    """The sentence with which the command refuses them."""
    began_s = time.monotonic()
    with pytest.raises(UserError) as refused:
        CliRunner().invoke(app, list(map(str, words)), catch_exceptions=False)
    assert time.monotonic() - began_s < _AT_MOST_S
    return str(refused.value)


def store_upright(video: Path) -> None:
    """Turn the pictures themselves."""
    with VideoReader(video) as reader:
        pictures = [np.ascontiguousarray(np.rot90(picture)) for picture in reader]
    height_px, width_px = pictures[0].shape[:2]
    with video_writer(video, width_px, height_px, 10.0) as writer:
        for picture in pictures:
            writer.write(picture)


def tag(video: Path) -> None:
    """Turn the pictures by the rotation tag alone."""
    tag_a_quarter_turn(video, height_px=48)


@pytest.fixture
def take(small_take: Callable[..., Path]) -> Path:
    return small_take()


@pytest.mark.parametrize(("turn", "sentence"), [(tag, _TAGGED), (store_upright, _STORED)])
@pytest.mark.parametrize("command", ["track", "fit", "segment", "sync"])
def test_an_upright_video_of_a_camera_that_was_calibrated_lying(
    take: Path, tmp_path: Path, command: str, turn: Callable[[Path], None], sentence: str
) -> None:
    turn(take / "videos/cam02.mp4")
    out = () if command == "sync" else ("--out", tmp_path / "out")
    assert complaint(command, take, *out) == f"{take}/{sentence}"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("turn", [tag, store_upright])
def test_the_other_way_round(take: Path, tmp_path: Path, turn: Callable[[Path], None]) -> None:
    """Calibrated upright, and the second camera's video lies."""
    cameras = [replace(camera, width_px=48, height_px=64) for camera in open_take(take).cameras]
    write_calibration(take / "calibration.toml", cameras, "z")
    for part in ("videos", "background"):
        turn(take / f"{part}/cam01.mp4")
    turn(take / "background/cam02.mp4")
    said = complaint("track", take, "--out", tmp_path / "out")
    assert said.startswith(
        f"{take}/videos/cam02.mp4: is 64x48 pixels, but [cam02] size in calibration.toml is 48"
    )
    assert "transpose=1" in said


def test_a_clean_plate_that_lies_is_named(take: Path, tmp_path: Path) -> None:
    tag(take / "background/cam01.mp4")
    said = complaint("track", take, "--out", tmp_path / "out")
    assert said.startswith(f"{take}/background/cam01.mp4: is 48x64 pixels, turned by a quarter turn")


def test_upright_videos_and_an_upright_calibration_go_together(take: Path) -> None:
    cameras = [replace(camera, width_px=48, height_px=64) for camera in open_take(take).cameras]
    write_calibration(take / "calibration.toml", cameras, "z")
    for video in take.rglob("*.mp4"):
        tag(video)
    assert [camera.height_px for camera in open_take(take).cameras] == [64, 64]


@pytest.mark.parametrize(("turn", "said"), [(tag, "rotation tag"), (store_upright, "transpose=1")])
def test_new_refuses_it_before_it_makes_a_folder(
    take: Path, tmp_path: Path, turn: Callable[[Path], None], said: str
) -> None:
    turn(take / "videos/cam02.mp4")
    made = tmp_path / "made"
    assert said in complaint("new", made, take / "videos", "--calibration", take / "calibration.toml")
    assert not made.exists()


def test_pictures_scaled_after_the_calibration(take: Path, tmp_path: Path) -> None:
    cameras = [
        replace(camera, width_px=128, height_px=96)
        for camera in read_calibration(take / "calibration.toml", "z")
    ]
    write_calibration(take / "calibration.toml", cameras, "z")
    assert complaint("track", take, "--out", tmp_path / "out").endswith(
        "scale the pictures (ffmpeg -i IN -vf scale=128:96 OUT), or calibrate with pictures of this size"
    )


def test_calibrate_names_a_clip_that_lies_before_it_looks_for_the_board(tmp_path: Path) -> None:
    clips = tmp_path / "clips"
    for camera in ("cam01", "cam02"):
        write(clips / camera / "000000.png", np.zeros((64, 48, 3), np.uint8))
        write(clips / "origin" / f"{camera}.png", np.zeros((64, 48, 3), np.uint8))
    lying = clips / "origin/cam02.png"
    write(lying, cv2.rotate(np.zeros((64, 48, 3), np.uint8), cv2.ROTATE_90_CLOCKWISE))
    assert complaint("calibrate", clips, "--squares", "5x7", "--square", "0.07") == (
        f"{lying}: is 64x48 pixels, but the camera's other clip is 48x64: record all clips of a camera with "
        "the same settings, and hold it the same way"
    )
