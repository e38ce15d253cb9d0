"""Shadow is told by other cameras that see the same place on the floor; the floor is found by it."""

from collections.abc import Sequence

import numpy as np
import pytest
from rig_scene import Blob, Rendered, moment, person, plates, raised, ring

from services.mocap.camera.camera import Camera
from services.mocap.types import Bytes, Ints
from services.segmentation.comparison import PERHAPS_SHADOW, UNCHANGED, UNSEEN, Comparison
from services.segmentation.floor_shadow import (
    ON_ITS_OWN,
    SUPPORTED,
    UNKNOWN,
    UNSUPPORTED,
    Floor,
    find_floor,
)
from services.segmentation.lenses import Lenses
from services.segmentation.pixels import Levels
from services.segmentation.plate import LIGHT_UNCERTAINTY, Plate

CAMERAS = ring(4)
LENSES = Lenses.of(CAMERAS)
WHOLE = slice(0, CAMERAS[0].height_px), slice(0, CAMERAS[0].width_px)
Seen = tuple[Levels, Bytes, Ints]


def seen_of(blobs: Sequence[Blob], floor_m: float, seeds: Sequence[int]) -> tuple[list[Seen], list[Rendered]]:
    """Ratios, states and cameras at some moments, and what was really there at the last."""
    views = [Comparison(Plate.learn(p, LIGHT_UNCERTAINTY)) for p in plates(CAMERAS, floor_m)]
    seen, rendered = list[Seen](), list[Rendered]()
    for seed in seeds:
        shown = moment(CAMERAS, blobs, seed, floor_m)
        for c, view in enumerate(views):
            view.look(shown.images[c])
        ratios, states = np.array([v.ratio for v in views]), np.array([v.state for v in views])
        seen.append((ratios, states, np.arange(4, dtype=np.int32)))
        rendered = shown.views
    return seen, rendered


@pytest.mark.parametrize("height_m", [0.0, 0.35, 0.6])
def test_the_floor_is_found_where_it_is(height_m: float) -> None:
    seen, _ = seen_of(raised(person(), height_m), height_m, [1])
    floor = find_floor(CAMERAS, LENSES, seen)
    assert floor is not None
    assert floor.height_m == pytest.approx(height_m, abs=0.051)


def test_without_shadow_there_is_no_floor() -> None:
    seen, _ = seen_of([], 0.0, [1])
    assert find_floor(CAMERAS, LENSES, seen) is None


def test_shadows_that_do_not_agree_tell_of_no_floor() -> None:
    rng = np.random.default_rng(0)
    ratios = np.full((4, 180, 240), 1.0, np.float32)
    states = np.full((4, 180, 240), UNCHANGED, np.uint8)
    for c in range(4):  # each camera sees a patch somewhere else, as dark as no other
        row, column = rng.integers(110, 150), 20 + 55 * c
        states[c, row : row + 12, column : column + 12] = PERHAPS_SHADOW
        ratios[c, row : row + 12, column : column + 12] = 0.4 + 0.13 * c
    assert find_floor(CAMERAS, LENSES, [(ratios, states, np.arange(4, dtype=np.int32))]) is None


def test_cast_shadow_is_supported_and_legs_are_not() -> None:
    (seen, *_), rendered = seen_of(person(), 0.0, [1])
    floor = Floor.at(0.0, CAMERAS)
    ratios, states, there = seen
    supported_actor = actor = 0
    for c, view in enumerate(rendered):
        prior = floor.shadow_prior(c, WHOLE, LENSES, ratios, states, there)
        perhaps = states[c] == PERHAPS_SHADOW
        in_shadow = perhaps & view.shadow
        assert in_shadow.sum() > 20
        assert (prior[in_shadow] >= SUPPORTED).mean() > 0.9
        supported_actor += int((prior[perhaps & view.actor] >= SUPPORTED).sum())
        actor += int(view.actor.sum())
        assert (prior[states[c] == UNCHANGED] <= SUPPORTED).all()
    assert supported_actor < 0.1 * actor


def test_a_camera_alone_knows_nothing_of_shadow() -> None:
    (seen, *_), _ = seen_of(person(), 0.0, [1])
    ratios, states, _ = seen
    floor = Floor.at(0.0, CAMERAS)
    prior = floor.shadow_prior(1, WHOLE, LENSES, ratios, states, np.array([1], np.int32))
    assert (prior == UNKNOWN).all()
    assert ON_ITS_OWN > UNKNOWN


def test_lit_floor_in_another_camera_refutes_a_shadow() -> None:
    ratios = np.full((4, 180, 240), 0.6, np.float32)
    states = np.full((4, 180, 240), UNSEEN, np.uint8)
    states[0, 110:150, 100:140] = PERHAPS_SHADOW
    floor = Floor.at(0.0, CAMERAS)
    for lit in range(1, 4):
        states[1 : lit + 1] = UNCHANGED
        there = np.arange(lit + 1, dtype=np.int32)
        prior = floor.shadow_prior(0, WHOLE, LENSES, ratios, states, there)[112:148, 102:138]
        assert (prior < UNSUPPORTED).all()
        assert (prior >= UNSUPPORTED - 3.0 * lit).all()


def test_furniture_before_the_floor_in_one_camera_refutes_nothing_that_several_see() -> None:
    ratios = np.full((4, 180, 240), 0.6, np.float32)
    states = np.full((4, 180, 240), PERHAPS_SHADOW, np.uint8)
    states[3] = UNCHANGED
    floor, everybody = Floor.at(0.0, CAMERAS), np.arange(4, dtype=np.int32)
    on_stage = np.linalg.norm(floor.places_m[0], axis=-1) < 0.5  # which all cameras see
    assert (floor.shadow_prior(0, WHOLE, LENSES, ratios, states, everybody)[on_stage] >= SUPPORTED).all()
    states[2] = UNCHANGED  # one supports it and two do not: as likely a leg
    assert (floor.shadow_prior(0, WHOLE, LENSES, ratios, states, everybody)[on_stage] < SUPPORTED).all()


def test_pixels_over_the_horizon_look_at_no_floor() -> None:
    level = [
        Camera("level", 160, 120, np.array([[120.0, 0, 79.5], [0, 120.0, 59.5], [0, 0, 1]]), np.zeros(4),
               np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), np.array([0.0, 1.5, 0.0]))
    ]  # fmt: skip
    places_m = Floor.at(0.0, level).places_m[0]
    assert np.isnan(places_m[:60]).all()
    assert np.isfinite(places_m[70:]).all()
    np.testing.assert_allclose(places_m[119, :, 1], 1.5 * 120 / 59.5, rtol=1e-5)


def test_what_is_as_dark_as_confirmed_shadows_is_likelier_a_shadow() -> None:
    """Also where another camera looks at furniture, and sees the place in light."""
    ratios = np.full((4, 180, 240), 1.0, np.float32)
    states = np.full((4, 180, 240), UNCHANGED, np.uint8)
    floor = Floor.at(0.0, CAMERAS)
    on_floor = [np.linalg.norm(places, axis=-1) < 0.7 for places in floor.places_m]
    for c in range(4):
        states[c][on_floor[c]], ratios[c][on_floor[c]] = PERHAPS_SHADOW, 0.6
    there = np.arange(4, dtype=np.int32)
    found = find_floor(CAMERAS, LENSES, [(ratios, states, there)])
    assert found is not None

    apart = np.linalg.norm(floor.places_m[0], axis=-1) < 0.3
    seen = states.copy()
    seen[1:] = UNCHANGED  # nobody confirms this one
    unconfirmed, known = (
        [f.shadow_prior(0, WHOLE, LENSES, r, seen, there) for r in (ratios, 0.8 * ratios)]
        for f in (floor, found)
    )
    assert np.all(known[0][apart] > unconfirmed[0][apart] + 1.5)
    np.testing.assert_array_equal(known[1], unconfirmed[1])  # cloth that is darker than these shadows
    is_lit = states[0] == UNCHANGED
    np.testing.assert_array_equal(known[0][is_lit], unconfirmed[0][is_lit])
    confirmed = found.shadow_prior(0, WHOLE, LENSES, ratios, states, there)
    np.testing.assert_array_equal(confirmed[apart], np.full(apart.sum(), SUPPORTED))
