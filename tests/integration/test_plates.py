"""Clean plates are looked at between frames, and those left over at the end: a short run says it, too."""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest
from busy import ONE_WAY

from services.mocap.take.layout import BACKGROUND, background_video_path

pytestmark = pytest.mark.usefixtures("no_report")
_CAMERAS = ("cam01", "cam05")
"""The first that is looked at, and the last."""


def _spoil(take: Path, camera: str) -> None:
    """Put a picture with a pillar that is in no frame in place of a camera's clean plate."""
    video = background_video_path(take, camera)
    stream = cv2.VideoCapture(str(video))
    read, plate = stream.read()
    stream.release()
    assert read
    plate[60:130, 20:40] = (30, 200, 60)
    video.unlink()
    cv2.imwrite(str(take / BACKGROUND / f"{camera}.png"), plate)


def test_all_plates_are_looked_at_however_short_the_run(
    known_take: Path, xormocap: Callable[..., "subprocess.CompletedProcess[str]"], tmp_path: Path
) -> None:
    take = tmp_path / "walk"
    shutil.copytree(known_take, take)
    for camera in _CAMERAS:
        _spoil(take, camera)
    done = xormocap(
        "track", take, "--out", tmp_path / "out", "--frames", "0:1", "--workers", 1, "--no-overlay", *ONE_WAY
    )
    assert done.returncode == 0, done.stderr
    for camera in _CAMERAS:
        assert f"clean plate of {camera}: shows something that most frames do not" in done.stderr
