"""An object that was put onto the stage after the plates were recorded is told from somebody who moves."""

from collections.abc import Callable, Sequence

import pytest
from rig_scene import BLUE, Blob, iou, joint, moment, person, render, ring

from services.mocap.types import UNSURE, Mask
from services.segmentation.lenses import Lenses
from services.segmentation.static_objects import StaticObjects
from services.segmentation.voxels import VoxelGrid

CAMERAS = ring(4, 128, 96)
CRATE = Blob((-0.9, 0.9, 0.4), (0.25, 0.25, 0.4), BLUE)
N = 6

Actor = Callable[[int], list[Blob]]


def walking(k: int) -> list[Blob]:
    return person(x=0.9 - 0.15 * k, y=-0.4)


def waving(k: int) -> list[Blob]:
    """Somebody whose trunk and legs stay where they are."""
    *still, _, _ = person(x=0.3, y=-0.3)
    hands = [Blob((0.3 + side * 0.4, -0.3, 1.0 + 0.15 * k), (0.12, 0.12, 0.12), BLUE) for side in (-1, 1)]
    return [*still, *hands]


def shifting(k: int) -> list[Blob]:
    """Somebody in a long coat who stays on the spot, but for a hand's breadth."""
    x_m = 0.02 * k
    return [*person(x=x_m), Blob((x_m, 0.0, 0.9), (0.25, 0.25, 0.9), BLUE)]


def standing(_: int) -> list[Blob]:
    return person(x=0.3)


def objects_of(moments: Sequence[Sequence[Blob]]) -> list[Mask]:
    found = StaticObjects(VoxelGrid.of(CAMERAS, Lenses.of(CAMERAS), 0.0))
    for blobs in moments:
        found.add({c: render(camera, blobs).actor for c, camera in enumerate(CAMERAS)})
    return found.masks([camera.shape_px for camera in CAMERAS])


@pytest.mark.parametrize("actor", [walking, waving])
def test_what_stays_while_somebody_moves_is_an_object(actor: Actor) -> None:
    for camera, mask in zip(CAMERAS, objects_of([[*actor(k), CRATE] for k in range(N)]), strict=True):
        crate = render(camera, [CRATE]).actor
        assert mask[crate].all()
        assert mask.sum() < 5 * crate.sum()


@pytest.mark.parametrize(("actor", "n_moments"), [(standing, N), (walking, N - 1)])
def test_without_somebody_who_moves_or_at_few_moments_nothing_is(actor: Actor, n_moments: int) -> None:
    assert not any(mask.any() for mask in objects_of([[*actor(k), CRATE] for k in range(n_moments)]))


@pytest.mark.parametrize("actor", [walking, waving, shifting])
def test_somebody_alone_is_no_object(actor: Actor) -> None:
    assert not any(mask.any() for mask in objects_of([actor(k) for k in range(2 * N)]))


def test_the_object_is_unsure_in_silhouettes_and_its_colours_are_not_learnt() -> None:
    pictures = [moment(CAMERAS, [*walking(k), CRATE], k).images for k in range(N)]
    segmenter = joint(CAMERAS)
    segmenter.settle_floor(pictures[::3])
    segmenter.learn_all(lambda: iter(pictures))
    found = segmenter.trimaps(pictures[2])
    for c, camera in enumerate(CAMERAS):
        crate, actor = render(camera, [CRATE]).actor, render(camera, walking(2)).actor
        assert (found[c][crate] == UNSURE).all()
        assert iou(found[c], actor) > 0.85
