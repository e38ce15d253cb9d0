"""Unsure pixels cost nothing, whatever a message says beside: whole, in windows and at half size."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import SEGMENT_NAMES
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.bitplanes import TriPlanes, joined, pack, pack_trimaps, unpack, unpack_trimaps
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Bytes, Floats, Mask, Trimap

ALL = tuple(range(len(SEGMENT_NAMES)))
EVERY_DOF = tuple(range(N_DOF))
RandomPoses = Callable[[int, int], Floats]
Ring = Callable[[int], Rig]
N = 3


def noise(rig: Rig, seed: int) -> Trimap:
    """Trimaps (C, H, W) of patches."""
    height, width = rig.shape_px
    rng = np.random.default_rng(seed)
    states = np.array([BACKGROUND, BACKGROUND, UNSURE, ACTOR], np.uint8)
    patches = rng.choice(states, (rig.n_cameras, -(-height // 5), -(-width // 5)))
    return np.ascontiguousarray(patches.repeat(5, axis=1).repeat(5, axis=2)[:, :height, :width])


def picture_of(rig: Rig, trimaps: Trimap, *, overlapping: bool = False) -> Picture:
    """A whole picture; overlapping: with silhouettes that claim the unsure pixels as well."""
    seen = pack_trimaps(trimaps)
    return Picture.whole(rig, seen.possible if overlapping else seen.silhouettes, seen.unsure)


def by_definition(drawn: Bytes, silhouettes: Mask, counted: Mask) -> int:
    return int(np.count_nonzero((unpack(drawn, N) ^ silhouettes) & counted))


def cut(picture: Picture, how: str) -> Picture:
    if how == "whole":
        return picture
    if how == "half":
        return picture.halved()
    origin_px = np.array([[10, 5], [-20, 30], [60, -7]], np.int32)
    return picture.window(origin_px, 45, 40)


@pytest.mark.parametrize("how", ["whole", "window", "half"])
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 10_000), overlapping=st.booleans())
def test_they_cost_what_masked_pixels_cost(
    coarse_body: Body, ring: Ring, random_poses: RandomPoses, how: str, seed: int, overlapping: bool
) -> None:
    rig, poses = ring(N), random_poses(2, seed)
    trimaps, backend = noise(rig, seed), CpuBackend(coarse_body, rig)
    picture = cut(picture_of(rig, trimaps, overlapping=overlapping), how)
    masked = Picture.whole(rig, pack(trimaps == ACTOR)).ignoring(pack(trimaps == UNSURE))
    reference = cut(masked, how)
    np.testing.assert_array_equal(picture.ignored, reference.ignored)
    drawn = backend.coverage(poses, ALL, picture.region)
    expected = [
        by_definition(planes, unpack(reference.silhouettes, N), ~unpack(reference.ignored, N))
        for planes in drawn
    ]
    energies = backend.energy(Problem(poses[0], EVERY_DOF, ALL, picture))(poses)
    np.testing.assert_array_equal(energies, expected)


@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 10_000))
def test_what_they_would_be_changes_no_energy(
    coarse_body: Body, ring: Ring, random_poses: RandomPoses, seed: int
) -> None:
    rig, poses = ring(N), random_poses(2, seed)
    trimaps, backend = noise(rig, seed), CpuBackend(coarse_body, rig)
    pictures = (picture_of(rig, trimaps, overlapping=overlapping) for overlapping in (False, True))
    energies = [backend.energy(Problem(poses[0], EVERY_DOF, ALL, picture))(poses) for picture in pictures]
    np.testing.assert_array_equal(*energies)


def test_without_any_a_picture_is_what_it_was(ring: Ring) -> None:
    rig = ring(N)
    planes = pack(noise(rig, 1) == ACTOR)
    plain, told = Picture.whole(rig, planes), Picture.whole(rig, planes, np.zeros_like(planes))
    assert told.unsure is None
    assert told.silhouettes is planes
    assert len(told.sent_unsure) == 0
    np.testing.assert_array_equal(plain.ignored, told.ignored)


@pytest.mark.parametrize("n_cameras", [1, 8, 11])
def test_trimaps_survive_packing_and_cameras_another_order(ring: Ring, n_cameras: int) -> None:
    rig = ring(n_cameras)
    trimaps = noise(rig, 2)
    seen = pack_trimaps(trimaps)
    assert not (seen.silhouettes & seen.unsure).any()
    np.testing.assert_array_equal(unpack_trimaps(seen, n_cameras), trimaps)
    reversed_ = joined([(seen, c) for c in range(n_cameras)[::-1]])
    np.testing.assert_array_equal(unpack_trimaps(reversed_, n_cameras), trimaps[::-1])
    sent = TriPlanes.of_sent(seen.possible, seen.sent_unsure, seen.sent_classes)
    np.testing.assert_array_equal(unpack_trimaps(sent, n_cameras), trimaps)


def test_planes_of_another_shape_are_refused(ring: Ring) -> None:
    rig = ring(N)
    planes = pack(noise(rig, 1) == ACTOR)
    with pytest.raises(ValueError, match="unsure: expected shape"):
        Picture.of_region(rig, Region.whole(rig), planes, planes[:, 1:])
