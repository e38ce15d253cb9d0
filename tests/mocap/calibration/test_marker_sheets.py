"""Sheets of ArUco markers: their corners in pictures, cameras calibrated by them, and what is said of wrong
ones."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from board_stage import (
    Scene,
    centres_apart_m,
    distorted_px,
    picture,
    ring,
    shown_to_neighbours,
    write_pictures,
)
from services.commands.calibrate.board import board_of, calibrate_by_board
from services.mocap.calibration.board import Board, drawn
from services.mocap.calibration.detection import Detector
from services.mocap.calibration.diagnosis import wrong_markers
from services.mocap.calibration.rigid_transform import RigidTransform
from services.mocap.camera.calibration import read_calibration
from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.types import Bytes

SHEET = Board(kind="aruco", columns=4, rows=5, marker_m=0.2, gap_m=0.06, dictionary="4x4_50")
SAID = {"markers": "4x5", "marker_m": 0.2, "gap_m": 0.06, "dictionary": "4x4_50"}


def changed(**fields: object) -> Board:
    return Board.model_validate(SHEET.model_dump() | fields)


@pytest.fixture(scope="module")
def scene() -> Scene:
    rng = np.random.default_rng(11)
    return shown_to_neighbours(ring(2, 900, 675, rng, of=8), SHEET, 12, rng, closed=False)


@pytest.fixture(scope="module")
def shown(scene: Scene) -> Bytes:
    """A picture of the whole sheet."""
    return picture(scene.cameras[0], SHEET, before(scene.cameras[0]), np.random.default_rng(4))


def before(camera: Camera) -> RigidTransform:
    """T_world_board 3 m before a camera, tilted."""
    T_camera_world = RigidTransform(camera.R_camera_world, camera.t_camera_world_m)
    upright = np.diag([1.0, -1.0, -1.0])
    tilt = Rotation.from_euler("xyz", [25, -15, 10], degrees=True).as_matrix()
    return T_camera_world.inverse @ RigidTransform(tilt @ upright, np.array([0.1, -0.05, 3.0]))


def test_the_corners_of_a_sheet_are_where_the_print_has_them(scene: Scene, shown: Bytes) -> None:
    found = Detector(SHEET).find(shown)
    assert found is not None
    np.testing.assert_array_equal(found.corners, np.arange(SHEET.n_corners))
    true_px = distorted_px(scene.cameras[0], before(scene.cameras[0]).apply(SHEET.corners_m))
    off_px = np.linalg.norm(found.points_px - true_px, axis=1)
    assert np.median(off_px) < 0.25
    assert off_px.max() < 1.0


def test_a_sheet_is_read_white_on_black_from_behind_and_from_another_number_on(shown: Bytes) -> None:
    plain = Detector(SHEET).find(shown)
    inverted = Detector(changed(inverted=True)).find(255 - shown)
    behind = Detector(SHEET).find(np.ascontiguousarray(shown[:, ::-1]))
    assert plain is not None
    assert inverted is not None
    assert behind is not None
    assert (plain.is_behind, behind.is_behind) == (False, True)
    np.testing.assert_allclose(inverted.points_px, plain.points_px, atol=0.1)
    np.testing.assert_array_equal(behind.corners, plain.corners)
    np.testing.assert_allclose(shown.shape[1] - 1 - behind.points_px[:, 0], plain.points_px[:, 0], atol=0.1)
    later = changed(first_id=20)
    found = Detector(later).find(drawn(later, 60))
    assert found is not None
    np.testing.assert_array_equal(found.corners, plain.corners)


def test_markers_of_the_room_are_left_out(shown: Bytes) -> None:
    """A poster with two markers of the dictionary: one that the sheet lacks, and one that it has too."""
    poster = changed(columns=1, rows=2, first_id=19)
    stuck = shown.copy()
    small = drawn(poster, 50)
    stuck[5 : 5 + small.shape[0], 5 : 5 + small.shape[1]] = small[..., None]
    found, clean = Detector(SHEET).find(stuck), Detector(SHEET).find(shown)
    assert found is not None
    assert clean is not None
    assert set(clean.corners) - set(found.corners) == {76, 77, 78, 79}  # of number 19, which is there twice
    np.testing.assert_allclose(found.points_px, clean.points_px[:-4], atol=1e-6)
    hidden = stuck.copy()
    last_px = clean.points_px[-4:]
    (left, top), (right, bottom) = last_px.min(axis=0).astype(int) - 2, last_px.max(axis=0).astype(int) + 3
    hidden[top:bottom, left:right] = 128
    found = Detector(SHEET).find(hidden)  # now the poster's number 19 is the only one, far from the plane's
    assert found is not None
    assert len(found.corners) > 60
    assert not {76, 77, 78, 79} & set(found.corners)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"columns": 5, "rows": 4}, "sheet of 4x5 markers (or more rows) and not of 5x4: give --markers"),
        ({"first_id": 8}, "shows markers from number 0 on: give --first-id 0"),
        ({"dictionary": "5x5_50"}, "give --dictionary 4x4_"),
        ({"gap_m": 0.03}, "shows gaps of 0.30 of a marker's side, but --marker 0.2 --gap 0.03 means 0.15"),
        (
            {"kind": "charuco", "square_m": 0.26, "marker_m": None, "gap_m": None},
            "and not a ChArUco board of 4x5 squares: give --board aruco --markers 4x5",
        ),
        ({}, None),
    ],
)  # fmt: skip
def test_what_is_shown_instead_of_the_sheet_is_said(
    shown: Bytes, given: Mapping[str, object], said: str | None
) -> None:
    found = wrong_markers([shown[..., 0]], changed(**given))
    assert found is None if said is None else said in str(found)
    assert wrong_markers([255 - shown[..., 0]], changed(**given)) == found  # printed white on black
    assert wrong_markers([255 - shown[..., 0]], changed(**given, inverted=False)) is None


def test_a_charuco_board_is_told_from_a_sheet() -> None:
    charuco = Board(columns=5, rows=7, square_m=0.2, dictionary="4x4_50")
    found = wrong_markers([drawn(charuco, 60)], SHEET)
    assert "shows a ChArUco board of 5x7 squares" in str(found)
    assert "--board charuco --squares 5x7" in str(found)


def test_cameras_are_found_by_pictures_of_a_sheet(scene: Scene, tmp_path: Path) -> None:
    write_pictures(tmp_path / "clips", scene, np.random.default_rng(12))
    out = tmp_path / "calibration.toml"
    calibrate_by_board(tmp_path / "clips", SAID, "normal", out, "z")
    found = read_calibration(out, "z")
    assert centres_apart_m(found, scene.cameras).max() < 0.02
    for one, true in zip(found, scene.cameras, strict=True):
        assert one.K[0, 0] == pytest.approx(true.K[0, 0], rel=0.005)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"squares": "4x5"}, "--squares 4x5: a sheet of ArUco markers is described by --markers CxR"),
        ({"kind": "charuco"}, "--markers 4x5: a charuco board is described by --squares CxR"),
        ({"markers": 5}, "--markers 5: expected markers in a row and rows, such as 7x10"),
        ({"gap_m": None}, "--marker METRES and --gap METRES"),
        ({"markers": "1x1"}, "columns: expected 2 or more markers on a sheet"),
        ({"markers": "8x8"}, "4x4_50 holds 50 markers, but a sheet of 8x8 markers needs 64"),
        ({"square_m": 0.1}, "square_m: aruco boards have none: expected marker_m, gap_m"),
    ],
)
def test_options_that_do_not_describe_a_sheet_are_refused(given: Mapping[str, object], said: str) -> None:
    with pytest.raises(UserError, match=said.replace("(", r"\(")):
        board_of({**SAID, **given}, None)
    assert board_of(SAID, None) == SHEET
