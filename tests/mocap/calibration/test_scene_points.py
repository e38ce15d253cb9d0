"""Measured points of the scene: cameras placed by them, and calibrations moved to their world."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from board_stage import centres_apart_m, distorted_px, ring, turn_of, with_fisheye
from services.commands.calibrate.points import in_world_of, place_by_points
from services.mocap.calibration.placing import moved_to_points, read_points
from services.mocap.camera.calibration import read_calibration, write_calibration
from services.mocap.camera.camera import Camera
from services.mocap.errors import TakeError
from services.mocap.types import Floats

NOISE_PX = 0.5
POINTS_M = np.array(
    [[0, 0, 0], [1, 0, 0], [0, 1.2, 0], [-1, -1, 0], [0.5, -0.5, 0.8], [-0.6, 0.4, 1.5], [0.1, 0.9, 1.1]]
)


@pytest.fixture(scope="module")
def cameras() -> list[Camera]:
    rng = np.random.default_rng(3)
    return [*ring(2, 1280, 720, rng, of=6), replace(with_fisheye(ring(3, 1280, 720, rng, of=6)[2], rng))]


def table(folder: Path, cameras: list[Camera], points_m: Floats, shift_of_first_px: float = 0.0) -> Path:
    """A table of points in all cameras' pictures, picked with some noise."""
    rng, rows = np.random.default_rng(4), ["camera,u,v,x,y,z"]
    for camera in cameras:
        pixels = distorted_px(camera, points_m) + NOISE_PX * rng.standard_normal((len(points_m), 2))
        pixels[0] += shift_of_first_px
        for pixel, point_m in zip(pixels, points_m, strict=True):
            rows.append(",".join([camera.name, *(f"{value:.3f}" for value in (*pixel, *point_m))]))
    (folder / "points.csv").write_text("\n".join(rows) + "\n")
    return folder / "points.csv"


def elsewhere(camera: Camera, scale: float = 1.0) -> Camera:
    """The camera of a calibration with another origin and other axes, and other lengths."""
    turn = Rotation.from_euler("xyz", [40, -20, 110], degrees=True).as_matrix()
    shift_m = np.array([0.7, -1.1, 0.4])
    R = camera.R_camera_world @ turn
    return replace(camera, R_camera_world=R, t_camera_world_m=scale * (camera.t_camera_world_m + R @ shift_m))


def test_cameras_are_placed_by_points_and_their_lenses(
    cameras: list[Camera], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_calibration(tmp_path / "lenses.toml", tuple(elsewhere(camera) for camera in cameras), "z")
    out = tmp_path / "calibration.toml"
    place_by_points(table(tmp_path, cameras, POINTS_M), tmp_path / "lenses.toml", out, "z")
    found = read_calibration(out, "z")
    assert centres_apart_m(found, cameras).max() < 0.02
    assert max(turn_of(*pair) for pair in zip(found, cameras, strict=True)) < np.radians(0.3)
    assert "cam03" in capsys.readouterr().out


@pytest.mark.parametrize("scale", [1.0, 1.05])
def test_a_calibration_is_moved_to_the_points_and_its_scale_is_compared(
    cameras: list[Camera], tmp_path: Path, scale: float
) -> None:
    points = read_points(table(tmp_path, cameras, POINTS_M), [camera.name for camera in cameras])
    moved, remarks = in_world_of([elsewhere(camera, scale) for camera in cameras], points)
    placed = moved_to_points([elsewhere(camera, scale) for camera in cameras], points)
    assert placed.scale == pytest.approx(scale, abs=0.003)
    if scale == 1.0:
        assert centres_apart_m(moved, cameras).max() < 0.02
        assert placed.errors_mm.max() < 8
        assert not remarks
    else:
        assert "--scale 0.95" in " ".join(remarks)


def test_a_point_that_was_picked_wrongly_is_named(cameras: list[Camera], tmp_path: Path) -> None:
    points = read_points(table(tmp_path, cameras, POINTS_M, shift_of_first_px=40.0))
    assert "line 2: is 0." in moved_to_points(cameras, points).remarks[0]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("cam07,1,2,0,0,0", "line 2: camera: unknown cam07: did you mean cam0"),
        ("cam01,1,a,0,0,0", "line 2: v: expected a finite number"),
        ("cam01,9,9,0,0,0\ncam02,9,9,0,0,0", "1 points are in two or more cameras' pictures: expected 3"),
    ],
)
def test_tables_that_cannot_be_used_are_refused(
    cameras: list[Camera], tmp_path: Path, rows: str, said: str
) -> None:
    path = tmp_path / "points.csv"
    path.write_text(f"camera,u,v,x,y,z\n{rows}\n")
    with pytest.raises(TakeError, match=said):
        moved_to_points(cameras, read_points(path, [camera.name for camera in cameras]))


def test_points_on_one_line_are_refused(cameras: list[Camera], tmp_path: Path) -> None:
    line_m = np.linspace([0, 0, 0], [1, 1, 0], 5)
    write_calibration(tmp_path / "lenses.toml", tuple(cameras), "z")
    with pytest.raises(TakeError, match="cam01: has 5 points: expected 4 or more that are not on one line"):
        place_by_points(
            table(tmp_path, cameras, line_m), tmp_path / "lenses.toml", tmp_path / "out.toml", "z"
        )
