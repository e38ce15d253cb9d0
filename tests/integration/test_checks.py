"""Mistakes in a take are told before the work: by the command where it ends there, else as a remark."""

import shutil
import socket
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from services.commands.checks import look_before
from services.mocap.camera.calibration import read_calibration, write_calibration
from services.mocap.synth.take import write_synthetic_take
from services.mocap.take.folder import open_take
from services.mocap.types import Bytes
from services.segmentation.segmenters import AUTO

FRAMES, CAMERAS = 40, 5
Damage = Callable[[Path], None]


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


def remarks(take: Path) -> str:
    opened = open_take(take)
    found = look_before(opened, range(opened.settings.frames), AUTO)
    return "\n".join(map(str, found))


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
    take: Path, xormocap, tmp_path: Path, command: str, damage: Damage, said: str
) -> None:
    damage(take)
    done = xormocap(command, take, "--out", tmp_path / "out")
    assert done.returncode == 2
    (sentence,) = [line for line in done.stderr.splitlines() if said in line]
    assert sentence.startswith(f"{take}/")
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_nothing_is_said_of_a_good_take(good: Path) -> None:
    assert remarks(good) == ""


def _delay(take: Path) -> None:
    folder = take / "silhouettes" / "cam02"
    for frame in range(FRAMES - 6):
        shutil.copy(folder / f"{frame + 6:06d}.png", folder / f"{frame:06d}.png")


def _cut_feet(mask: Bytes, _frame: int) -> Bytes:
    rows = np.flatnonzero(mask.any(axis=1))
    mask[rows[-1] - round(0.13 * len(rows)) :] = 0
    return mask


def _another_from_the_middle(mask: Bytes, frame: int) -> Bytes:
    return np.maximum(mask, np.roll(mask, 60, axis=1)) if frame >= FRAMES // 2 else mask


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (_delay, "cam02: is out of step by about 6 frames"),
        (lambda take: _change(take, "cam04", _cut_feet), "silhouettes of cam04: the actor ends 0."),
        (
            lambda take: [_change(take, f"cam{n + 1:02d}", _cut_feet) for n in range(CAMERAS)],
            "the feet are missing in them, or the origin of the world is not on the floor",
        ),
        (
            lambda take: [_change(take, f"cam{n + 1:02d}", _another_from_the_middle) for n in range(CAMERAS)],
            "the cameras agree up to frame 19, and not from frame 20 on; a second person",
        ),
    ],
    ids=["out of step", "feet of one camera", "feet", "second person"],
)
def test_what_is_not_certain_is_a_remark(take: Path, damage: Damage, said: str) -> None:
    damage(take)
    assert said in remarks(take)


def test_a_take_without_background_is_told_at_once(synthetic_take: Path, tmp_path: Path) -> None:
    take = Path(shutil.copytree(synthetic_take, tmp_path / "walk"))
    shutil.rmtree(take / "background")
    assert remarks(take).startswith("background/: there is no picture of the empty stage")


def test_the_port_is_tried_before_the_work(good: Path, xormocap, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = xormocap("track", good, "--out", tmp_path / "out", "--view", "--port", port)
    assert done.returncode == 2
    assert f"--port {port}: address already in use: choose another" in done.stderr
    assert "checking" not in done.stderr
