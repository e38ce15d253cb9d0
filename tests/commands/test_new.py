"""`xormocap new`, from videos as they lie about to a take that opens."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from opencap_files import write_opencap
from services.cli import app
from services.mocap.camera.calibration import read_calibration
from services.mocap.errors import UserError
from services.mocap.result.result import load_result
from services.mocap.take.folder import open_take
from services.mocap.take.settings import read_take_file


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


def test_the_empty_stage_is_copied_into_the_take_under_the_cameras_names(shoot: Path, tmp_path: Path) -> None:
    empty = tmp_path / "room"
    empty.mkdir()
    for number in (1, 2):
        shutil.copy(shoot / f"walk7-Camera{number}.mp4", empty / f"empty-{number}.mp4")
    given = shoot, "--calibration", shoot / "calibration.toml", "--background", empty
    printed = run(tmp_path / "take", *given)
    take = open_take(tmp_path / "take")
    for number, camera in enumerate(take.cameras, start=1):
        plate = take.plate(camera)
        assert plate == tmp_path / f"take/background/{camera.name}.mp4"
        assert plate.read_bytes() == (empty / f"empty-{number}.mp4").read_bytes()
        assert f"empty-{number}.mp4" in printed
    assert "record the empty stage" not in printed
    (tmp_path / "take/take.toml").unlink()
    run(tmp_path / "take", shoot, "--background", tmp_path / "take/background")
    assert len(list((tmp_path / "take/background").iterdir())) == 2


def test_cameras_without_a_calibration_are_named_as_they_would_be_typed(shoot: Path, tmp_path: Path) -> None:
    """macOS takes ü apart in file names."""
    (shoot / "walk7-Camera1.mp4").rename(shoot / "Su\u0308d.mp4")
    run(tmp_path / "take", shoot)
    assert list(read_take_file(tmp_path / "take/take.toml").videos) == ["S\u00fcd", "walk7-Camera2"]


def test_an_empty_stage_of_another_size_leaves_nothing(shoot: Path, tmp_path: Path) -> None:
    empty = tmp_path / "room"
    empty.mkdir()
    for number in (1, 2):
        cv2.imwrite(str(empty / f"cam0{number}.png"), np.zeros((96, 128, 3), np.uint8))
    with pytest.raises(UserError, match="128x96"):
        run(tmp_path / "take", shoot, "--calibration", shoot / "calibration.toml", "--background", empty)
    assert not (tmp_path / "take").exists()


def test_cameras_are_in_the_calibrations_order(shoot: Path, tmp_path: Path) -> None:
    calibration = shoot / "calibration.toml"
    by_number = calibration.read_text()
    for first, second in (("1", "2"), ("2", "1")):
        text = (
            by_number if first == "1" else re.sub("cam0([12])", lambda m: f"cam0{3 - int(m[1])}", by_number)
        )
        calibration.write_text(text)
        for stem in ("walk7-Camera{}.mp4", "cam0{}.mp4"):  # matched by words, then named like the cameras
            for number, path in zip("12", sorted(shoot.glob("*.mp4")), strict=True):
                path.rename(shoot / stem.format(number))
            out = tmp_path / f"take{first}{stem[0]}"
            printed = run(out, shoot, "--calibration", calibration)
            names = [f"cam0{first}", f"cam0{second}"]
            assert list(read_take_file(out / "take.toml").videos) == names
            assert printed.index(names[0]) < printed.index(names[1])


def test_fields_to_add_are_comments_above_the_videos(shoot: Path, tmp_path: Path) -> None:
    out = tmp_path / "take"
    run(out, shoot, "--calibration", shoot / "calibration.toml")
    text = (out / "take.toml").read_text()
    (out / "take.toml").write_text(re.sub("^# (?=[a-z_]+ = )", "", text, flags=re.MULTILINE))
    said = read_take_file(out / "take.toml")
    assert (said.fps, said.frames, said.actor_height, said.init_frames, said.facing) == (
        50,
        500,
        1.75,
        10,
        90,
    )
    (out / "take.toml").write_text(f"{text}actor_height = 1.75\n")
    with pytest.raises(UserError, match=r"videos: actor_height: is a field .* move it above \[videos\]$"):
        open_take(out)


def test_a_calibration_that_is_missing_or_unknown_is_said_without_an_option_that_new_lacks(
    shoot: Path, tmp_path: Path
) -> None:
    (tmp_path / "notes.doc").write_text("")
    for name, said in (
        ("missing.toml", "is missing: expected a calibration"),
        ("notes.doc", "is not a known"),
    ):
        with pytest.raises(UserError) as refused:
            run(tmp_path / "take", shoot, "--calibration", tmp_path / name)
        assert str(refused.value).startswith(f"{tmp_path / name}: {said}")
        assert "--from" not in str(refused.value)


def test_a_video_of_no_camera_is_said_now_and_later(shoot: Path, tmp_path: Path) -> None:
    shutil.copy(shoot / "walk7-Camera1.mp4", shoot / "walk7-Camera5.mp4")
    printed = run(tmp_path / "take", shoot, "--calibration", shoot / "calibration.toml")
    said = f"{shoot}/walk7-Camera5.mp4: belongs to no camera of calibration.toml and is not used"
    assert said in printed.replace("\n", " ")
    assert open_take(tmp_path / "take").remarks == ()


def test_without_a_calibration_it_says_what_is_next(shoot: Path, tmp_path: Path) -> None:
    printed = run(tmp_path / "take", *sorted(shoot.glob("*.mp4")))
    assert "next: xormocap calibrate CLIPS" in printed
    assert 'walk7-Camera1 = "../shoot/walk7-Camera1.mp4"' in (tmp_path / "take/take.toml").read_text()


def test_what_it_refuses_leaves_nothing(shoot: Path, tmp_path: Path) -> None:
    out = tmp_path / "take"
    (shoot / "walk7-Camera2.mp4").rename(shoot / "other.mp4")
    for words, said in (
        ((out, tmp_path / "nowhere"), "nowhere: is missing"),
        ((out, tmp_path), "has none of the files that are needed: expected files such as .mp4"),
        (
            (out, shoot, "--calibration", shoot / "calibration.toml"),
            r"that of cam02: .*the videos are other\.mp4, walk",
        ),
        (
            (out, shoot, "--background", shoot / "calibration.toml"),
            "is of another kind: expected a file such as .* or .png",
        ),
        (
            (out, shoot, "--background", shoot / "other.mp4"),
            r"empty stage of walk7-Camera1 among other\.mp4: name",
        ),
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


@pytest.mark.parametrize("said", [(), ("--up", "z")])
def test_the_world_of_a_file_stands_as_its_format_says_or_the_user(
    shoot: Path, tmp_path: Path, said: tuple[str, ...]
) -> None:
    """OpenCap's y axis points down."""
    cameras = read_calibration(shoot / "calibration.toml", "z")
    write_opencap(tmp_path / "opencap", cameras)
    run(tmp_path / "take", shoot, "--calibration", tmp_path / "opencap", *said)
    for found, camera in zip(open_take(tmp_path / "take").calibrated, cameras, strict=True):
        x, y, z = camera.centre_world_m
        np.testing.assert_allclose(found.centre_world_m, [x, -z, y] if said else [x, y, z], atol=1e-6)
