"""Cameras calibrated by corners with noise, against the cameras that saw them."""

from dataclasses import replace

import numpy as np
import pytest

from board_stage import (
    Scene,
    between,
    centres_apart_m,
    look,
    picture,
    ring,
    shown_to_neighbours,
    sightings_of,
    turn_of,
    with_fisheye,
)
from services.mocap.calibration.board import Board
from services.mocap.calibration.detection import Detector
from services.mocap.calibration.mirroring import flipped
from services.mocap.calibration.rig_solving import ORIGIN_FRAME, Solution, solve_rig
from services.mocap.calibration.sightings import Sighting, Sightings
from services.mocap.camera.camera import Camera
from services.mocap.errors import CalibrationError

BOARD = Board(columns=7, rows=10, square_m=0.09)
NOISE_PX = 0.3


def solve(seen: list[Sightings]) -> Solution:
    return solve_rig(seen, BOARD, "normal", lambda _what, _share: None)


@pytest.fixture(scope="module")
def cameras() -> list[Camera]:
    return ring(8, 1280, 720, np.random.default_rng(1))


@pytest.fixture(scope="module")
def seen(cameras: list[Camera]) -> list[Sightings]:
    rng = np.random.default_rng(2)
    return sightings_of(shown_to_neighbours(cameras, BOARD, 40, rng), NOISE_PX, rng)


def focal_errors(solution: Solution, cameras: list[Camera]) -> np.ndarray:
    return np.array(
        [np.diag(f.K)[:2] / np.diag(t.K)[:2] - 1 for f, t in zip(solution.cameras, cameras, strict=True)]
    )


def test_eight_cameras_of_which_only_neighbours_share_views(
    cameras: list[Camera], seen: list[Sightings]
) -> None:
    solution = solve(seen)
    assert np.abs(focal_errors(solution, cameras)).max() < 0.003
    assert centres_apart_m(solution.cameras, cameras).max() < 0.005
    for c, (found, true) in enumerate(zip(solution.cameras, cameras, strict=True)):
        assert turn_of(found, true) < 0.002  # a pixel of the principal point weighs a thousandth
        assert solution.error_px(c) < 0.4
        assert solution.rms_px(c) == pytest.approx(NOISE_PX, rel=0.05)  # nothing but the noise is left
        assert (found.name, found.width_px, found.height_px) == (true.name, 1280, 720)
    assert {(link.first, link.second) for link in solution.links} == {(a, a + 1) for a in range(7)} | {(0, 7)}


CHESS = Board(kind="chessboard", columns=7, rows=10, square_m=0.09)


@pytest.mark.parametrize("size", [(7, 10), (10, 7)])
@pytest.mark.parametrize("n_cameras", [2, 4])
def test_mirrored_pictures_of_a_chessboard_are_said(
    cameras: list[Camera], size: tuple[int, int], n_cameras: int
) -> None:
    board = CHESS.model_copy(update={"columns": size[0], "rows": size[1]})
    some, rng = cameras[:n_cameras], np.random.default_rng(7)
    scene = shown_to_neighbours(some, board, 12, rng, closed=n_cameras > 2)
    said = "cam02: has mirrored" if n_cameras > 2 else "one of cam01 and cam02: has mirrored pictures"
    with pytest.raises(CalibrationError, match=said):
        solve_with_the_second_mirrored(scene, rng)


def test_mirrored_pictures_are_said_though_one_place_of_the_board_fits_by_chance(
    cameras: list[Camera],
) -> None:
    """The board is held still where only the mirrored camera and one beyond its neighbours see it."""
    rng = np.random.default_rng(7)
    scene = shown_to_neighbours(cameras[:4], CHESS, 12, rng)
    poses = (between(cameras[1], cameras[3], rng) for _ in range(1000))
    held = next(
        pose
        for pose in poses
        if all(
            view is not None and len(view.corners) == CHESS.n_corners
            for view in (look(cameras[c], CHESS, pose, 0.0, rng) for c in (1, 3))
        )
    )
    with pytest.raises(CalibrationError, match="cam02: has mirrored"):
        solve_with_the_second_mirrored(replace(scene, moments=[*scene.moments, *4 * [(held, (1, 3))]]), rng)


def solve_with_the_second_mirrored(scene: Scene, rng: np.random.Generator) -> None:
    seen = sightings_of(scene, NOISE_PX, rng)
    seen = [whole for s in seen if (whole := only_whole(s, scene.board)).by_frame]
    spoilt = [*seen[:1], flipped(seen[1], scene.board), *seen[2:]]
    solve_rig(spoilt, scene.board, "normal", lambda _what, _share: None)


def only_whole(sightings: Sightings, board: Board) -> Sightings:
    """A chessboard is seen as a completely or not at all."""
    kept = {f: view for f, view in sightings.by_frame.items() if len(view.corners) == board.n_corners}
    return replace(sightings, by_frame=kept)


def test_flipping_twice_is_nothing_and_flips_as_pictures_do(cameras: list[Camera]) -> None:
    """Detected in a flipped picture, a chessboard has the corners that `flipped` says."""
    board = Board(kind="chessboard", columns=5, rows=8, square_m=0.2)
    rng = np.random.default_rng(8)
    pose, _ = shown_to_neighbours(cameras[:2], board, 1, rng, closed=False).moments[0]
    shown = picture(cameras[0], board, pose, rng)
    found = [Detector(board).find(np.ascontiguousarray(p)) for p in (shown, shown[:, ::-1])]
    assert found[0] is not None
    assert found[1] is not None
    seen = Sightings("cam01", (1280, 720), {0: found[0]}, 1)
    once = flipped(seen, board)
    np.testing.assert_allclose(once.by_frame[0].points_px, found[1].points_px, atol=0.1)
    np.testing.assert_array_equal(flipped(once, board).by_frame[0].points_px, found[0].points_px)


def test_fisheye_cameras(cameras: list[Camera]) -> None:
    rng = np.random.default_rng(9)
    some = [with_fisheye(camera, rng) for camera in cameras[:3]]
    seen = sightings_of(shown_to_neighbours(some, BOARD, 40, rng, closed=False), NOISE_PX, rng)
    solution = solve_rig(seen, BOARD, "fisheye", lambda _what, _share: None)
    assert all(found.fisheye for found in solution.cameras)
    assert np.abs(focal_errors(solution, some)).max() < 0.005
    assert centres_apart_m(solution.cameras, some).max() < 0.015
    assert [solution.rms_px(c) for c in range(3)] == pytest.approx([NOISE_PX] * 3, rel=0.1)


def spoiled(sightings: Sightings, share: float, rng: np.random.Generator) -> Sightings:
    """Some sightings as of another moment, and some corners taken for others."""
    by_frame = dict(sightings.by_frame)
    for frame in [frame for frame in by_frame if frame != ORIGIN_FRAME and rng.random() < share]:
        view = by_frame[frame]
        if rng.random() < 0.5:
            by_frame[frame] = Sighting(view.corners, view.points_px + 40 * rng.standard_normal(2))
        else:
            points_px = view.points_px.copy()
            points_px[:2] += 15 * rng.standard_normal((2, 2))
            by_frame[frame] = Sighting(view.corners, points_px)
    return replace(sightings, by_frame=by_frame)


def test_bad_views_and_wrong_corners_do_no_harm(cameras: list[Camera]) -> None:
    rng = np.random.default_rng(3)
    some = cameras[:3]
    seen = sightings_of(shown_to_neighbours(some, BOARD, 40, rng, closed=False), NOISE_PX, rng)
    good, bad = solve(seen), solve([spoiled(s, 0.15, rng) for s in seen])
    assert sum(bad.n_bad_views) >= 10
    assert centres_apart_m(bad.cameras, good.cameras).max() < 0.005
    assert centres_apart_m(bad.cameras, some).max() < 0.012  # an open chain of three, all the same
    assert np.abs(focal_errors(bad, some)).max() < 0.003
    assert max(bad.error_px(c) for c in range(3)) < 0.4


def test_cameras_that_share_nothing_are_named(seen: list[Sightings]) -> None:
    def kept(sightings: Sightings, frames: range) -> Sightings:
        views = {f: v for f, v in sightings.by_frame.items() if f in frames or f == ORIGIN_FRAME}
        return replace(sightings, by_frame=views)

    apart = [kept(s, range(80)) if c < 3 else kept(s, range(120, 200)) for c, s in enumerate(seen[:6])]
    with pytest.raises(CalibrationError, match=r"cam04, cam05, cam06: never .* as cam01, cam02, cam03"):
        solve(apart)


def test_clips_of_other_moments_are_noticed(seen: list[Sightings]) -> None:
    def later(sightings: Sightings, frames: int) -> Sightings:
        moved = {f if f == ORIGIN_FRAME else f + frames: view for f, view in sightings.by_frame.items()}
        return replace(sightings, by_frame=moved)

    with pytest.raises(
        CalibrationError, match=r"cam01 and cam02: .* check that their clips show the same moments"
    ):
        solve([seen[0], later(seen[1], 5)])


def test_too_few_views_are_said(seen: list[Sightings]) -> None:
    few = dict(list(seen[0].by_frame.items())[:4])
    with pytest.raises(CalibrationError, match="cam01: only 4 views"):
        solve([replace(seen[0], by_frame=few), seen[1]])
