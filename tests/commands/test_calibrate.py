"""`xormocap calibrate` from rendered pictures of a board, and what it says of pictures that are wrong."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.distance import pdist
from typer.testing import CliRunner

import board_stage
from board_stage import (
    Scene,
    centres_apart_m,
    distorted_px,
    picture,
    ring,
    shown_to_neighbours,
    with_fisheye,
    write,
    write_clips,
    write_pictures,
)
from services.cli import app
from services.commands.calibrate.board import calibrate_by_board, coverage_path, draw_board
from services.mocap.calibration.board import Board
from services.mocap.calibration.detection import Detector
from services.mocap.calibration.lens import Lens
from services.mocap.calibration.rigid_transform import RigidTransform
from services.mocap.camera.calibration import read_calibration
from services.mocap.errors import UserError
from services.mocap.types import Bytes

CHARUCO = Board(columns=5, rows=7, square_m=0.2, marker_m=0.15, dictionary="4x4_50")
CHESS = Board(kind="chessboard", columns=5, rows=8, square_m=0.2)
SAID = {"squares": "5x7", "square_m": 0.2, "marker_m": 0.15, "dictionary": "4x4_50"}
SAID_CHESS = {"kind": "chessboard", "squares": "5x8", "square_m": 0.2}


def calibrate(clips: Path, out: Path, said: dict[str, object], lens: Lens = "normal") -> None:
    calibrate_by_board(clips, said, lens, out, "z")


def scene(board: Board, moments: int = 10, n_cameras: int = 3, width_px: int = 1200) -> Scene:
    """Three neighbours of a ring of eight; the middle one sees the board with either neighbour."""
    rng = np.random.default_rng(11)
    cameras = ring(n_cameras, width_px, width_px * 3 // 4, rng, of=8)
    return shown_to_neighbours(cameras, board, moments, rng, closed=False)


@pytest.fixture(scope="module")
def charuco() -> Scene:
    return scene(CHARUCO)


@pytest.fixture(scope="module")
def clips(charuco: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clips")
    write_pictures(folder, charuco, np.random.default_rng(12))
    return folder


@pytest.fixture(scope="module")
def few_clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three moments before two cameras: enough to be refused."""
    folder = tmp_path_factory.mktemp("few") / "clips"
    shown = scene(CHARUCO, moments=3, n_cameras=2, width_px=800)
    write_pictures(folder, shown, np.random.default_rng(12))
    return folder


@pytest.fixture
def own_clips(clips: Path, tmp_path: Path) -> Path:
    """The same, to be spoiled."""
    return Path(shutil.copytree(clips, tmp_path / "clips"))


def change(folder: Path, change_picture) -> None:
    for path in folder.rglob("*.png") if folder.is_dir() else [folder]:
        path.write_bytes(cv2.imencode(".png", change_picture(cv2.imread(str(path))))[1].tobytes())


def test_cameras_are_found_by_pictures_of_a_charuco_board(
    clips: Path, charuco: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "calibration.toml"
    calibrate(clips, out, SAID)
    printed, warned = capsys.readouterr()
    found = read_calibration(out, "z")
    assert [camera.name for camera in found] == ["cam01", "cam02", "cam03"]
    assert centres_apart_m(found, charuco.cameras).max() < 0.02
    for one, true in zip(found, charuco.cameras, strict=True):
        assert one.K[0, 0] == pytest.approx(true.K[0, 0], rel=0.005)
    assert "cam02" in printed
    assert "error, px" in printed
    assert "upside" not in warned
    away_m = [np.hypot(*camera.centre_world_m[:2]) for camera in found]
    for row, away, camera in zip(printed.splitlines()[1:], away_m, found, strict=False):
        assert row.split()[-2:] == [f"{away:.2f}", f"{camera.centre_world_m[2]:.2f}"]
    record = json.loads((tmp_path / "calibration.json").read_text())
    assert record["cameras"]["cam02"]["error_px"] < 0.4
    sheet = cv2.imread(str(tmp_path / "coverage.png"))
    assert sheet.shape[1] > 1000
    assert (sheet.max(axis=2) > 150).mean() > 0.005  # dots


def test_a_chessboard_does_as_well_and_its_two_ends_are_told_apart(tmp_path: Path) -> None:
    shown = scene(CHESS, width_px=640)  # looking for a chessboard that is not there takes long
    write_pictures(tmp_path / "clips", shown, np.random.default_rng(13))
    calibrate(tmp_path / "clips", tmp_path / "calibration.toml", SAID_CHESS)
    found = read_calibration(tmp_path / "calibration.toml", "z")
    assert centres_apart_m(found, shown.cameras).max() < 0.02


@pytest.mark.parametrize("lens", ["normal", "fisheye"])
def test_cameras_are_found_by_videos_of_a_board(tmp_path: Path, lens: Lens) -> None:
    rng = np.random.default_rng(15)
    cameras = ring(2, 800, 600, rng, of=8)
    if lens == "fisheye":
        cameras = [with_fisheye(camera, rng) for camera in cameras]
    shown = shown_to_neighbours(cameras, CHARUCO, 12, rng, closed=False)
    write_clips(tmp_path / "clips", shown, rng)
    calibrate(tmp_path / "clips", tmp_path / "calibration.toml", SAID, lens)
    found = read_calibration(tmp_path / "calibration.toml", "z")
    assert [camera.fisheye for camera in found] == [lens == "fisheye"] * 2
    assert centres_apart_m(found, cameras).max() < 0.04  # few views in small pictures
    for one, true in zip(found, cameras, strict=True):
        assert one.K[0, 0] == pytest.approx(true.K[0, 0], rel=0.015)
    record = json.loads((tmp_path / "calibration.json").read_text())
    for figures in record["cameras"].values():
        assert figures["error_px"] < 0.4
        assert figures["rms_per_axis_px"] < 0.4


def complaint(clips: Path, tmp_path: Path, said: dict[str, object]) -> str:
    with pytest.raises(UserError) as refused:
        calibrate(clips, tmp_path / "out" / "calibration.toml", said)
    assert not (tmp_path / "out").exists()
    return str(refused.value)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"squares": "7x5"}, "shows a ChArUco board of 5x7 squares"),
        ({"squares": "6x8"}, "shows a ChArUco board of 5x7 squares"),
        ({"squares": "4x7"}, "shows a ChArUco board of 5x7 squares"),
        ({"dictionary": "5x5_50"}, "give --dictionary 4x4_"),
        ({"squares": "5 by 7"}, "--squares 5 by 7: expected"),
        (
            {"square_m": 54.0},
            "square_m: expected the side of a square in metres, 0.002 to 2, found 54.0: 54 mm is 0.054, "
            "54 cm is 0.54",
        ),
        (
            {"kind": "chessboard", "marker_m": None, "dictionary": None},
            "look the same when the board is rotated",
        ),
    ],
)
def test_a_wrong_board_is_noticed(
    few_clips: Path, tmp_path: Path, changed: dict[str, object], said: str
) -> None:
    assert said in complaint(few_clips, tmp_path, SAID | changed)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"squares": "7x5"}, "and not of 7x5: give --squares 5x7, columns before rows"),
        ({"dictionary": None}, "and not of 5x5_100: give --dictionary 4x4_"),
    ],
)
def test_a_wrong_board_is_noticed_as_well_if_it_is_white_on_black(
    few_clips: Path, tmp_path: Path, changed: dict[str, object], said: str
) -> None:
    shutil.copytree(few_clips, tmp_path / "clips")
    change(tmp_path / "clips", lambda picture: 255 - picture)
    assert said in complaint(tmp_path / "clips", tmp_path, SAID | changed)


def test_a_chessboard_of_a_wrong_size_is_noticed(tmp_path: Path) -> None:
    write_pictures(
        tmp_path / "clips", scene(CHESS, moments=3, n_cameras=2, width_px=480), np.random.default_rng(14)
    )
    assert "shows a chessboard of 5x8 squares" in complaint(
        tmp_path / "clips", tmp_path, SAID_CHESS | {"squares": "4x7"}
    )


def test_mirrored_pictures_are_noticed(own_clips: Path, tmp_path: Path) -> None:
    change(own_clips / "cam02", lambda picture: picture[:, ::-1])
    assert "cam02: is mirrored" in complaint(own_clips, tmp_path, SAID)


def test_a_camera_twice_is_noticed(own_clips: Path, tmp_path: Path) -> None:
    shutil.copytree(own_clips / "cam02", own_clips / "cam04")
    assert "cam02 and cam04: have identical pictures" in complaint(own_clips, tmp_path, SAID)


def test_clips_of_two_sizes_are_noticed(own_clips: Path, tmp_path: Path) -> None:
    change(own_clips / "origin" / "cam01.png", lambda picture: cv2.resize(picture, None, fx=0.5, fy=0.5))
    said = complaint(own_clips, tmp_path, SAID)
    assert "is 600x450 pixels, but the camera's other clip is 1200x900" in said


def test_an_origin_of_no_camera_is_noticed_before_the_board_is_searched(
    own_clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(Detector, "find")
    (own_clips / "origin").rename(tmp_path / "away")
    (own_clips / "origin").mkdir()
    (tmp_path / "away" / "cam01.png").rename(own_clips / "origin" / "floor.png")
    said = complaint(own_clips, tmp_path, SAID)
    assert said.endswith("origin: floor.png belongs to no camera: expected one of cam01, cam02, cam03")


def test_without_an_origin_the_cameras_are_right_to_each_other_and_it_is_said(
    own_clips: Path, charuco: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.rmtree(own_clips / "origin")
    calibrate(own_clips, tmp_path / "calibration.toml", SAID)
    printed, warned = capsys.readouterr()
    assert "up is up in the pictures of all cameras on average" in warned
    assert [row.split()[-2:] for row in printed.splitlines()[1:4]] == [["-", "-"]] * 3
    centres_m, true_m = (
        np.array([camera.centre_world_m for camera in cameras])
        for cameras in (read_calibration(tmp_path / "calibration.toml", "z"), charuco.cameras)
    )
    np.testing.assert_allclose(pdist(centres_m), pdist(true_m), rtol=0.02)


def test_measured_points_give_the_world_instead(
    own_clips: Path, charuco: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.rmtree(own_clips / "origin")
    points_m = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.3, -0.4, 1.2]])
    rows = [
        f"{camera.name},{u},{v},{x},{y},{z}"
        for camera in charuco.cameras
        for (u, v), (x, y, z) in zip(distorted_px(camera, points_m), points_m, strict=True)
    ]
    (tmp_path / "points.csv").write_text("camera,u,v,x,y,z\n" + "\n".join(rows))
    out = tmp_path / "calibration.toml"
    calibrate_by_board(own_clips, SAID, "normal", out, "z", points_file=tmp_path / "points.csv")
    assert "origin" not in capsys.readouterr().err
    assert centres_apart_m(read_calibration(out, "z"), charuco.cameras).max() < 0.03


def test_cameras_upside_down_or_behind_a_board_of_two_sides_are_calibrated_and_said(
    own_clips: Path,
    charuco: Scene,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whenever cam03 sees the board, it is from behind, and so does cam02 then."""
    monkeypatch.setattr(board_stage, "sees", lambda *_: True)
    rng, turned = np.random.default_rng(12), RigidTransform(np.diag([-1.0, 1.0, -1.0]), np.zeros(3))
    for frame, (pose, to) in enumerate(charuco.moments):
        for camera in (charuco.cameras[c] for c in to if 2 in to):
            behind = picture(camera, CHARUCO, pose @ turned, rng)
            write(own_clips / camera.name / f"{frame:06d}.png", behind)
    for path in (own_clips / "cam03", own_clips / "origin" / "cam03.png"):
        change(path, lambda picture: picture[::-1, ::-1])
    calibrate(own_clips, tmp_path / "calibration.toml", SAID)
    said = capsys.readouterr().err
    assert "cam03: hangs upside down" in said
    assert "cam03: saw the back of the board, as one printed on both sides has it" in said
    assert "cam01: saw the back" not in said
    found = read_calibration(tmp_path / "calibration.toml", "z")
    assert centres_apart_m(found, charuco.cameras).max() < 0.02


def test_each_calibration_of_a_folder_has_files_of_its_own(few_clips: Path, tmp_path: Path) -> None:
    assert coverage_path(tmp_path / "calibration.toml") == tmp_path / "coverage.png"
    assert coverage_path(tmp_path / "left.toml") == tmp_path / "left-coverage.png"
    with pytest.raises(UserError, match=r"left\.json: .*: expected one that ends in \.toml"):
        calibrate(few_clips, tmp_path / "left.json", SAID)


def test_a_level_camera_that_does_not_exist_is_refused_with_those_that_do(
    few_clips: Path, tmp_path: Path
) -> None:
    with pytest.raises(UserError, match=r"--level cam_9: is no camera of .*: expected one of cam01, cam02$"):
        calibrate_by_board(few_clips, SAID, "normal", tmp_path / "calibration.toml", "z", level="cam_9")


def test_a_board_is_drawn_as_it_is_detected(tmp_path: Path) -> None:
    path = tmp_path / "board.png"
    draw_board(path, {**SAID, "square_m": 0.03, "marker_m": 0.02}, None)
    drawn: Bytes = cv2.imread(str(path))
    board = Board(columns=5, rows=7, square_m=0.03, marker_m=0.02, dictionary="4x4_50")
    assert drawn.shape[0] == pytest.approx(8 * 0.03 / 0.0254 * 300, abs=12)
    sighting = Detector(board).find(drawn)
    assert sighting is not None
    assert len(sighting.corners) == board.n_corners


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("", "expected one of a folder of CLIPS"),
        ("--check TAKE --colour TAKE", "expected one of"),
        ("--draw FILE --refine RESULT CLIPS", "expected one of"),
        ("--draw FILE --points FILE", "expected one of"),
        ("--points FILE --refine RESULT TAKE", "expected one of"),
        ("--points FILE --check TAKE", "expected one of"),
        ("--import FILE CLIPS", "expected one of"),
        ("--check TAKE --out FILE", "--out has no effect with --check: leave it out"),
        ("--import FILE --lens wide", "--lens has no effect with --import"),
        ("CLIPS --to opencv", "--to has no effect with CLIPS"),
        ("TAKE --refine RESULT --square 0.03", "--square has no effect with --refine"),
        ("--draw FILE --up y", "--up has no effect with --draw"),
        ("--points FILE --lens wide --level cam01", "--level has no effect with --points"),
    ],
)
def test_what_would_be_ignored_is_refused(words: str, said: str) -> None:
    with pytest.raises(UserError, match=f"calibrate: {said}"):
        CliRunner().invoke(app, ["calibrate", *words.split()], catch_exceptions=False)
