"""Mistakes in a take are told before the work: by the command where it ends there, else as a remark."""

import shutil
import socket
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Never

import cv2
import numpy as np
import pytest

from services.mocap.camera.calibration import read_calibration, write_calibration
from services.mocap.errors import TakeError
from services.mocap.synth.take import write_synthetic_take
from services.mocap.take.folder import open_take
from services.mocap.take.layout import background_video_path, video_path
from services.mocap.take.writer import video_writer
from services.mocap.types import Bytes, Mask
from services.runs.take_silhouettes import TakeSilhouettes

FRAMES, CAMERAS = 40, 5
NOT_FITTED = "nobody can be fitted"
Damage = Callable[[Path], object]
Checked = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A take with exact silhouettes in place of videos."""
    folder = tmp_path_factory.mktemp("good") / "walk"
    write_synthetic_take(folder, n_frames=FRAMES, n_cameras=CAMERAS)
    shutil.move(folder / "reference" / "silhouettes", folder / "silhouettes")
    shutil.rmtree(folder / "videos")
    return folder


@pytest.fixture
def take(good: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(good, tmp_path / "walk"))


@pytest.fixture
def checked(xormocap: Checked, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Checked:
    """`checked(command, take)`: what the command does up to the fit, which fails: nothing long runs."""

    def fail(*_: object, **__: object) -> None:
        raise TakeError(NOT_FITTED)

    def run(command: str, take: Path) -> "subprocess.CompletedProcess[str]":
        done = xormocap(command, take, "--out", tmp_path / "out")
        assert done.returncode == 2
        assert not (tmp_path / "out").exists()
        return done

    monkeypatch.setattr("services.commands.fit.fit_take", fail)
    monkeypatch.setattr("services.commands.fitted_runs.fit_take", fail)
    return run


@pytest.fixture
def remarks(checked: Checked) -> Callable[[Path], list[str]]:
    """`remarks(take)`: the warnings of `track`; what then fails is said to come from the first one."""

    def run(take: Path) -> list[str]:
        lines = checked("track", take).stderr.splitlines()
        told = [line.removeprefix("warning: ") for line in lines if line.startswith("warning: ")]
        assert lines[-1] == (f"{told[0]}; this led to: {NOT_FITTED}" if told else NOT_FITTED)
        return told

    return run


def _swap(take: Path) -> None:
    one, other = (take / "silhouettes" / name for name in ("cam01", "cam02"))
    one.rename(take / "silhouettes" / "moved")
    other.rename(one)
    (take / "silhouettes" / "moved").rename(other)


def _change(take: Path, camera: str, change: Callable[[Bytes, int], Bytes]) -> None:
    for path in (take / "silhouettes" / camera).iterdir():
        mask = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8)
        cv2.imwrite(str(path), change(mask, int(path.stem)))


def _invert(take: Path) -> None:
    cameras = read_calibration(take / "calibration.toml", "z")
    inverse = [
        replace(
            c, R_camera_world=c.R_camera_world.T, t_camera_world_m=-c.R_camera_world.T @ c.t_camera_world_m
        )
        for c in cameras
    ]
    write_calibration(take / "calibration.toml", tuple(inverse), "z")


def _as_opengl(take: Path, n_cameras: int) -> None:
    turn = np.diag([1.0, -1.0, -1.0])
    cameras = list(read_calibration(take / "calibration.toml", "z"))
    for n, c in enumerate(cameras[:n_cameras]):
        cameras[n] = replace(
            c, R_camera_world=turn @ c.R_camera_world, t_camera_world_m=turn @ c.t_camera_world_m
        )
    write_calibration(take / "calibration.toml", tuple(cameras), "z")


def _say_y_is_up(take: Path) -> None:
    settings = take / "take.toml"
    settings.write_text(settings.read_text().replace('up = "z"', 'up = "y"'))


@pytest.mark.parametrize(
    ("command", "damage", "said"),
    [
        ("track", _say_y_is_up, 'take.toml: up: the cameras stand upright if "z" is up'),
        ("fit", _say_y_is_up, 'take.toml: up: the cameras stand upright if "z" is up'),
        ("track", _swap, "calibration.toml: cam01 and cam02 are swapped"),
        ("track", _invert, "agree only if these are read as the way from the camera to the world"),
        ("track", lambda take: _as_opengl(take, CAMERAS), "read as OpenGL's axes, y up and z backward"),
        ("track", lambda take: _as_opengl(take, 1), "[cam01] rotation: faces away from the actor"),
        (
            "track",
            lambda take: _change(take, "cam03", lambda mask, _: np.ascontiguousarray(mask[::-1, ::-1])),
            "[cam03]: its pictures are upside down",
        ),
    ],
    ids=["up", "up of fit", "swapped", "inverted", "OpenGL", "facing away", "upside down"],
)
def test_what_cannot_be_tracked_is_refused(
    take: Path, checked: Checked, command: str, damage: Damage, said: str
) -> None:
    damage(take)
    done = checked(command, take)
    (sentence,) = [line for line in done.stderr.splitlines() if said in line]
    assert sentence.startswith(f"{take}/")
    assert NOT_FITTED not in done.stderr
    assert "Traceback" not in done.stderr


def test_inverted_silhouettes_are_told_and_nothing_else(take: Path, checked: Checked) -> None:
    for camera in (folder.name for folder in (take / "silhouettes").iterdir()):
        _change(take, camera, lambda mask, _: 255 - mask)
    lines = checked("track", take).stderr.splitlines()
    assert "cameras are white nearly all over in frame" in lines[-1]
    assert lines[-1].endswith("check the background, or invert the pictures")
    assert not [line for line in lines if line.startswith("warning: ")]


def test_nothing_is_said_of_a_good_take(good: Path, remarks: Callable[[Path], list[str]]) -> None:
    assert remarks(good) == []


def _delay(take: Path) -> None:
    folder = take / "silhouettes" / "cam02"
    for frame in range(FRAMES - 6):
        shutil.copy(folder / f"{frame + 6:06d}.png", folder / f"{frame:06d}.png")


def _cut_feet(mask: Bytes, _frame: int) -> Bytes:
    rows = np.flatnonzero(mask.any(axis=1))
    mask[rows[-1] - round(0.13 * len(rows)) :] = 0
    return mask


def _cut_at_the_edge(take: Path) -> None:
    """The picture of cam03 ends at the shins: it is taken from higher up."""
    down_px = 0

    def lower(mask: Bytes, _frame: int) -> Bytes:
        nonlocal down_px
        rows = np.flatnonzero(mask.any(axis=1))
        down_px = down_px or len(mask) - rows[-1] + round(0.15 * len(rows))
        return np.concatenate([np.zeros_like(mask[:down_px]), mask[:-down_px]])

    _change(take, "cam03", lower)
    cameras = list(read_calibration(take / "calibration.toml", "z"))
    K = cameras[2].K.copy()
    K[1, 2] += down_px
    cameras[2] = replace(cameras[2], K=K)
    write_calibration(take / "calibration.toml", tuple(cameras), "z")


def _another_from_the_middle(mask: Bytes, frame: int) -> Bytes:
    return np.maximum(mask, np.roll(mask, 60, axis=1)) if frame >= FRAMES // 2 else mask


def _in_all(take: Path, change: Callable[[Bytes, int], Bytes]) -> None:
    for n in range(CAMERAS):
        _change(take, f"cam{n + 1:02d}", change)


@pytest.mark.parametrize(
    ("damage", "said", "remedy"),
    [
        (_delay, "cam02: is out of step by about 6 frames", "run xormocap sync {take}, which writes offsets"),
        (
            lambda take: _change(take, "cam04", _cut_feet),
            "silhouettes of cam04: the actor ends 0.",
            "look at them (xormocap segment)",
        ),
        (
            lambda take: _in_all(take, _cut_feet),
            "the feet are missing in them, or the origin of the world is not on the floor",
            "look at them (xormocap segment)",
        ),
        (
            _cut_at_the_edge,
            "silhouettes of cam03: end at the lower edge of the picture: legs or feet are not in view",
            "move these cameras back or tilt them down",
        ),
        (
            lambda take: _in_all(take, _another_from_the_middle),
            "the cameras agree up to frame 19, and not from frame 20 on; a second person",
            "track the part before with --frames 0:20",
        ),
    ],
    ids=["out of step", "feet of one camera", "feet", "cut at the edge", "second person"],
)
def test_what_is_not_certain_is_a_remark(
    take: Path, remarks: Callable[[Path], list[str]], damage: Damage, said: str, remedy: str
) -> None:
    damage(take)
    remark = next(remark for remark in remarks(take) if said in remark)
    assert remedy.format(take=take) in remark


@pytest.mark.parametrize("of_all", [True, False], ids=["a jump", "shadow on a foot"])
def test_feet_that_reach_the_floor_in_other_frames_are_no_remark(
    take: Path, remarks: Callable[[Path], list[str]], *, of_all: bool
) -> None:
    def cut(mask: Bytes, frame: int) -> Bytes:
        return _cut_feet(mask, frame) if 10 <= frame < 30 else mask

    if of_all:
        _in_all(take, cut)
    else:
        _change(take, "cam04", cut)
    assert not any("above the floor" in remark for remark in remarks(take))


def test_a_late_camera_is_told_beside_a_second_person(
    take: Path, remarks: Callable[[Path], list[str]]
) -> None:
    _in_all(take, lambda mask, frame: np.maximum(mask, np.roll(mask, 60, axis=1)) if frame >= 30 else mask)
    _delay(take)
    told = remarks(take)
    assert any("the cameras agree up to frame 29, and not from frame 30 on" in remark for remark in told)
    assert any("cam02: is out of step by about 6 frames" in remark for remark in told)


@pytest.fixture
def videos(synthetic_take: Path, tmp_path: Path) -> Path:
    """A take with videos of three cameras, whose body is not known."""
    take = Path(shutil.copytree(synthetic_take, tmp_path / "videos"))
    (take / "actor.toml").unlink()
    write_calibration(take / "calibration.toml", read_calibration(take / "calibration.toml", "z")[:3], "z")
    for video in sorted((take / "videos").iterdir())[3:]:
        video.unlink()
    return take


def _pictures(take: Path, camera: str) -> tuple[list[Bytes], list[Mask]]:
    """A camera's pictures (H, W, 3), and where the actor is in each (H, W)."""
    opened = open_take(take)
    with opened.video(next(c for c in opened.cameras if c.name == camera)) as video:
        pictures = [picture.copy() for picture in video]
    masks = sorted((take / "reference" / "silhouettes" / camera).iterdir())
    return pictures, [np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) > 0 for path in masks]


def _beside(picture: Bytes, mask: Mask, of: Bytes, by_px: int) -> Bytes:
    """A picture with the actor of another one, some columns to the right."""
    there = np.roll(mask, by_px, axis=1)
    return np.where(there[..., None], np.roll(of, by_px, axis=1), picture)


def _change_plate(take: Path, camera: str, change: Callable[[Bytes], Bytes]) -> None:
    path = background_video_path(take, camera)
    stream = cv2.VideoCapture(str(path))
    read, plate = stream.read()
    stream.release()
    assert read
    path.unlink()
    cv2.imwrite(str(path.with_suffix(".png")), change(np.asarray(plate, np.uint8)))


def test_a_displaced_plate_is_a_remark(videos: Path, remarks: Callable[[Path], list[str]]) -> None:
    _change_plate(videos, "cam02", lambda plate: cv2.copyMakeBorder(plate[:, :-5], 0, 0, 5, 0, 1))
    remark = remarks(videos)[0]
    assert remark.startswith(f"{videos}/background: clean plate of cam02 lies 5.0 px beside the pictures and")
    assert "record the empty stage again" in remark


@pytest.mark.parametrize(
    ("damage", "said"),
    [(_invert, "the way from the camera to the world"), (lambda take: _as_opengl(take, 3), "OpenGL's axes")],
    ids=["inverted", "OpenGL"],
)
def test_a_calibration_whose_cameras_look_at_no_common_place_is_refused_before_anything_is_learnt(
    videos: Path, checked: Checked, damage: Damage, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    damage(videos)

    def learn(_: object) -> Never:
        raise AssertionError("learnt of all cameras together, which takes longer than comparing them")

    monkeypatch.setattr(TakeSilhouettes, "segmenter", property(learn))
    sentence = checked("track", videos).stderr.splitlines()[-1]
    assert sentence.startswith(f"{videos}/calibration.toml: rotation, translation: the cameras agree only if")
    assert said in sentence


def test_plates_of_other_cameras_are_refused_at_once(videos: Path, checked: Checked) -> None:
    one, other = (background_video_path(videos, camera) for camera in ("cam01", "cam03"))
    one.rename(videos / "moved.mp4")
    other.rename(one)
    (videos / "moved.mp4").rename(other)
    for command in ("fit", "track"):
        assert checked(command, videos).stderr.splitlines()[-1] == (
            f"{videos}/background/: clean plates: that of cam01 shows what the video of cam03 does, that of "
            "cam03 shows what the video of cam01 does: exchange these videos, or the files of the plates "
            "(--no-check goes on nevertheless)"
        )


def test_somebody_in_a_plate_is_named_before_what_the_silhouettes_then_look_like(
    videos: Path, checked: Checked
) -> None:
    pictures, masks = _pictures(videos, "cam01")
    _change_plate(videos, "cam01", lambda plate: _beside(plate, masks[0], pictures[0], 80))
    said = checked("track", videos).stderr.splitlines()[-1]
    assert said.startswith(
        f"{videos}/background: clean plate of cam01: shows something that most frames do not"
    )
    _, _, then = said.partition("record the empty stage with nobody in it; ")
    # The silhouettes of so poor a plate are on the verge of looking like those of a mirrored camera.
    assert then.startswith(
        (f"with these silhouettes, {videos}/calibration.toml: [cam01]", "this led to: nobody")
    )


def test_a_second_person_in_videos_is_told_with_its_frame(
    videos: Path, remarks: Callable[[Path], list[str]]
) -> None:
    for camera in open_take(videos).cameras:
        pictures, masks = _pictures(videos, camera.name)
        with video_writer(video_path(videos, camera.name), *camera.size_px, 15.0) as video:
            for frame, (picture, mask) in enumerate(zip(pictures, masks, strict=True)):
                video.write(_beside(picture, mask, picture, 35) if frame >= 12 else picture)
    (remark,) = remarks(videos)
    assert "the cameras agree up to frame 11, and not from frame 12 on; a second person" in remark


@pytest.mark.parametrize("times", [0.8, 0.67, 1.3])
def test_light_that_changes_by_a_third_is_no_mistake(
    videos: Path, remarks: Callable[[Path], list[str]], times: float
) -> None:
    for camera in open_take(videos).cameras:
        pictures, _ = _pictures(videos, camera.name)
        with video_writer(video_path(videos, camera.name), *camera.size_px, 15.0) as video:
            for frame, picture in enumerate(pictures):
                video.write(np.asarray(picture * times, np.uint8) if frame >= 12 else picture)
    assert remarks(videos) == []


def test_a_take_without_background_is_told_at_once(
    videos: Path, remarks: Callable[[Path], list[str]]
) -> None:
    shutil.rmtree(videos / "background")
    (remark,) = remarks(videos)
    assert remark.startswith("background/: there is no picture of the empty stage")
    assert remark.endswith("record the empty stage for a second into background/<camera>.mp4")


def test_the_port_is_tried_before_the_work(good: Path, xormocap, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = xormocap("track", good, "--out", tmp_path / "out", "--view", "--port", port)
    assert done.returncode == 2
    assert f"--port {port}: address already in use: choose another" in done.stderr
    assert "checking" not in done.stderr
