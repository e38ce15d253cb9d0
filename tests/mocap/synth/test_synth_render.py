import cv2
import numpy as np
import pytest

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.camera import Camera
from services.mocap.synth.render import FLICKER, NOISE, SHADOW, Figure, Model, expose, render, shadowed
from services.mocap.synth.room import LIGHT_WORLD, RoomView, room_patches, view_room
from services.mocap.synth.studio import studio_cameras
from services.mocap.synth.walk import walk

CAMERAS = studio_cameras()


@pytest.fixture(scope="module")
def figure(synth_body: Body) -> Figure:
    return Model(synth_body).pose(walk(60, 15, synth_body)[24])


@pytest.fixture(scope="module")
def views() -> list[tuple[Camera, RoomView]]:
    return [(camera, view_room(camera, room_patches(0), 0)) for camera in CAMERAS[:2]]


def test_silhouette_is_what_is_not_background(figure: Figure, views: list[tuple[Camera, RoomView]]) -> None:
    for camera, view in views:
        picture, silhouette = render(camera, view, figure)
        foreground = (picture != shadowed(view, figure)).any(axis=2)
        assert not (silhouette & ~foreground).any()
        # Edge pixels are mixed: those whose centre is beside the body touch the silhouette.
        around = cv2.dilate(silhouette.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        assert not (foreground & ~around).any()
        assert 0 < (foreground & ~silhouette).sum() < 0.35 * silhouette.sum()


def test_the_room_shows_as_far_as_the_body_leaves_it(
    figure: Figure, views: list[tuple[Camera, RoomView]]
) -> None:
    for camera, view in views:
        picture, silhouette = render(camera, view, figure)
        dark = RoomView(np.zeros_like(view.picture), view.floor_share, view.floor_world_m)
        white = RoomView(np.ones_like(view.picture), np.zeros_like(view.floor_share), view.floor_world_m)
        alone, same = render(camera, dark, figure)
        room_share = render(camera, white, figure)[0] - alone
        np.testing.assert_array_equal(same, silhouette)
        np.testing.assert_allclose(picture, alone + room_share * shadowed(view, figure), atol=0.02)
        assert (room_share[silhouette] < 1 - 1e-3).all()
        assert 0 <= alone.min() < alone.max() < 256


def test_the_shadow_lies_away_from_the_light(figure: Figure, views: list[tuple[Camera, RoomView]]) -> None:
    feet_m = figure.vertices_world_m[figure.vertices_world_m[:, 2] < 0.05][:, :2].mean(axis=0)
    head_m = figure.vertices_world_m[figure.vertices_world_m[:, 2].argmax()]
    tip_m = head_m[:2] - head_m[2] * LIGHT_WORLD[:2] / LIGHT_WORLD[2]
    for _, view in views:
        share = shadowed(view, figure).sum(axis=2) / view.picture.sum(axis=2)
        dark = (share < 0.9) & (view.floor_share == 1)
        assert dark.sum() > 100
        ahead_m = (view.floor_world_m[dark] - feet_m) @ (-LIGHT_WORLD[:2] / np.linalg.norm(LIGHT_WORLD[:2]))
        assert ahead_m.mean() > 0.2
        assert ahead_m.max() == pytest.approx(np.linalg.norm(tip_m - feet_m), abs=0.15)
        assert ahead_m.min() > -0.45  # half a stride
        assert share.min() == pytest.approx(SHADOW, abs=0.02)
        assert share.max() <= 1.0


def test_only_the_floor_gets_the_shadow(figure: Figure, views: list[tuple[Camera, RoomView]]) -> None:
    for _, view in views:
        room = shadowed(view, figure)
        np.testing.assert_array_equal(room[view.floor_share == 0], view.picture[view.floor_share == 0])


def test_the_lit_side_is_brighter(synth_body: Body) -> None:
    figure = Model(synth_body).pose(np.zeros(N_DOF))
    centred = figure.vertices_world_m - figure.vertices_world_m.mean(axis=0)
    towards = centred[:, :2] @ LIGHT_WORLD[:2]
    brightness = figure.bgr.sum(axis=1)
    assert brightness[towards > 0.03].mean() > 1.1 * brightness[towards < -0.03].mean()


def test_noise_and_flicker_are_as_stated() -> None:
    rng = np.random.default_rng(0)
    picture = np.full((48, 64, 3), 120.0, np.float32)
    shots = np.array([expose(picture, rng) for _ in range(200)], np.float64)
    assert shots.std(axis=(1, 2, 3)).mean() == pytest.approx(np.hypot(NOISE, 12**-0.5), rel=0.02)
    assert shots.mean(axis=(1, 2, 3)).std() == pytest.approx(120 * FLICKER, rel=0.2)
    assert shots.mean() == pytest.approx(120, abs=0.2)


def test_exposing_is_bit_equal_by_seed() -> None:
    picture = np.full((24, 32, 3), 80.0, np.float32)
    one, again, other = (expose(picture, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()
    assert one.dtype == np.uint8
