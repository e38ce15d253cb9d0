from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from distorted_cameras import CAMERA
from services.mocap.camera.undistort import reduce_picture, resized_trimap
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Trimap

STATES = np.array([BACKGROUND, UNSURE, ACTOR], np.uint8)


@pytest.mark.parametrize(
    ("size_px", "longest_side_px", "reduced_px"),
    [
        ((3840, 2160), 1280, (1280, 720)),
        ((1080, 1920), 1280, (720, 1280)),
        ((4096, 2160), 1280, (1280, 675)),
        ((1280, 720), 1280, (1280, 720)),
        ((320, 240), 1280, (320, 240)),
        ((4000, 1), 32, (32, 1)),
    ],
)
def test_the_longer_side_is_reduced_to_a_number_of_pixels(
    size_px: tuple[int, int], longest_side_px: int, reduced_px: tuple[int, int]
) -> None:
    camera = replace(CAMERA, width_px=size_px[0], height_px=size_px[1])
    reduced = camera.reduced(longest_side_px)
    assert reduced.size_px == reduced_px
    assert (reduced is camera) == (size_px == reduced_px)


@pytest.mark.parametrize("is_fisheye", [False, True])
@given(width_px=st.integers(2, 900), height_px=st.integers(2, 900))
def test_a_resized_camera_sees_a_point_at_the_same_share_of_its_picture(
    is_fisheye: bool, width_px: int, height_px: int
) -> None:
    camera = replace(CAMERA, fisheye=is_fisheye)
    resized = camera.resized(width_px, height_px)
    points_m = np.random.default_rng(0).uniform(-0.8, 0.8, (20, 3))
    places = []
    for one in (camera, resized):
        project = cv2.fisheye.projectPoints if is_fisheye else cv2.projectPoints
        turn = Rotation.from_matrix(one.R_camera_world).as_rotvec()
        uv, _ = project(points_m[:, None], turn, one.t_camera_world_m, one.K, one.distortion)
        places.append((np.reshape(uv, (-1, 2)) + 0.5) / one.size_px)
    np.testing.assert_allclose(places[0], places[1], atol=1e-9)


def test_a_reduced_picture_shows_a_point_where_the_reduced_camera_sees_it() -> None:
    small = CAMERA.reduced(128)
    at_px = np.array([100.3, 150.8])
    v, u = np.mgrid[:240, :320]
    dot = 255 * np.exp(-((u - at_px[0]) ** 2 + (v - at_px[1]) ** 2) / (2 * 6.0**2))
    picture = reduce_picture(np.repeat(dot[..., None], 3, axis=2).astype(np.uint8), small)
    assert picture.shape == (96, 128, 3)
    weights = picture[..., 0].astype(float)
    rows, columns = np.mgrid[:96, :128]
    found_px = np.array([(weights * columns).sum(), (weights * rows).sum()]) / weights.sum()
    share = np.array([128 / 320, 96 / 240])
    np.testing.assert_allclose(found_px, (at_px + 0.5) * share - 0.5, atol=0.05)


@given(st.integers(0, 2**32 - 1), st.integers(32, 320))
def test_a_reduced_pixel_is_certain_if_unsure_ones_cannot_change_it(seed: int, longest_side_px: int) -> None:
    small = CAMERA.reduced(longest_side_px)
    rng = np.random.default_rng(seed)
    coarse = rng.choice(STATES, (12, 16), p=[0.4, 0.2, 0.4])
    trimap: Trimap = cv2.resize(coarse, (320, 240), interpolation=cv2.INTER_NEAREST)
    reduced = resized_trimap(trimap, small)
    at_least = resized_trimap(np.where(trimap == UNSURE, np.uint8(BACKGROUND), trimap), small)
    at_most = resized_trimap(np.where(trimap == UNSURE, np.uint8(ACTOR), trimap), small)
    assert not np.any(at_least == UNSURE) and not np.any(at_most == UNSURE)
    np.testing.assert_array_equal(reduced, np.where(at_least == at_most, at_least, np.uint8(UNSURE)))


def test_half_of_a_pixel_decides() -> None:
    trimap = np.zeros((240, 320), np.uint8)
    trimap[0, 0:2] = ACTOR  # two of the first pixel's four
    trimap[0, 4] = ACTOR
    trimap[0, 8], trimap[1, 8] = ACTOR, UNSURE
    small = resized_trimap(trimap, CAMERA.reduced(160))
    assert small[0, :5].tolist() == [ACTOR, BACKGROUND, BACKGROUND, BACKGROUND, UNSURE]
    assert not small[0, 5:].any() and not small[1:].any()


@pytest.mark.parametrize("longest_side_px", [107, 128, 160, 213, 284, 320])
def test_an_enlarged_silhouette_stays_in_place_and_is_reduced_to_nearly_itself(longest_side_px: int) -> None:
    small = CAMERA.reduced(longest_side_px)
    v, u = np.mgrid[: small.height_px, : small.width_px] / small.height_px
    trimap = np.where(np.hypot(u - 0.6, v - 0.55) < 0.3, ACTOR, BACKGROUND).astype(np.uint8)
    trimap[np.hypot(u - 0.9, v - 0.55) < 0.1] = UNSURE
    whole = resized_trimap(trimap, CAMERA)
    assert whole.shape == (240, 320)
    assert (resized_trimap(whole, small) != trimap).sum() <= 4
    for state in (ACTOR, UNSURE):
        shares = [(np.argwhere(of == state).mean(axis=0) + 0.5) / of.shape for of in (trimap, whole)]
        np.testing.assert_allclose(shares[0], shares[1], atol=0.2 / 320)


def test_what_has_the_size_already_is_not_copied() -> None:
    picture, trimap = np.zeros((240, 320, 3), np.uint8), np.zeros((240, 320), np.uint8)
    assert reduce_picture(picture, CAMERA) is picture
    assert resized_trimap(trimap, CAMERA) is trimap
