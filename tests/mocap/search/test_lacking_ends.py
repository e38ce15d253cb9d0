"""Hands, feet and a head that silhouettes lack are named with their cameras."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.energy.bitplanes import TriPlanes, camera_bit, pack, unpack
from services.mocap.energy.picture import Region
from services.mocap.search.lacking_ends import ENDS, lacking_ends, lacking_in_words
from services.mocap.search.model import Model
from services.mocap.types import Bytes, Floats, Mask

NAMES = [f"cam{c + 1:02d}" for c in range(8)]


@pytest.fixture
def pose(standing: Callable[..., Floats]) -> Floats:
    return standing(shoulder_elevation=-45, hip_abduction=8)


@pytest.fixture
def drawn(model: Model, pose: Floats) -> Callable[[str, int], Mask]:
    """`drawn(end, camera)`: its pixels (H, W) there."""

    def draw(end: str, camera: int) -> Mask:
        planes = model.backend.coverage(pose[None], ENDS[end], Region.whole(model.rig))[0]
        return np.asarray(camera_bit(planes, camera), bool)

    return draw


def frames(masks: Mask, unsure: Bytes | None = None) -> TriPlanes:
    seen = pack(masks)
    return TriPlanes.of_frames([TriPlanes(seen, np.zeros_like(seen) if unsure is None else unsure)])


def test_every_end_has_segments() -> None:
    assert {end: len(segments) for end, segments in ENDS.items()} == {"hands": 2, "feet": 2, "head": 1}


def test_what_is_cut_off_is_named(
    model: Model,
    pose: Floats,
    silhouettes_of: Callable[[Floats], Bytes],
    drawn: Callable[[str, int], Mask],
) -> None:
    masks = unpack(silhouettes_of(pose), 8).astype(bool)
    assert lacking_ends(model, frames(masks), pose[None], NAMES) == {}
    for camera in (0, 2):
        masks[camera] &= ~drawn("hands", camera)
    masks[1] &= ~drawn("feet", 1) & ~drawn("head", 1)
    lacking = lacking_ends(model, frames(masks), pose[None], NAMES)
    assert lacking == {"cam01": ("hands",), "cam02": ("feet", "head"), "cam03": ("hands",)}
    assert lacking_in_words(lacking) == (
        "silhouettes lack the hands in cam01, cam03; the feet in cam02; the head in cam02"
    )
    assert lacking_in_words({}) == ""


def test_what_is_unsure_is_not_lacking(
    model: Model, pose: Floats, silhouettes_of: Callable[[Floats], Bytes], drawn: Callable[[str, int], Mask]
) -> None:
    masks, hidden = unpack(silhouettes_of(pose), 8).astype(bool), np.zeros((8, *model.rig.shape_px), bool)
    hidden[3] = drawn("head", 3)
    masks &= ~hidden
    assert lacking_ends(model, frames(masks), pose[None], NAMES) == {"cam04": ("head",)}
    assert lacking_ends(model, frames(masks, pack(hidden)), pose[None], NAMES) == {}


def test_most_of_the_frames_decide(
    model: Model, pose: Floats, silhouettes_of: Callable[[Floats], Bytes], drawn: Callable[[str, int], Mask]
) -> None:
    whole = unpack(silhouettes_of(pose), 8).astype(bool)
    cut = whole.copy()
    cut[5] &= ~drawn("feet", 5)
    for chosen, found in (((cut, cut, whole), {"cam06": ("feet",)}), ((cut, whole, whole), {})):
        seen = TriPlanes.of_frames([frames(masks)[0] for masks in chosen])
        assert lacking_ends(model, seen, pose[None].repeat(3, axis=0), NAMES) == found
