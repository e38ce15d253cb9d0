"""Parts that cannot be told from the background are named, and much of it is blamed before anything else."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.skeleton import SEGMENT_NAMES, SEGMENTS
from services.mocap.energy.bitplanes import TriPlanes, camera_bit, pack, unpack
from services.mocap.energy.picture import Region
from services.mocap.errors import TakeError
from services.mocap.search.error_by_part import PART_SEGMENTS
from services.mocap.search.model import Model
from services.mocap.search.plausibility import look_first
from services.mocap.search.unsure_parts import PartPixels, part_pixels, parts_in_words, untold_parts
from services.mocap.search.unsure_shares import UnsureShares, may_be_actor, without_rims
from services.mocap.take.marks import PARTS, Part
from services.mocap.types import Bytes, Floats, Mask

NAMES = [f"cam{c + 1:02d}" for c in range(8)]
Maker = Callable[..., Floats]
Hide = Callable[[dict[int, tuple[Part, ...]]], TriPlanes]


@pytest.fixture(scope="module")
def pose(standing: Maker) -> Floats:
    return standing(shoulder_elevation=-45, hip_abduction=8)


@pytest.fixture
def hide(model: Model, pose: Floats, silhouettes_of: Callable[[Floats], Bytes]) -> Hide:
    """`hide({camera: parts})`: frames (1, P, H, W) in which these parts are unsure there."""

    def make(hidden: dict[int, tuple[Part, ...]]) -> TriPlanes:
        seen, region = silhouettes_of(pose), Region.whole(model.rig)
        masks = np.zeros((model.rig.n_cameras, *model.rig.shape_px), bool)
        for camera, parts in hidden.items():
            segments = tuple(s for part in parts for s in PART_SEGMENTS[part])
            masks[camera] = camera_bit(model.backend.coverage(pose[None], segments, region)[0], camera)
        unsure = pack(masks)
        return TriPlanes.of_frames([TriPlanes(seen & ~unsure, unsure)])

    return make


def told(model: Model, pose: Floats, seen: TriPlanes) -> str:
    return untold_parts(model, seen, pose[None], NAMES, "the first frame", "look there")


def test_every_segment_belongs_to_one_part() -> None:
    assert {segment.part for segment in SEGMENTS} == set(PARTS)
    assert sorted(s for segments in PART_SEGMENTS.values() for s in segments) == list(
        range(len(SEGMENT_NAMES))
    )


def test_parts_and_cameras_are_named(model: Model, pose: Floats, hide: Hide) -> None:
    legs: tuple[Part, ...] = ("left_leg", "right_leg")
    said = told(model, pose, hide({1: legs, 3: legs, 0: ("left_arm",)}))
    assert "silhouettes: parts of the actor cannot be told from the background in the first frame" in said
    assert "(left arm in cam01; legs in cam02, cam04): use more light" in said
    assert said.endswith("; look there")


def test_nothing_is_said_where_all_is_sure_or_only_rims_are_not(
    model: Model, pose: Floats, silhouettes_of: Callable[[Floats], Bytes], hide: Hide
) -> None:
    assert told(model, pose, hide({})) == ""
    masks = unpack(silhouettes_of(pose), 8)
    rims = masks & ~(
        np.roll(masks, 1, 1) & np.roll(masks, -1, 1) & np.roll(masks, 1, 2) & np.roll(masks, -1, 2)
    )
    assert rims.sum() > 0.2 * masks.sum()
    assert told(model, pose, TriPlanes.of_frames([TriPlanes(pack(masks & ~rims), pack(rims))])) == ""


def test_frames_are_summed_up(model: Model, pose: Floats, hide: Hide) -> None:
    once, never = hide({2: ("head",)})[0], hide({})[0]
    poses = pose[None].repeat(3, axis=0)
    for frames, is_said in (((once, once, never), True), ((once, never, never), False)):
        found = part_pixels(model, TriPlanes.of_frames(frames), poses)
        assert found.untold[2, PARTS.index("head")] == is_said
        assert not found.mostly_untold.any()


def test_a_part_that_most_cameras_cannot_tell() -> None:
    covered = np.full((3, 6), 100, np.int32)
    unsure = np.zeros_like(covered)
    unsure[:2, 4], unsure[0, 2] = 60, 60
    covered[2, 2] = covered[1, 2] = 5  # out of the picture
    assert np.flatnonzero(PartPixels(covered, unsure).mostly_untold).tolist() == [2, 4]


def test_parts_that_share_cameras_are_told_together() -> None:
    untold = np.ones((2, 6), bool)
    untold[1, 3] = False
    assert parts_in_words(untold, NAMES[:2]) == (
        "torso, head and legs in cam01, cam02; arms in cam01; left arm in cam02"
    )
    assert parts_in_words(np.zeros((2, 6), bool), NAMES[:2]) == ""


def test_what_may_be_the_actor_touches_what_is() -> None:
    sure, possible = np.zeros((2, 60, 60), bool)
    sure[10:30, 10:20] = True
    possible[10:40, 10:20] = True  # and what is below
    possible[:, 40:] = True  # a dark door
    assert may_be_actor(sure, possible).sum() == 300
    assert may_be_actor(np.zeros_like(sure), possible).sum() == 20 * 60
    assert not may_be_actor(sure & False, possible & False).any()
    speck = np.zeros_like(possible)
    speck[5:7, 5:7] = True
    assert not may_be_actor(sure & False, speck).any()
    assert without_rims(possible & ~sure).sum() == 10 * 10 + 20 * 60
    assert UnsureShares(sure[None], possible[None], NAMES[:1]).shares[0] == pytest.approx(1 / 3)


def two_people(silhouettes_of: Callable[[Floats], Bytes], standing: Maker) -> Mask:
    left, right = standing(shoulder_elevation=-80), standing(shoulder_elevation=-80)
    left[0], right[0] = -0.7, 0.7
    return unpack(silhouettes_of(left) | silhouettes_of(right), 8)


def test_a_refusal_blames_much_that_is_unsure_first(
    model: Model, standing: Maker, silhouettes_of: Callable[[Floats], Bytes]
) -> None:
    possible = two_people(silhouettes_of, standing)
    sure = possible.copy()
    for camera in (1, 3):
        rows = np.flatnonzero(possible[camera].any(axis=1))
        sure[camera, rows[0] + round(0.6 * len(rows)) :] = False
    said = r"^silhouettes: \d\d% of the possible actor in cam02, \d\d% in cam04 cannot be told from the .*"
    with pytest.raises(TakeError, match=said + r": use more light.*; if this is not the cause: .*two people"):
        look_first(model.rig, sure, NAMES, possible)
    with pytest.raises(TakeError, match=r"^silhouettes: two people"):
        look_first(model.rig, possible, NAMES)
