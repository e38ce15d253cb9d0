"""Where points lie in raw pictures: against OpenCV's own projection, lens distortion included."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rig_scene import ring

from services.mocap.camera.camera import Camera
from services.mocap.types import Floats
from services.segmentation.floor_shadow import Floor
from services.segmentation.lenses import NOWHERE, Lenses, raw_pixel, rays_of

PINHOLE, BENT, FISHEYE = range(3)


def camera_of(kind: int, k: int = 0) -> Camera:
    camera = ring(3)[k]
    if kind == BENT:
        return replace(camera, distortion=np.array([-0.12, 0.06, 0.002, -0.001]))
    if kind == FISHEYE:
        return replace(camera, distortion=np.array([0.05, -0.02, 0.01, -0.004]), fisheye=True)
    return camera


def opencv_px(camera: Camera, points_m: Floats) -> Floats:
    """(N, 2) raw pixels of points (N, 3) in the world."""
    turn, shift = cv2.Rodrigues(camera.R_camera_world)[0], camera.t_camera_world_m
    if camera.fisheye:
        found = cv2.fisheye.projectPoints(points_m[:, None], turn, shift, camera.K, camera.distortion)[0]
    else:
        found = cv2.projectPoints(points_m, turn, shift, camera.K, camera.distortion)[0]
    return np.asarray(found, np.float64).reshape(-1, 2)


def found_px(lenses: Lenses, c: int, point_m: Floats) -> tuple[int, int]:
    x, y, z = map(float, point_m)
    return raw_pixel(lenses.P_px_world[c], lenses.sizes_px[c], lenses.raw_px[c], x, y, z)


coordinates = st.floats(-1.0, 1.0)


@pytest.mark.parametrize("kind", [PINHOLE, BENT, FISHEYE])
@given(x=coordinates, y=coordinates, z=st.floats(0.0, 1.9), k=st.integers(0, 2))
def test_a_point_lies_where_opencv_projects_it(kind: int, x: float, y: float, z: float, k: int) -> None:
    camera = camera_of(kind, k)
    point_m = np.array([x, y, z])
    found = found_px(Lenses.of([camera]), 0, point_m)
    expected = opencv_px(camera, point_m[None])[0]
    size_px = np.array([camera.width_px, camera.height_px])
    if found[0] == NOWHERE:  # an undistorted picture of the same size shows a little less than the raw one
        flat = camera.project_px(point_m)
        assert (flat < 0).any() or (flat > size_px - 1).any() or (expected < 1).any()
    else:
        np.testing.assert_allclose(found, expected, atol=1.0)


@pytest.mark.parametrize("kind", [PINHOLE, BENT, FISHEYE])
@given(column=st.integers(20, 219), row=st.integers(20, 159), far_m=st.floats(0.5, 20.0))
def test_a_ray_goes_back_to_its_pixel(kind: int, column: int, row: int, far_m: float) -> None:
    camera = camera_of(kind)
    centre_m, rays = rays_of(camera)
    point_m = centre_m + far_m * rays[row, column]
    np.testing.assert_allclose(opencv_px(camera, point_m[None])[0], (column, row), atol=0.01)


def test_what_is_behind_a_camera_is_nowhere() -> None:
    camera = camera_of(PINHOLE)
    ahead = camera.R_camera_world[2]
    lenses = Lenses.of([camera])
    assert found_px(lenses, 0, camera.centre_world_m + 2 * ahead) != (NOWHERE, NOWHERE)
    assert found_px(lenses, 0, camera.centre_world_m - 2 * ahead) == (NOWHERE, NOWHERE)


def test_smaller_pictures_have_nothing_outside() -> None:
    cameras = [ring(2)[0], ring(2, 160, 120)[1]]
    lenses = Lenses.of(cameras)
    assert len(lenses.sizes_px) == 2
    assert lenses.raw_px.shape == (2, 180, 240, 2)
    assert (lenses.raw_px[1, 120:] == NOWHERE).all()
    assert (lenses.raw_px[1, :, 160:] == NOWHERE).all()
    rows, columns = np.mgrid[:120, :160]
    np.testing.assert_array_equal(lenses.raw_px[1, :120, :160], np.stack([columns, rows], axis=-1))


@pytest.mark.parametrize("kind", [PINHOLE, BENT, FISHEYE])
@given(column=st.integers(20, 219), row=st.integers(20, 159), height_m=st.floats(-0.5, 0.8))
def test_a_place_on_the_floor_lies_at_the_pixel_that_looks_there(
    kind: int, column: int, row: int, height_m: float
) -> None:
    camera = camera_of(kind)
    place_m = Floor.at(height_m, [camera]).places_m[0][row, column]
    if np.isnan(place_m).any():
        along = rays_of(camera)[1][row, column]
        assert (height_m - camera.centre_world_m[2]) / along[2] < 0 or np.isclose(along[2], 0, atol=0.1)
        return
    point_m = np.array([*place_m, height_m], np.float64)
    np.testing.assert_allclose(opencv_px(camera, point_m[None])[0], (column, row), atol=0.05)
    found = found_px(Lenses.of([camera]), 0, point_m)
    if found[0] != NOWHERE:
        np.testing.assert_allclose(found, (column, row), atol=1.0)
