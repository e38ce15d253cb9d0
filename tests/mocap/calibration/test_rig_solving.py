"""Cameras calibrated by corners with noise, against the cameras that saw them."""

from dataclasses import replace

import numpy as np
import pytest
from board_stage import centres_apart_m, ring, shown_to_neighbours, sightings_of, turn_of

from services.mocap.calibration.board import Board
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
        assert (found.name, found.width_px, found.height_px) == (true.name, 1280, 720)
    assert {(link.first, link.second) for link in solution.links} == {(a, a + 1) for a in range(7)} | {(0, 7)}


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
