"""A simpler lens is chosen where the views cover little of a picture; a clip of its own for a lens helps."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from board_stage import Scene, look, ring, shown_to_neighbours, write_pictures
from services.mocap.calibration.board import Board
from services.mocap.calibration.from_clips import calibrate_clips
from services.mocap.calibration.lens import estimate_intrinsics
from services.mocap.calibration.rigid_transform import RigidTransform
from services.mocap.calibration.sightings import Sightings
from services.mocap.camera.camera import Camera

BOARD = Board(columns=7, rows=10, square_m=0.09)
NOISE_PX = 0.3


def _held_up(camera: Camera, at_m: Sequence[float], tilt_rad: float, turn_rad: float) -> RigidTransform:
    """T_world_board of a board with its middle at a place in a camera's axes, tilted away from it."""
    facing = Rotation.from_euler("x", np.pi)  # the print towards the camera
    tilt = Rotation.from_rotvec(tilt_rad * np.array([np.cos(turn_rad), np.sin(turn_rad), 0.0]))
    R_camera_board = (tilt * facing).as_matrix()
    middle_m = BOARD.outline_m.mean(axis=0)
    R = camera.R_camera_world.T
    return RigidTransform(
        R @ R_camera_board,
        R @ (np.asarray(at_m) - R_camera_board @ middle_m - camera.t_camera_world_m),
    )


def _before(camera: Camera, n: int, aside: float, rng: np.random.Generator) -> list[RigidTransform]:
    """Boards at 2.2 to 2.8 m, as far aside as a share of what is in the picture there."""
    held = []
    for _ in range(n):
        depth_m = rng.uniform(2.2, 2.8)
        half_m = depth_m * np.array([camera.width_px, camera.height_px]) / 2 / camera.K[0, 0]
        x_m, y_m = aside * half_m * rng.uniform(-1, 1, 2)
        held.append(_held_up(camera, (x_m, y_m, depth_m), rng.uniform(0.2, 0.7), rng.uniform(0, 2 * np.pi)))
    return held


@pytest.mark.parametrize(("aside", "is_simple"), [(0.1, True), (0.8, False)], ids=["middle", "everywhere"])
def test_the_lens_is_as_simple_as_its_views_allow(aside: float, is_simple: bool) -> None:
    rng = np.random.default_rng(3)
    (camera,) = ring(1, 1280, 720, rng)
    views = [look(camera, BOARD, pose, NOISE_PX, rng) for pose in _before(camera, 24, aside, rng)]
    by_frame = {n: view for n, view in enumerate(views) if view is not None}
    assert len(by_frame) >= 12
    lens, _ = estimate_intrinsics(
        Sightings(camera.name, camera.size_px, by_frame, len(views)), BOARD, "normal"
    )
    assert lens.is_simple == is_simple
    fx, fy = lens.values[:2]
    if is_simple:
        assert fx == fy
    assert abs(fx / camera.K[0, 0] - 1) < (0.02 if is_simple else 0.005)


def test_a_clip_for_the_lens_alone_gives_its_full_model(tmp_path: Path) -> None:
    """Few views are shared by both cameras; those of intrinsics/ are near, and each is seen by one."""
    rng = np.random.default_rng(4)
    cameras = ring(2, 960, 720, rng, of=8)
    scene = shown_to_neighbours(cameras, BOARD, 14, rng, closed=False)
    write_pictures(tmp_path, scene, rng)

    def lenses() -> list[np.ndarray]:
        solution, _ = calibrate_clips(
            tmp_path, BOARD, "normal", lambda _what, _share: None, needs_origin=False
        )
        return [found.K for found in solution.cameras]

    alone = lenses()
    for c, camera in enumerate(cameras):
        held = [(pose, (c,)) for pose in _before(camera, 20, 0.8, rng)]
        write_pictures(tmp_path / "intrinsics", Scene(cameras, BOARD, held), rng)
    together = lenses()

    def worst(found: list[np.ndarray]) -> float:
        pairs = zip(found, cameras, strict=True)
        return max(float(np.abs(np.diag(K)[:2] / np.diag(true.K)[:2] - 1).max()) for K, true in pairs)

    assert worst(together) < 0.005
    assert worst(together) < worst(alone)
