"""`xormocap new`, from videos as they lie about to a take that opens."""

from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from services.cli import app
from services.mocap.errors import UserError
from services.mocap.result.result import load_result
from services.mocap.take.folder import open_take


def run(*words: object) -> str:
    result = CliRunner().invoke(app, ["new", *map(str, words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture
def shoot(small_take: Callable[..., Path], tmp_path: Path) -> Path:
    """Two videos with a camera's number each, and the calibration of both."""
    take = small_take()
    folder = tmp_path / "shoot"
    folder.mkdir()
    for number in (1, 2):
        (take / f"videos/cam0{number}.mp4").rename(folder / f"walk7-Camera{number}.mp4")
    (take / "calibration.toml").rename(folder / "calibration.toml")
    return folder


def test_videos_and_a_calibration_become_a_take(shoot: Path, tmp_path: Path) -> None:
    printed = run(tmp_path / "take", shoot, "--calibration", shoot / "calibration.toml")
    assert "64x48" in printed
    assert f"xormocap sync {tmp_path / 'take'}" in printed.replace("\n", "")
    assert f"xormocap track {tmp_path / 'take'}" in printed.replace("\n", "")
    take = open_take(tmp_path / "take")
    assert (take.settings.name, take.settings.fps, take.settings.frames) == ("take", 10.0, 4)
    for number, camera in enumerate(take.cameras, start=1):
        assert take.videos[camera.name].samefile(shoot / f"walk7-Camera{number}.mp4")


def test_without_a_calibration_it_says_what_is_next(shoot: Path, tmp_path: Path) -> None:
    printed = run(tmp_path / "take", *sorted(shoot.glob("*.mp4")))
    assert "next: xormocap calibrate CLIPS" in printed
    assert 'walk7-Camera1 = "../shoot/walk7-Camera1.mp4"' in (tmp_path / "take/take.toml").read_text()


def test_what_it_refuses_leaves_nothing(shoot: Path, tmp_path: Path) -> None:
    out = tmp_path / "take"
    (shoot / "walk7-Camera2.mp4").rename(shoot / "other.mp4")
    for words, said in (
        ((out, tmp_path / "nowhere"), "nowhere: is missing"),
        ((out, tmp_path), "has no video"),
        ((out, shoot, "--calibration", shoot / "calibration.toml"), "that of cam02 among"),
    ):
        with pytest.raises(UserError, match=said):
            run(*words)
        assert not out.exists()
    run(out, shoot)
    with pytest.raises(UserError, match="exists already"):
        run(out, shoot)


def test_a_take_is_no_result_and_what_to_do_is_said(small_take: Callable[..., Path]) -> None:
    take = small_take()
    with pytest.raises(UserError, match=f"is a take without results: type xormocap track {take}"):
        load_result(take)
