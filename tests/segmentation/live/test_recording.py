"""Live pictures on disk: frame n is shot n, and a shot without a picture repeats the one before."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.take.csv_columns import read_columns
from services.mocap.take.video import VideoReader
from services.segmentation.live.recording import CameraRecording, stamps_path


def test_frames_are_shots(tmp_path: Path, small_cameras: Callable[[int], list[Camera]]) -> None:
    recording = CameraRecording(tmp_path, small_cameras(1)[0], 10.0)
    recording.end_before(10)
    for shot in (2, 3, 6, 7, 11):
        recording.add(shot, np.full((48, 64, 3), 20 * shot, np.uint8), shot / 10 + 0.001)
    recording.finish(10)
    with VideoReader(tmp_path / "videos" / "cam01.mp4") as reader:
        levels = [round(float(picture.mean()) / 20) for picture in reader]
    assert levels == [2, 2, 2, 3, 3, 3, 6, 7, 7, 7]
    columns = read_columns(stamps_path(tmp_path, "cam01"), ["frame", "time_s"], allow_extra=False)
    assert columns.cells["time_s"][2] == "0.201000"
    assert [bool(cell) for cell in columns.cells["time_s"]] == [n in (2, 3, 6, 7) for n in range(10)]


def test_a_recording_that_fails_at_its_end_holds_nobody_up_either(
    tmp_path: Path, small_cameras: Callable[[int], list[Camera]]
) -> None:
    (tmp_path / "stamps").write_text("a file in place of the folder")
    recording = CameraRecording(tmp_path, small_cameras(1)[0], 10.0)
    recording.add(0, np.zeros((48, 64, 3), np.uint8), 0.0)
    recording.finish(3)
    assert "cannot record there" in str(recording.problem)


def test_a_recording_that_fails_says_why_and_holds_nobody_up(
    tmp_path: Path, small_cameras: Callable[[int], list[Camera]]
) -> None:
    odd = replace(small_cameras(1)[0], width_px=63)
    recording = CameraRecording(tmp_path, odd, 10.0)
    for shot in range(300):  # more than wait in the queue
        recording.add(shot, np.zeros((48, 63, 3), np.uint8), shot / 10)
    recording.finish(300)
    assert isinstance(recording.problem, UserError)
    assert "even width" in str(recording.problem)


def test_pictures_of_another_size_hold_nobody_up_either(
    tmp_path: Path, small_cameras: Callable[[int], list[Camera]]
) -> None:
    recording = CameraRecording(tmp_path, small_cameras(1)[0], 10.0)
    for shot in range(300):
        recording.add(shot, np.zeros((24, 64, 3), np.uint8), shot / 10)
    recording.finish(300)
    assert "cannot record there" in str(recording.problem)


def test_a_recording_without_pictures_leaves_no_file(
    tmp_path: Path, small_cameras: Callable[[int], list[Camera]]
) -> None:
    recording = CameraRecording(tmp_path, small_cameras(1)[0], 10.0)
    time.sleep(0.2)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
    recording.finish(1)
    assert (tmp_path / "videos" / "cam01.mp4").is_file(), "others may have pictures"


def test_a_recording_that_can_only_fail_at_its_end_holds_nobody_up(
    tmp_path: Path, small_cameras: Callable[[int], list[Camera]]
) -> None:
    (tmp_path / "videos").write_text("a file in place of the folder")
    recording = CameraRecording(tmp_path, small_cameras(1)[0], 10.0)
    recording.finish(3)
    assert "cannot record there" in str(recording.problem)


def test_a_recording_that_begins_late_says_so(
    tmp_path: Path, small_cameras: Callable[[int], list[Camera]], caplog: pytest.LogCaptureFixture
) -> None:
    """As where segmentation was started again: what it had recorded is lost."""
    recording = CameraRecording(tmp_path, small_cameras(1)[0], 10.0)
    recording.add(40, np.zeros((48, 64, 3), np.uint8), 4.0)
    recording.finish(41)
    assert "cam01: its first picture came after 4 s" in caplog.text
