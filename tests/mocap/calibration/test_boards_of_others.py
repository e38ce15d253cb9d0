"""Boards as people have them: white on black, printed on both sides, without an origin, with known lenses."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from board_stage import FLAT, picture, ring, shown_to_neighbours, sightings_of
from services.mocap.calibration.board import Board, drawn
from services.mocap.calibration.detection import Detector
from services.mocap.calibration.known_lenses import check_lens_sizes, known_lenses
from services.mocap.calibration.remarks import remarks_on_views
from services.mocap.calibration.rig_solving import ORIGIN_FRAME, solve_rig
from services.mocap.camera.calibration import write_calibration
from services.mocap.camera.camera import Camera
from services.mocap.errors import CalibrationError
from services.mocap.types import Bytes

BOARD = Board(columns=5, rows=7, square_m=0.2, marker_m=0.15, dictionary="4x4_50")


def quiet(_what: str, _share: float) -> None:
    """Nothing is shown."""


@pytest.fixture(scope="module")
def shown() -> tuple[Camera, Bytes]:
    """A camera, and its picture of the board on the floor."""
    rng = np.random.default_rng(3)
    (camera,) = ring(1, 900, 700, rng, of=8)
    return camera, picture(camera, BOARD, FLAT, rng)


def test_a_board_that_is_white_on_black_has_its_corners_in_the_same_places(
    shown: tuple[Camera, Bytes],
) -> None:
    plain = Detector(BOARD).find(shown[1])
    inverted = Detector(BOARD.model_copy(update={"inverted": True}))
    assert plain is not None
    assert inverted.find(shown[1]) is None
    found = inverted.find(255 - shown[1])
    assert found is not None
    np.testing.assert_array_equal(found.corners, plain.corners)
    np.testing.assert_allclose(found.points_px, plain.points_px, atol=0.1)
    np.testing.assert_array_equal(drawn(inverted.board, 8), 255 - drawn(BOARD, 8))


def test_the_back_of_a_board_has_the_corners_of_its_front(shown: tuple[Camera, Bytes]) -> None:
    front = Detector(BOARD).find(shown[1])
    back = Detector(BOARD).find(np.ascontiguousarray(shown[1][:, ::-1]))
    assert front is not None
    assert back is not None
    assert (front.is_behind, back.is_behind) == (False, True)
    np.testing.assert_array_equal(back.corners, front.corners)
    np.testing.assert_allclose(shown[1].shape[1] - 1 - back.points_px[:, 0], front.points_px[:, 0], atol=0.1)


def test_known_lenses_are_held_and_an_origin_is_not_needed(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    scene = shown_to_neighbours(ring(3, 1200, 900, rng, of=8), BOARD, 8, rng, closed=False)
    seen = sightings_of(scene, 0.3, rng)
    for sightings in seen:
        sightings.by_frame.pop(ORIGIN_FRAME, None)  # type: ignore[attr-defined]
    path = tmp_path / "lenses.toml"
    write_calibration(path, tuple(scene.cameras), "z")
    known = known_lenses(path, [camera.name for camera in scene.cameras])
    check_lens_sizes(known, dict.fromkeys(known, (1200, 900)))
    with pytest.raises(
        CalibrationError, match="cam03: the lens is for 1200x900 pixels, but the clip has 8x6:"
    ):
        check_lens_sizes(known, {camera: (8, 6) if camera == "cam03" else (1200, 900) for camera in known})
    solution = solve_rig(seen, BOARD, "normal", quiet, known, level="cam02")
    for found, true in zip(solution.cameras, scene.cameras, strict=True):
        np.testing.assert_array_equal(found.K, true.K)
        np.testing.assert_array_equal(found.distortion, true.distortion)
    found_m, true_m = (
        pdist([camera.centre_world_m for camera in cameras]) for cameras in (solution.cameras, scene.cameras)
    )
    np.testing.assert_allclose(found_m, true_m, rtol=0.005)
    assert solution.cameras[1].R_camera_world[1] == pytest.approx([0, 0, -1], abs=1e-9)  # down is down
    assert not any("covered" in remark or "--lens" in remark for remark in remarks_on_views(solution))
