"""What is learnt of one camera: objects that were moved, and places where furniture hides the actor."""

import numpy as np
import pytest

from services.mocap.types import Bytes, Mask
from services.segmentation.learnt import ActorColours, Learnt
from services.segmentation.plate import Plate
from services.segmentation.voxels import INSIDE, MORE_MISS

N = 12
SHAPE_PX = HEIGHT_PX, WIDTH_PX = 96, 128
THING = np.s_[60:84, 50:74]
NOTHING = np.zeros(SHAPE_PX, bool)


@pytest.fixture
def image() -> Bytes:
    return np.full((*SHAPE_PX, 3), 90, np.uint8)


@pytest.fixture
def plate(image: Bytes) -> Plate:
    return Plate.learn(iter([image] * 3))


@pytest.fixture
def learnt(plate: Plate) -> Learnt:
    return Learnt(plate.shape)


def _classes(told: Mask, otherwise: int, where_told: int) -> Bytes:
    return np.where(told, where_told, otherwise).astype(np.uint8)


@pytest.mark.parametrize("is_foot", [False, True])
def test_what_stays_unconfirmed_is_an_object_unless_most_around_it_moves(
    learnt: Learnt, image: Bytes, is_foot: bool, plate: Plate
) -> None:
    """Somebody walks past the thing, or it is the foot of somebody who sways a little."""
    thing = NOTHING.copy()
    thing[THING] = True
    for k in range(N):
        changed = thing.copy()
        if not is_foot:
            changed[20:84, 5 + 8 * k : 25 + 8 * k] = True
        elif k % 3:
            changed[20:87, 47:77] = True
        learnt.add(image, _classes(thing, INSIDE, MORE_MISS), changed, ~changed)
    assert not learnt.moved.any(), "nothing counts before it is concluded"
    learnt.conclude(plate, ActorColours(), NOTHING)
    if is_foot:
        assert not learnt.moved.any()
    else:
        assert learnt.moved[THING].all()
        assert learnt.moved.sum() < 1.5 * thing.sum()


def test_what_is_moved_long_after_the_start_is_found_in_the_end(
    learnt: Learnt, image: Bytes, plate: Plate
) -> None:
    """Live, the first moments are hours ago."""
    thing = NOTHING.copy()
    thing[THING] = True
    classes, all_inside = _classes(thing, INSIDE, MORE_MISS), _classes(NOTHING, INSIDE, MORE_MISS)
    for _ in range(1000):
        learnt.add(image, all_inside, NOTHING, ~NOTHING)
    for _ in range(80):
        learnt.add(image, classes, thing, ~thing)
    learnt.conclude(plate, ActorColours(), NOTHING)
    assert learnt.moved[THING].all()


@pytest.mark.parametrize("shows_the_rest", [False, True])
def test_furniture_is_where_the_others_see_the_rest_of_somebody(
    learnt: Learnt, image: Bytes, shows_the_rest: bool, plate: Plate
) -> None:
    """Where the picture shows nobody, what the others see may lie anywhere along the ray."""
    whole = NOTHING.copy()
    whole[20:84, 50:74] = True
    behind = whole.copy()
    behind[:60] = False
    for _ in range(N):
        changed = whole & ~behind if shows_the_rest else NOTHING
        learnt.add(image, _classes(whole, MORE_MISS, INSIDE), changed, ~changed)
    learnt.conclude(plate, ActorColours(), NOTHING)
    if shows_the_rest:
        assert learnt.blind[62:82, 52:72].all()
        assert not learnt.blind[:59].any()
    else:
        assert not learnt.blind.any()


def test_few_moments_tell_no_furniture(learnt: Learnt, image: Bytes, plate: Plate) -> None:
    told, changed = ~NOTHING, NOTHING.copy()
    changed[:20] = True
    for _ in range(3):
        learnt.add(image, _classes(told, MORE_MISS, INSIDE), changed, ~changed)
    learnt.conclude(plate, ActorColours(), NOTHING)
    assert not learnt.blind.any()
