"""The colours of the empty stage tell from which cameras something hides a place on the floor."""

import numpy as np
import pytest
from rig_scene import Blob, noisy, person, render, ring

from services.mocap.camera.camera import Camera
from services.mocap.types import ACTOR, Bytes
from services.segmentation.comparison import PERHAPS_SHADOW, UNCHANGED
from services.segmentation.floor_shadow import SUPPORTED, UNSUPPORTED, Floor
from services.segmentation.floor_views import CELL_M, N_CELLS, REACH_M, hidden_floor
from services.segmentation.joint import JointMatte
from services.segmentation.lenses import Lenses
from services.segmentation.pixels import MEAN_STEPS, Steps
from services.segmentation.plate import Plate

CAMERAS = ring(3)
LENSES = Lenses.of(CAMERAS)
PURPLE = (110.0, 50.0, 80.0)


def _furniture(cameras: list[Camera]) -> list[Blob]:
    """Before the middle of the floor, seen from the first camera."""
    x_m, y_m, _ = 0.45 * cameras[0].centre_world_m
    return [Blob((x_m, y_m, 0.4), (0.35, 0.35, 0.4), PURPLE)]


def _means(gains: tuple[float, ...], blobs: list[Blob]) -> list[Steps]:
    """What the plates show of a room with furniture, without the shadow that it throws."""
    means = []
    for camera, gain in zip(CAMERAS, gains, strict=True):
        colours, with_blobs = render(camera).colours, render(camera, blobs)
        colours[with_blobs.actor] = with_blobs.colours[with_blobs.actor]
        means.append(np.rint(gain * colours * MEAN_STEPS).transpose(2, 0, 1).astype(np.int16))
    return means


def _cell(x_m: float, y_m: float) -> tuple[int, int]:
    return int((y_m + REACH_M) / CELL_M), int((x_m + REACH_M) / CELL_M)


@pytest.fixture(scope="module")
def hidden() -> Bytes:
    return hidden_floor(0.0, LENSES, _means((1.0, 0.7, 1.3), _furniture(CAMERAS)))


def test_nothing_hides_the_floor_of_an_empty_room_from_cameras_of_any_gain() -> None:
    on_stage = np.s_[:, N_CELLS // 2 - 10 : N_CELLS // 2 + 10, N_CELLS // 2 - 10 : N_CELLS // 2 + 10]
    assert not hidden_floor(0.0, LENSES, _means((1.0, 0.7, 1.3), []))[on_stage].any()


def test_furniture_hides_the_floor_behind_it_from_its_camera(hidden: Bytes) -> None:
    row, column = _cell(0.0, 0.0)
    assert hidden[:, row, column].tolist() == [1, 0, 0]


def test_furniture_that_fills_most_of_a_picture_is_no_gain_of_the_camera(hidden: Bytes) -> None:
    means = _means((1.0, 1.0, 1.0), [])
    means[0][:, 75:, :200] = np.array(PURPLE)[:, None, None] * MEAN_STEPS
    wide, (row, column) = hidden_floor(0.0, LENSES, means), _cell(0.0, 0.0)
    assert wide[:, row, column].tolist() == [1, 0, 0]
    assert wide[0].sum() > hidden[0].sum()


def test_a_camera_that_sees_furniture_refutes_no_shadow_behind_it(hidden: Bytes) -> None:
    ratios = np.full((3, 180, 240), 0.6, np.float32)
    states = np.full((3, 180, 240), PERHAPS_SHADOW, np.uint8)
    states[0] = UNCHANGED
    everybody, whole = np.arange(3, dtype=np.int32), (slice(0, 180), slice(0, 240))
    unknown, known = Floor.at(0.0, CAMERAS), Floor.at(0.0, CAMERAS, hidden)
    behind = np.linalg.norm(unknown.places_m[1], axis=-1) < 0.05
    assert behind.any()
    for floor, is_supported in ((unknown, False), (known, True)):
        odds = floor.shadow_prior(1, whole, LENSES, ratios, states, everybody)[behind]
        assert ((odds >= SUPPORTED) == is_supported).all()
    states[2] = UNCHANGED
    odds = known.shadow_prior(1, whole, LENSES, ratios, states, everybody)[behind]
    assert (odds < UNSUPPORTED).all(), "the third camera sees the place in light"


def test_cameras_that_agree_on_the_floor_see_it_though_as_many_see_furniture() -> None:
    """Two of four cameras, before furniture of two colours."""
    cameras = ring(4)
    means = [np.rint(render(c).colours * MEAN_STEPS).transpose(2, 0, 1).astype(np.int16) for c in cameras]
    for c, colour in ((0, PURPLE), (2, (60.0, 130.0, 50.0))):
        means[c][:, 75:, :200] = np.array(colour)[:, None, None] * MEAN_STEPS
    row, column = _cell(0.0, 0.0)
    assert hidden_floor(0.0, Lenses.of(cameras), means)[:, row, column].tolist() == [1, 0, 1, 0]


def test_the_shadow_of_somebody_whose_feet_furniture_hides_from_a_camera_is_no_actor() -> None:
    rng, furniture, body = np.random.default_rng(5), _furniture(CAMERAS), person()
    empty = [render(camera, furniture) for camera in CAMERAS]
    plates = [Plate.learn([noisy(view.colours, rng) for _ in range(8)]) for view in empty]
    matte, views = JointMatte(CAMERAS, plates), [render(camera, [*body, *furniture]) for camera in CAMERAS]
    images = {c: noisy(view.colours, rng) for c, view in enumerate(views)}
    matte.settle_floor([images])
    trimaps = matte.trimaps(images)
    for c in (1, 2):
        cast = views[c].shadow & ~empty[c].shadow
        assert cast.sum() > 100
        assert (trimaps[c][cast] == ACTOR).mean() < 0.05
