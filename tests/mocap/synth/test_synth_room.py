import numpy as np
import pytest

from services.mocap.synth.room import LIGHT_WORLD, room_patches, view_room
from services.mocap.synth.studio import studio_cameras

CAMERAS = studio_cameras(3, 80, 60)


def test_one_seed_is_one_room() -> None:
    one, again = (view_room(CAMERAS[0], room_patches(5), 5) for _ in range(2))
    np.testing.assert_array_equal(one.picture, again.picture)
    other = view_room(CAMERAS[0], room_patches(6), 6)
    assert np.abs(one.picture - other.picture).mean() > 3


@pytest.mark.parametrize("seed", range(5))
def test_fills_the_picture_with_texture_in_range(seed: int) -> None:
    for camera in CAMERAS:
        view = view_room(camera, room_patches(seed), seed)
        assert view.picture.shape == (60, 80, 3)
        assert view.picture.min() > 5  # every ray hits something, and nothing is crushed …
        assert view.picture.max() < 250  # … or burnt out
        assert view.picture.std(axis=(0, 1)).min() > 4
        assert 0.3 < view.floor_share.mean() < 0.9


def test_floor_points_project_to_their_pixels() -> None:
    for camera in CAMERAS:
        view = view_room(camera, room_patches(0), 0)
        y, x = np.nonzero(view.floor_share == 1)
        floor_world_m = np.column_stack([view.floor_world_m[y, x], np.zeros(len(x))])
        np.testing.assert_allclose(camera.project_px(floor_world_m), np.column_stack([x, y]), atol=1e-3)


def test_nothing_stands_on_the_stage() -> None:
    for seed in range(20):
        for patch in room_patches(seed)[1:]:
            shares = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
            corners_m = patch.corner_world_m[:2] + shares @ patch.edges_world_m[:, :2]
            assert np.abs(corners_m).max(axis=1).min() > 3.6
            assert np.hypot(*corners_m.T).min() > 4.5  # nor before a camera


def test_the_light_comes_from_above() -> None:
    assert np.linalg.norm(LIGHT_WORLD) == pytest.approx(1.0)
    assert np.degrees(np.arcsin(LIGHT_WORLD[2])) == pytest.approx(60, abs=1)
