"""A folder of board clips."""

from pathlib import Path

import pytest

from services.mocap.calibration.clips import find_clips
from services.mocap.take.recordings import VIDEO_SUFFIXES


@pytest.mark.parametrize("suffix", [*VIDEO_SUFFIXES, ".MTS"])
def test_a_clip_is_any_video_that_a_take_may_have(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"cam1{suffix}").touch()
    (tmp_path / "notes.txt").touch()
    (clip,) = find_clips(tmp_path)
    assert (clip.camera, clip.is_video) == ("cam1", True)


def test_a_camera_is_named_as_it_would_be_typed(tmp_path: Path) -> None:
    """macOS takes ü apart in file names."""
    (tmp_path / "Su\u0308d.mp4").touch()
    assert [clip.camera for clip in find_clips(tmp_path)] == ["S\u00fcd"]
