"""A folder of board clips."""

from pathlib import Path

import numpy as np
import pytest

from services.mocap.calibration.clips import Clip, find_clips, spread_numbers
from services.mocap.take.recordings import VIDEO_SUFFIXES
from services.mocap.take.writer import write_picture


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


def test_pictures_beside_clips_are_no_cameras(tmp_path: Path) -> None:
    """coverage.png, which calibrate writes there; thumbnails."""
    (tmp_path / "origin").mkdir()
    for name in ("cam1.mp4", "cam2.mp4", "cam1.jpg", "coverage.png", "origin/cam1.png"):
        (tmp_path / name).touch()
    assert [clip.path.name for clip in find_clips(tmp_path)] == ["cam1.mp4", "cam2.mp4"]
    assert [clip.path.name for clip in find_clips(tmp_path / "origin")] == ["cam1.png"]


def test_all_clips_are_searched_in_the_same_moments(tmp_path: Path) -> None:
    """Also if one of them lacks a picture, or is longer."""
    clips = [Clip(name, tmp_path / name) for name in ("cam1", "cam2")]
    for clip, numbers in zip(clips, (range(40), [*range(3, 17), *range(18, 45)]), strict=True):
        clip.path.mkdir()
        for number in numbers:
            write_picture(clip.path / f"img{number:03d}.png", np.full((4, 6), number, np.uint8))
    moments = spread_numbers(clips, 20)
    assert len(moments) == 18  # every second one of those that both have
    for clip in clips:
        assert moments <= set(clip.numbers())
        seen = {number: int(picture[0, 0, 0]) for number, picture in clip.pictures(moments)}
        assert seen == {number: number for number in moments}


def test_a_clip_that_is_far_longer_or_shows_every_third_moment_does_not_starve_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    numbers = {"cam1": range(900), "cam2": range(1, 900, 3), "cam3": range(18_000)}
    monkeypatch.setattr(Clip, "numbers", lambda clip: numbers[clip.camera])
    clips = [Clip(name, Path(name)) for name in numbers]
    assert spread_numbers(clips, 300) == set(range(0, 900, 3))
    assert spread_numbers(clips[:2], 300) == set(numbers["cam2"])
    assert spread_numbers(clips[:1], 6) == set(range(0, 900, 150))
