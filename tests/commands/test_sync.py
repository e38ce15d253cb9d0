"""`xormocap sync` and `calibrate --check` on a synthetic take with silhouettes of its own."""

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import cv2
import numpy as np
import pytest

from services.commands.calibrate.check import check_take
from services.commands.sync import sync, told_of
from services.mocap.calibration.lost_frames import LostFrames, find_lost_frames
from services.mocap.calibration.mistakes import mistakes_in
from services.mocap.camera.calibration import read_calibration, write_calibration
from services.mocap.errors import TakeError, UserError
from services.mocap.synth.take import write_synthetic_take
from services.mocap.take.folder import Take, open_take
from services.mocap.take.settings import read_take_file
from services.runs.outlines import outlines_of

FRAMES, N_CAMERAS = 60, 5
AHEAD = {"cam01": 4, "cam02": 0, "cam03": 10, "cam04": 7, "cam05": 1}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A take with exact silhouettes in place of videos."""
    folder = tmp_path_factory.mktemp("sync") / "walk"
    write_synthetic_take(folder, n_frames=FRAMES, n_cameras=N_CAMERAS)
    shutil.move(folder / "reference" / "silhouettes", folder / "silhouettes")
    shutil.rmtree(folder / "videos")
    return folder


@pytest.fixture
def take(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "walk"))


def delay(take: Path, ahead: dict[str, int]) -> None:
    """As if each camera had been started so many frames before the others, whose files end as much later."""
    most = max(ahead.values())
    for name, frames in ahead.items():
        folder = take / "silhouettes" / name
        kept = [folder / f"{n:06d}.png" for n in range(most - frames, FRAMES)]
        moved = take / "moved"
        moved.mkdir()
        for n, path in enumerate(kept):
            path.rename(moved / f"{n:06d}.png")
        shutil.rmtree(folder)
        moved.rename(folder)
    text = (take / "take.toml").read_text()
    (take / "take.toml").write_text(
        "# by hand\n" + text.replace(f"frames = {FRAMES}", f"frames = {FRAMES - most}")
    )


def test_offsets_of_up_to_ten_frames_are_found_and_read(take: Path, recorded: Path) -> None:
    delay(take, AHEAD)
    sync(take, reach=12, write=True)
    settings = read_take_file(take / "take.toml")
    assert settings.offsets == AHEAD
    assert settings.frames == FRAMES - 10
    assert "# by hand" in (take / "take.toml").read_text()
    opened, original = open_take(take), open_take(recorded)
    for camera in opened.cameras:
        for mask, same in zip(opened.trimaps(camera), original.trimaps(camera, 10), strict=False):
            np.testing.assert_array_equal(mask, same)
    sync(take, reach=12, write=True)  # again: offsets that are there already do not add up
    assert read_take_file(take / "take.toml") == settings


def test_a_take_in_step_stays_as_it_is(take: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (take / "take.toml").read_text().replace(f"frames = {FRAMES}", f"frames = {FRAMES - 3}")
    (take / "take.toml").write_text(text)
    sync(take, reach=10, write=True)
    assert "walk: 5 cameras are in step, to half a frame: nothing needs to be done" in capsys.readouterr().out
    assert (take / "take.toml").read_text() == text


@pytest.mark.parametrize(
    ("shown", "said"),
    [
        ([*range(30), *range(31, FRAMES)], "1 frame missing"),
        ([*range(30), *range(33, FRAMES)], "3 frames missing"),
        ([*range(30), 29, *range(30, FRAMES - 1)], "1 frame too many"),
    ],
)
def test_frames_lost_on_the_way_are_told_and_no_offset_is_written(
    take: Path, shown: list[int], said: str
) -> None:
    folder = take / "silhouettes" / "cam03"
    moments = [(folder / f"{n:06d}.png").read_bytes() for n in shown]
    shutil.rmtree(folder)
    folder.mkdir()
    for n, moment in enumerate(moments):
        (folder / f"{n:06d}.png").write_bytes(moment)
    text = (take / "take.toml").read_text().replace(f"frames = {FRAMES}", f"frames = {len(shown)}")
    (take / "take.toml").write_text(text)
    with pytest.raises(TakeError) as refused:
        sync(take, reach=10, write=True)
    told = re.search(rf"silhouettes/cam03: {said} at about frame (\d+), or", str(refused.value))
    assert told is not None and abs(int(told[1]) - 30) <= 2, refused.value
    assert (take / "take.toml").read_text() == text
    opened, frames = open_take(take), range(10, len(shown))
    cameras, outlines, _ = outlines_of(opened, frames, lambda _: None)
    (mistake,) = mistakes_in(cameras, outlines, opened.settings.up, take, frames)
    assert mistake.file == "cam03"
    assert mistake.what == f"has {said} at about frame {told[1]}, or was moved then"


def test_of_two_cameras_neither_is_said_to_have_lost_frames(take: Path) -> None:
    opened = open_take(take)
    cameras, outlines, _ = outlines_of(opened, range(FRAMES), lambda _: None)
    outlines[1] = [*outlines[1][:30], *outlines[1][32:], None, None]
    in_step = np.zeros(N_CAMERAS)
    found = find_lost_frames(cameras[:3], outlines[:3], in_step[:3])
    assert found is not None
    assert (found.camera, str(found)) == (1, "2 frames missing")
    assert find_lost_frames(cameras[:2], outlines[:2], in_step[:2]) is None


def test_a_video_that_lost_frames_is_mended_by_a_command() -> None:
    """The frames that ffmpeg's filters repeat and drop were looked at in a video (ffmpeg 5.1)."""
    take = cast(
        Take, SimpleNamespace(cameras=[SimpleNamespace(name="a")], source="videos", videos={"a": "a b.mp4"})
    )
    for n_lost, filters in ((2, "loop=2:1:30"), (-2, "select='not(between(n,30,31))'")):
        said = told_of(LostFrames(0, n_lost, 30, 0.5), take)
        assert f"ffmpeg -i 'a b.mp4' -vf \"{filters},setpts=N/FR/TB\" -crf 12 NEW.mp4" in said


def hide_the_actor_from(take: Path, camera: str) -> None:
    for path in (take / "silhouettes" / camera).iterdir():
        cv2.imwrite(str(path), np.zeros_like(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)))


def test_cameras_in_step_beside_one_that_tells_nothing_need_nothing(
    take: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hide_the_actor_from(take, "cam03")
    before = (take / "take.toml").read_text()
    sync(take, reach=10, write=True)
    printed, warned = capsys.readouterr()
    ahead = dict(row.split()[:2] for row in printed.splitlines()[1:6])
    assert ahead == {"cam01": "0", "cam02": "0", "cam03": "-", "cam04": "0", "cam05": "0"}
    assert "walk: 4 cameras are in step, to half a frame: nothing needs to be done for them" in printed
    assert "warning: " in warned
    assert "silhouettes do not determine the offsets of cam03: expected" in warned
    assert (take / "take.toml").read_text() == before


def test_in_step_means_with_the_offsets_that_the_take_has(
    take: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    delay(take, AHEAD)
    hide_the_actor_from(take, "cam03")
    with pytest.raises(UserError, match="do not determine the offsets of cam03: expected"):
        sync(take, reach=12, write=True)
    assert "in step" not in capsys.readouterr().out
    text = (take / "take.toml").read_text() + "\n[offsets]\n"
    (take / "take.toml").write_text(text + "".join(f"{name} = {n}\n" for name, n in AHEAD.items()))
    sync(take, reach=12, write=True)
    assert "4 cameras are in step" in capsys.readouterr().out
    assert read_take_file(take / "take.toml").offsets == AHEAD


def test_somebody_who_stands_still_tells_nothing(take: Path) -> None:
    for folder in (take / "silhouettes").iterdir():
        for path in folder.iterdir():
            if path.name != "000000.png":
                shutil.copy(folder / "000000.png", path)
    before = (take / "take.toml").read_text()
    with pytest.raises(UserError, match="do not determine the offsets"):
        sync(take, reach=10, write=True)
    assert (take / "take.toml").read_text() == before


def test_offsets_are_checked(take: Path) -> None:
    text = (take / "take.toml").read_text()
    for table, said in (
        ("[offsets]\ncam1 = 2\n", "offsets: cam1: is no camera of calibration.toml: did you mean cam01"),
        ("[offsets]\ncam02 = -1\n", "offsets: cam02: expected 0 or more"),
        ("[offsets]\ncam02 = 2.5\n", "offsets: expected a table of whole frames"),
        ("[offsets]\ncam02 = 3\n", "from frame 3 on, the camera's offset"),
    ):
        (take / "take.toml").write_text(text + table)
        with pytest.raises(TakeError) as refused:
            open_take(take)
        assert said in str(refused.value)


def test_cameras_that_agree_pass(take: Path) -> None:
    check_take(take)


def _turned(take: Path, camera: int, flip: Callable[[np.ndarray], np.ndarray]) -> None:
    for path in (take / "silhouettes" / f"cam{camera + 1:02d}").iterdir():
        cv2.imwrite(str(path), flip(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)))


def _moved(take: Path) -> None:
    cameras = list(read_calibration(take / "calibration.toml", "z"))
    moved = cameras[2].t_camera_world_m + np.array([0.0, 0.05, 0.0])
    cameras[2] = replace(cameras[2], t_camera_world_m=moved)
    write_calibration(take / "calibration.toml", tuple(cameras), "z")


def _exchanged(take: Path) -> None:
    (take / "silhouettes" / "cam03").rename(take / "x")
    shutil.copytree(take / "silhouettes" / "cam04", take / "silhouettes" / "cam03")


@pytest.mark.parametrize(
    ("flip", "said"),
    [
        (lambda picture: picture[::-1, ::-1], "upside down"),
        (lambda picture: picture[:, ::-1], "mirrored"),
    ],
)
def test_flipped_pictures_of_a_camera_are_named(
    take: Path, flip: Callable[[np.ndarray], np.ndarray], said: str
) -> None:
    _turned(take, 2, flip)
    with pytest.raises(TakeError) as refused:
        check_take(take)
    assert f"calibration.toml: [cam03]: its pictures are {said} against its calibration" in str(refused.value)
    filters = {"upside down": "hflip,vflip", "mirrored": "hflip"}[said]
    assert f"(ffmpeg -vf {filters})" in str(refused.value)


def test_pictures_of_all_cameras_that_are_upside_down_are_told(take: Path) -> None:
    """As of cameras that hang from the ceiling."""
    for camera in range(len(open_take(take).cameras)):
        _turned(take, camera, lambda picture: picture[::-1, ::-1])
    with pytest.raises(TakeError, match="the pictures of all cameras are upside down against it: flip them"):
        check_take(take)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [(_moved, "cam03: not in agreement with the other 4 cameras"), (_exchanged, "cam03")],
    ids=["moved", "another camera's pictures"],
)
def test_the_camera_that_does_not_agree_is_named(
    take: Path, spoil: Callable[[Path], None], said: str
) -> None:
    spoil(take)
    with pytest.raises(TakeError, match="not in agreement with") as refused:
        check_take(take)
    assert said in str(refused.value)
    others = [f"cam{n:02d}" for n in (1, 2, 4, 5)]
    assert not any(f"{name}:" in str(refused.value).split("not in agreement")[0] for name in others)


def test_a_camera_that_shows_nobody_is_told(take: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _turned(take, 1, np.zeros_like)
    check_take(take)
    said = " ".join(capsys.readouterr().err.split())
    assert "silhouettes: cam02: nobody is whole in them, so nothing was compared: look at them" in said
