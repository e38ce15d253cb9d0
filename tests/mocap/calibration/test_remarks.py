"""What is said of calibrated cameras that are not certainly wrong."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from board_stage import ring, shown_to_neighbours, sightings_of
from services.mocap.calibration.board import Board
from services.mocap.calibration.coverage import draw_coverage
from services.mocap.calibration.remarks import remarks_on, remarks_on_views
from services.mocap.calibration.rig_solving import Solution, solve_rig

BOARD = Board(columns=5, rows=7, square_m=0.2, dictionary="4x4_50")


@pytest.fixture(scope="module")
def solution() -> Solution:
    rng = np.random.default_rng(5)
    scene = shown_to_neighbours(ring(3, 1200, 900, rng, of=8), BOARD, 8, rng, closed=False)
    return solve_rig(sightings_of(scene, 0.3, rng), BOARD, "normal", lambda _what, _share: None)


def with_errors(solution: Solution, errors_px: Sequence[float], larger: float = 1.0) -> Solution:
    """The same with other mean errors of the cameras, whose pictures are so many times as large."""
    factors = np.array([error / solution.error_px(c) for c, error in enumerate(errors_px)])
    residuals_px = solution.residuals_px * factors[solution.corners.camera][:, None]
    cameras = tuple(
        replace(c, width_px=round(larger * c.width_px), height_px=round(larger * c.height_px))
        for c in solution.cameras
    )
    corners = replace(solution.corners, points_px=larger * solution.corners.points_px)
    return replace(solution, cameras=cameras, corners=corners, residuals_px=residuals_px)


@pytest.mark.parametrize(
    ("errors_px", "larger", "named"),
    [
        ((0.99, 0.99, 0.99), 1.0, None),
        ((1.2, 0.8, 1.07), 1.0, "cam01 (1.20 px), cam03 (1.07 px)"),
        ((1.2, 1.9, 1.07), 32 / 15, None),  # 2560 pixels wide, twice as many as takes keep
        ((1.2, 2.1, 1.07), 32 / 15, "cam02 (2.10 px)"),
        ((0.3, 0.3, 1.2), 32 / 15, "cam03 (1.20 px)"),  # much more than the others
    ],
)
def test_cameras_with_large_errors_are_named_in_one_sentence(
    solution: Solution, errors_px: Sequence[float], larger: float, named: str | None
) -> None:
    remarks = remarks_on_views(with_errors(solution, errors_px, larger))
    about = [remark for remark in remarks if "corners are off" in remark]
    assert [remark.partition(": ")[0] for remark in about] == [named] * (named is not None)
    assert all("record it again: near, all over the picture" in remark for remark in about)


def test_cameras_that_saw_the_board_in_a_part_of_the_picture_are_named_in_one_sentence(
    solution: Solution,
) -> None:
    assert not any("the board was seen in" in remark for remark in remarks_on_views(solution))
    shrunk = solution.corners.points_px * np.where(solution.corners.camera == 2, 1.0, 0.4)[:, None]
    seen = replace(solution, corners=replace(solution.corners, points_px=shrunk))
    full, simple, held = (
        replace(solution.lenses[0], free=free) for free in ((True,) * 9, (True, *(False,) * 8), (False,) * 9)
    )
    for lenses, named, model in (
        ((full, full, full), ["cam01", "cam02"], "elsewhere: "),
        ((simple, simple, full), ["cam01", "cam02"], "elsewhere (a simple lens model was chosen): "),
        ((full, simple, full), ["cam01", "cam02"], "elsewhere (a simple lens model was chosen for cam02): "),
        ((held, full, full), ["cam02"], "elsewhere: "),
    ):
        (said,) = remarks_on_views(replace(seen, lenses=lenses))
        assert [name.split(" (")[0] for name in said.partition(": ")[0].split(", ")] == named
        assert model in said


def test_where_the_floor_is_not_known_no_camera_is_under_it(solution: Solution) -> None:
    sunk = [
        replace(camera, t_camera_world_m=camera.t_camera_world_m + camera.R_camera_world @ (0.0, 0.0, 4.0))
        for camera in solution.cameras
    ]
    assert [remark.split(" ")[1] for remark in remarks_on(sunk)] == ["stands"] * len(sunk)
    assert remarks_on(sunk, is_floor_known=False) == []


def test_the_picture_of_a_calibration_shows_the_board_under_the_corners(solution: Solution) -> None:
    dark, white = draw_coverage(solution), np.full((900, 1200), 255, np.uint8)
    shown = draw_coverage(replace(solution, pictures=(white, None, np.dstack([white] * 3))))
    half = draw_coverage(replace(solution, pictures=(white, None, None)))
    changed = (shown != dark).any(axis=2)
    assert np.mean(shown[changed] == 140) > 0.95, "white, darkened, but for the edges of dots"
    assert np.count_nonzero(shown.max(axis=2) > 200) >= np.count_nonzero(dark.max(axis=2) > 200)
    assert 0 < np.count_nonzero((half != dark).any(axis=2)) < np.count_nonzero(changed)
