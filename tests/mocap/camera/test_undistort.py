from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from distorted_cameras import CAMERA, LENSES
from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import Undistorter
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Bytes, Floats

# nine points of a wall, far enough apart that their dots do not touch
WALL_M: Floats = np.array([[x, y, 0.0] for x in (-0.9, 0.0, 0.8) for y in (-0.5, 0.2, 0.8)])


def raw_pixels(camera: Camera, points_world_m: Floats) -> Floats:
    """OpenCV's own projection through the lens."""
    # cv2.Rodrigues loses tiny angles on the way from a matrix.
    rotation = Rotation.from_matrix(camera.R_camera_world).as_rotvec()
    project = cv2.fisheye.projectPoints if camera.fisheye else cv2.projectPoints
    args = (rotation, camera.t_camera_world_m, camera.K, camera.distortion)
    return np.asarray(project(points_world_m[:, None], *args)[0], np.float64).reshape(-1, 2)


def dots(camera: Camera, centres_px: Floats) -> Floats:
    """Soft dots, brightest at sub-pixel places."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    squares = (u - centres_px[:, 0, None, None]) ** 2 + (v - centres_px[:, 1, None, None]) ** 2
    return np.asarray(np.exp(-squares / (2 * 3.0**2)).sum(axis=0))


def centroids(picture: Floats | Bytes, near_px: Floats) -> Floats:
    found = []
    for x, y in np.rint(near_px).astype(int):
        window = picture[y - 8 : y + 9, x - 8 : x + 9].astype(float)
        v, u = np.mgrid[y - 8 : y + 9, x - 8 : x + 9]
        found.append([(window * u).sum() / window.sum(), (window * v).sum() / window.sum()])
    return np.array(found)


@given(
    st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3),
)
def test_pinhole_projection_is_opencvs(rotation: list[float], translation_m: list[float]) -> None:
    camera = replace(
        CAMERA,
        distortion=np.zeros(4),
        R_camera_world=Rotation.from_rotvec(rotation).as_matrix(),
        t_camera_world_m=np.array(translation_m),
    )
    points_camera_m = np.random.default_rng(0).uniform([-1, -1, 0.5], [1, 1, 4], (20, 3))
    points_world_m = (points_camera_m - camera.t_camera_world_m) @ camera.R_camera_world
    np.testing.assert_allclose(
        camera.project_px(points_world_m), raw_pixels(camera, points_world_m), atol=1e-6
    )


@pytest.mark.parametrize("camera", LENSES.values(), ids=LENSES)
def test_what_the_lens_moved_comes_back_to_where_the_pinhole_sees_it(camera: Camera) -> None:
    raw_px, pinhole_px = raw_pixels(camera, WALL_M), camera.undistorted().project_px(WALL_M)
    assert np.abs(raw_px - pinhole_px).max() > 1.0  # else the test shows nothing
    grey = (255 * dots(camera, raw_px)).astype(np.uint8)
    undistorted = Undistorter(camera).image(np.repeat(grey[..., None], 3, axis=2))
    assert undistorted.shape == (240, 320, 3)
    assert undistorted.dtype == np.uint8
    np.testing.assert_allclose(centroids(undistorted[..., 1], pinhole_px), pinhole_px, atol=0.15)


@pytest.mark.parametrize("camera", LENSES.values(), ids=LENSES)
def test_a_silhouettes_outline_goes_where_the_pinhole_sees_it(camera: Camera) -> None:
    corners_m = np.array([[-0.6, -0.4, 0.0], [0.7, -0.3, 0.0], [0.6, 0.6, 0.0], [-0.5, 0.7, 0.0]])
    outline_m = np.concatenate(
        [
            np.linspace(a, b, 60, endpoint=False)
            for a, b in zip(corners_m, np.roll(corners_m, -1, 0), strict=True)
        ]
    )
    raw, ideal = np.zeros((240, 320), np.uint8), np.zeros((240, 320), np.uint8)
    cv2.fillPoly(raw, [np.rint(raw_pixels(camera, outline_m)).astype(np.int32)], 1)
    cv2.fillPoly(ideal, [np.rint(camera.undistorted().project_px(outline_m)).astype(np.int32)], 1)
    silhouette = Undistorter(camera).mask(raw > 0)
    assert silhouette.dtype == np.bool_
    assert np.count_nonzero(silhouette != (ideal > 0)) < 0.03 * np.count_nonzero(ideal)


def test_a_pinholes_pictures_are_passed_through() -> None:
    undistorter = Undistorter(CAMERA.undistorted())
    picture, silhouette = np.zeros((240, 320, 3), np.uint8), np.zeros((240, 320), np.bool_)
    assert undistorter.image(picture) is picture
    assert undistorter.mask(silhouette) is silhouette


def test_nothing_is_seen_past_the_raw_pictures_border() -> None:
    pincushion = replace(CAMERA, distortion=np.array([0.3, 0.0, 0.0, 0.0]))
    silhouette = Undistorter(pincushion).mask(np.ones((240, 320), np.bool_))
    assert not silhouette[0, 0]
    assert silhouette[120, 160]


@pytest.mark.parametrize("camera", [CAMERA, CAMERA.undistorted()])
def test_a_picture_of_another_size_is_refused(camera: Camera) -> None:
    with pytest.raises(ValueError, match=r"cam01: expected a picture of \(height, width\) \(240, 320\)"):
        Undistorter(camera).image(np.zeros((320, 240, 3), np.uint8))


@pytest.mark.parametrize("camera", LENSES.values(), ids=LENSES)
@given(st.integers(-30, 350), st.integers(-30, 270), st.integers(0, 90))
def test_a_silhouette_comes_out_as_if_the_whole_picture_were_undistorted(
    camera: Camera, x_px: int, y_px: int, radius_px: int
) -> None:
    disc = np.zeros(camera.shape_px, np.uint8)
    cv2.circle(disc, (x_px, y_px), radius_px, 255, cv2.FILLED)
    undistorter = Undistorter(camera)
    whole = undistorter.image(np.repeat(disc[..., None], 3, axis=2))[..., 0] > 127
    assert np.array_equal(undistorter.mask(disc > 0), whole)


@pytest.mark.parametrize("camera", [*LENSES.values(), CAMERA.undistorted()])
@given(seed=st.integers(0, 1000))
def test_a_trimap_is_sure_of_what_it_is_whatever_unsure_pixels_are(camera: Camera, seed: int) -> None:
    rng, undistorter = np.random.default_rng(seed), Undistorter(camera)
    coarse = rng.choice(np.array([BACKGROUND, UNSURE, ACTOR], np.uint8), (12, 16))
    trimap = np.ascontiguousarray(coarse.repeat(20, axis=0).repeat(20, axis=1))
    found = undistorter.trimap(trimap)
    assert np.array_equal(found == ACTOR, undistorter.mask(trimap == ACTOR))
    assert np.array_equal(found == BACKGROUND, ~undistorter.mask(trimap != BACKGROUND))
    filled = np.where(
        trimap == UNSURE, rng.choice(np.array([BACKGROUND, ACTOR], np.uint8), trimap.shape), trimap
    )
    sure = found != UNSURE
    assert np.array_equal(undistorter.trimap(filled)[sure], found[sure])


@pytest.mark.parametrize("camera", LENSES.values(), ids=LENSES)
def test_numbers_are_those_of_the_nearest_pixels(camera: Camera) -> None:
    """On ramps they are what interpolation gives, rounded: no further off, and off to neither side."""
    for places_px in np.mgrid[:240, :320]:
        ramp = np.clip(places_px - 20, 0, 255).astype(np.uint8)
        interpolated = Undistorter(camera).image(np.repeat(ramp[..., None], 3, axis=2))[..., 0]
        inside = (interpolated > 1) & (interpolated < 254)
        off = (Undistorter(camera).numbers(ramp).astype(int) - interpolated)[inside]
        assert np.abs(off).max() <= 1
        assert abs(off.mean()) < 0.05
