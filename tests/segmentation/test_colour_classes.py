"""Colour classes are learnt from pictures of a body whose pieces have known colours."""

from collections import Counter

import numpy as np
import pytest

from services.mocap.body.colours import COLOURED, MOST_CLASSES, QUARTERS
from services.mocap.types import Bytes, Mask
from services.segmentation.colour_classes import PIECES, ColourClasses, ColourLearner, classes_of

SKIN, SHIRT, TROUSERS = (120, 150, 210), (160, 60, 40), (60, 110, 60)
"""BGR."""
DRESSED = {
    "head": SKIN,
    "torso": SHIRT,
    "left_forearm": SKIN,
    "left_thigh": TROUSERS,
    "right_thigh": TROUSERS,
}
BLOCK_PX = 12


def shown(colours: dict[str, tuple[int, int, int]], seed: int = 0) -> tuple[Bytes, Bytes, Mask]:
    """A picture (H, W, 3) of noise in which each segment is a column of four blocks, the piece of each pixel
    and where the actor is."""
    rng = np.random.default_rng(seed)
    shape = 2 * BLOCK_PX + QUARTERS * BLOCK_PX, 2 * BLOCK_PX + 2 * len(colours) * BLOCK_PX
    image, pieces = np.full((*shape, 3), 128.0), np.zeros(shape, np.uint8)
    for column, (name, bgr) in enumerate(colours.items()):
        left = BLOCK_PX + 2 * column * BLOCK_PX
        for quarter in range(QUARTERS):
            rows = slice((1 + quarter) * BLOCK_PX, (2 + quarter) * BLOCK_PX)
            image[rows, left : left + BLOCK_PX] = bgr
            pieces[rows, left : left + BLOCK_PX] = PIECES[COLOURED.index(name), quarter]
    noisy = np.clip(image + rng.normal(0, 3, image.shape), 0, 255).astype(np.uint8)
    return noisy, pieces, pieces > 0


def learnt(colours: dict[str, tuple[int, int, int]], n_cameras: int = 2) -> ColourClasses | None:
    learner = ColourLearner(n_cameras)
    for seed in range(4):
        for camera in range(n_cameras):
            learner.add(camera, *shown(colours, seed))
    return learner.conclude()


def test_parts_of_one_colour_make_one_class() -> None:
    found = learnt(DRESSED)
    assert found is not None
    assert set(found.colours) == set(DRESSED)
    classes = {name: set(quarters) for name, quarters in found.colours.items()}
    assert classes["head"] == classes["left_forearm"]
    assert classes["left_thigh"] == classes["right_thigh"]
    numbers = [classes["head"], classes["torso"], classes["left_thigh"]]
    assert all(len(one) == 1 for one in numbers)
    assert len(set().union(*numbers)) == 3
    assert set().union(*numbers) <= set(range(1, 1 + MOST_CLASSES))


def test_parts_that_share_their_shades_are_merged_until_shades_speak_for_them() -> None:
    """Of four shades of one cloth each part shows two, so that none speaks for one part alone."""
    shades = (220, 110, 90), (160, 60, 40), (110, 40, 30), (60, 20, 10)
    first, second, third, fourth = shades
    lit_parts = {
        "torso": (first, second),
        "skirt": (third, fourth),
        "left_upper_arm": (first, third),
        "right_upper_arm": (second, fourth),
    }
    learner = ColourLearner(1)
    for seed in range(4):
        lit = {name: of_part[seed % 2] for name, of_part in lit_parts.items()}
        learner.add(0, *shown({"head": SKIN} | lit, seed))
    found = learner.conclude()
    assert found is not None
    by_class = Counter(number for name in lit_parts for number in found.colours[name])
    assert list(by_class.values()) == [2 * QUARTERS, 2 * QUARTERS]
    assert by_class.keys().isdisjoint(found.colours["head"])
    seen = [classes_of(shown({"torso": shade})[0], found.tables[0])[40:50, 14:20] for shade in shades]
    assert np.isin(seen, list(by_class)).mean() == 0.5, "the shades that one class alone shows"


def test_pixels_get_the_class_of_their_part_and_others_none() -> None:
    found = learnt(DRESSED)
    assert found is not None
    image, pieces, _ = shown(DRESSED, 99)
    for table in found.tables:
        seen = classes_of(image, table)
        for name, quarters in found.colours.items():
            is_part = np.isin(pieces, PIECES[COLOURED.index(name)])
            assert (seen[is_part] == quarters[0]).mean() > 0.75, "but for the blurred rim"
        strange = np.full((8, 8, 3), (255, 0, 255), np.uint8)
        assert not classes_of(strange, table).any()


def test_a_camera_with_other_colours_has_a_table_of_its_own() -> None:
    """The same clothes, seen by a camera with another white balance."""
    learner = ColourLearner(2)
    tinted = {name: (bgr[0] // 2, bgr[1], bgr[2]) for name, bgr in DRESSED.items()}
    for seed in range(4):
        learner.add(0, *shown(DRESSED, seed))
        learner.add(1, *shown(tinted, seed))
    found = learner.conclude()
    assert found is not None
    shirt = found.colours["torso"][1]
    for camera, colours in enumerate((DRESSED, tinted)):
        image, pieces, _ = shown(colours, 50)
        is_shirt = np.isin(pieces, PIECES[COLOURED.index("torso")])
        assert (classes_of(image, found.tables[camera])[is_shirt] == shirt).mean() > 0.75


@pytest.mark.parametrize("colours", [{}, {"head": SKIN}, dict.fromkeys(DRESSED, SHIRT)])
def test_an_actor_in_one_colour_has_no_classes(colours: dict[str, tuple[int, int, int]]) -> None:
    assert learnt(colours) is None


def test_what_is_not_surely_actor_teaches_nothing() -> None:
    learner = ColourLearner(1)
    image, pieces, actor = shown(DRESSED)
    for _ in range(4):
        learner.add(0, image, pieces, np.zeros_like(actor))
    assert learner.conclude() is None
