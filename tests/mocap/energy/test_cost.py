"""What differing pixels and cameras cost."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.bitplanes import pack, unpack
from services.mocap.energy.cost import Cost
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.types import Floats, Mask

RandomPoses = Callable[[int, int], Floats]
Ring = Callable[[int], Rig]
EVERY_DOF = tuple(range(N_DOF))
COSTS = (Cost(), Cost(camera_weights=(0.5, 2.0, 0.0)))


def _by_definition(model: Mask, wanted: Mask, counted: Mask, cost: Cost) -> float:
    """The energy of masks (C, H, W), pixel by pixel and camera by camera."""
    differing = np.sum((model != wanted) & counted, axis=(1, 2))
    return float(differing @ (cost.camera_weights or (1.0,) * len(model)))


@pytest.mark.parametrize("cost", COSTS)
def test_energy_is_what_the_definition_says(
    coarse_backend: CpuBackend, ring: Ring, random_poses: RandomPoses, cost: Cost
) -> None:
    rig, poses = ring(3), random_poses(6, 11)
    region = Region.whole(rig)
    wanted = coarse_backend.coverage(poses[:1], ALL_SURFACES, region)[0]
    ignored = pack(np.random.default_rng(3).random((3, *rig.shape_px)) < 0.2)
    picture = Picture.whole(rig, wanted).ignoring(ignored)
    energies = coarse_backend.energy(Problem(poses[0], EVERY_DOF, ALL_SURFACES, picture, cost))(poses)
    counted = ~unpack(picture.ignored, 3)
    expected = [
        _by_definition(unpack(planes, 3), unpack(wanted, 3), counted, cost)
        for planes in coarse_backend.coverage(poses, ALL_SURFACES, region)
    ]
    np.testing.assert_array_equal(energies, expected)


@pytest.mark.parametrize("cost", COSTS)
def test_tallies_hold_the_blank_energy_and_combine_cameras(ring: Ring, cost: Cost) -> None:
    rig, rng = ring(3), np.random.default_rng(0)
    wanted: Mask = rng.random((3, *rig.shape_px)) < 0.3
    tally = cost.tally(Picture.whole(rig, pack(wanted)))
    np.testing.assert_array_equal(tally.blank, wanted.sum(axis=(1, 2)))
    nothing, everything = np.zeros_like(wanted), np.ones_like(wanted)
    both = np.array([tally.blank, tally.blank + tally.gain.sum(axis=(1, 2))])
    expected = [_by_definition(model, wanted, everything, cost) for model in (nothing, everything)]
    np.testing.assert_array_equal(tally.energies(both), expected)


def test_a_wrong_number_of_weights_is_refused(ring: Ring) -> None:
    rig = ring(3)
    picture = Picture.whole(rig, np.zeros((1, *rig.shape_px), np.uint8))
    with pytest.raises(ValueError, match="camera_weights: expected 3"):
        Cost(camera_weights=(1.0, 1.0)).tally(picture)


def test_planes_of_two_sizes_are_refused(ring: Ring) -> None:
    rig = ring(3)
    picture = Picture.whole(rig, np.zeros((1, *rig.shape_px), np.uint8))
    with pytest.raises(ValueError, match="of one size"):
        Cost().tally(replace(picture, ignored=picture.ignored[:, :-1]))


def test_the_pixels_of_many_cameras(ring: Ring) -> None:
    """Cameras in a second plane, and pictures that others hold."""
    rig, rng = ring(11), np.random.default_rng(2)
    wanted, ignored = rng.random((2, 11, *rig.shape_px)) < 0.4
    picture = Picture.whole(rig, pack(wanted)).ignoring(pack(ignored))
    picture.silhouettes.flags.writeable = False
    tally, counted = Cost().tally(picture), ~unpack(picture.ignored, 11)
    np.testing.assert_array_equal(tally.gain, np.where(wanted, -1, 1) * counted)
    np.testing.assert_array_equal(tally.blank, (counted & wanted).sum(axis=(1, 2)))
