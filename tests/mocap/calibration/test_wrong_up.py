"""A calibration whose world has another axis that points up than it says."""

import numpy as np
import pytest

from board_stage import ring
from services.mocap.calibration.mistakes import wrong_up
from services.mocap.camera.camera import R_ZUP_YUP, Camera
from services.mocap.types import Floats


def turned_round_its_axis(camera: Camera, quarter_turns: int) -> Camera:
    """The camera, held on its side."""
    roll: Floats = np.linalg.matrix_power(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), quarter_turns)
    R = roll @ camera.R_camera_world
    return Camera(camera.name, *camera.size_px, camera.K, camera.distortion, R, -R @ camera.centre_world_m)


@pytest.mark.parametrize("of", [4, 8])
@pytest.mark.parametrize("n", [3, 4])
def test_another_axis_is_noticed(n: int, of: int) -> None:
    cameras = ring(n, 640, 480, np.random.default_rng(n), of)
    assert wrong_up(cameras, "z") is None
    mistake = wrong_up([camera.with_world_turned(R_ZUP_YUP.T) for camera in cameras], "z")
    assert mistake is not None
    assert mistake.remedy == 'write up = "y"'


def test_another_axis_is_noticed_of_cameras_in_a_row_at_different_heights() -> None:
    level = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # they look along y
    centres_m = ((-1.5, -3.0, 1.0), (0.0, -3.1, 2.0), (1.5, -3.0, 1.0))
    row = [Camera("cam", 640, 480, np.eye(3), np.zeros(4), level, -level @ np.array(m)) for m in centres_m]
    assert wrong_up(row, "z") is None
    for turn, up in ((R_ZUP_YUP.T, "z"), (R_ZUP_YUP, "y")):
        seen = [camera.with_world_turned(turn) for camera in row]
        looks_down = np.median([camera.R_camera_world[2, 2] for camera in seen]) < 0
        assert (wrong_up(seen, up) is None) == looks_down  # they may hang under the ceiling


@pytest.mark.parametrize("quarter_turns", [1, 3])
@pytest.mark.parametrize("round_deg", range(0, 360, 45))
def test_cameras_on_their_sides_are_no_wrong_axis(quarter_turns: int, round_deg: int) -> None:
    """Three beside each other, that stand upright if another axis points up."""
    c, s = np.cos(np.radians(round_deg)), np.sin(np.radians(round_deg))
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    cameras = [
        turned_round_its_axis(camera, quarter_turns).with_world_turned(turn)
        for camera in ring(3, 640, 480, np.random.default_rng(1), of=16)
    ]
    assert wrong_up(cameras, "z") is None
