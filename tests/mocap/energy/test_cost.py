"""What differing pixels and cameras cost."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.bitplanes import pack, unpack
from services.mocap.energy.cost import DISTANCE_STEPS, Cost
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.types import Floats, Mask

RandomPoses = Callable[[int, int], Floats]
Ring = Callable[[int], Rig]
EVERY_DOF = tuple(range(N_DOF))
COSTS = (
    Cost(),
    Cost(distance_cap_px=6.0),
    Cost(camera_cap=0.3),
    Cost(camera_weights=(0.5, 2.0, 0.0)),
    Cost(distance_cap_px=9.5, camera_weights=(1.0, 3.0, 0.25), camera_cap=0.1),
)


def _by_definition(model: Mask, wanted: Mask, counted: Mask, cost: Cost) -> float:
    """The energy of masks (C, H, W), pixel by pixel and camera by camera."""
    differs = (model != wanted) & counted
    price = np.ones(model.shape)
    if cost.distance_cap_px:
        distance_px = np.array([distance_transform_edt(m) + distance_transform_edt(~m) for m in wanted]) - 0.5
        price = np.rint(np.minimum(distance_px, cost.distance_cap_px) * DISTANCE_STEPS) / DISTANCE_STEPS
    energies = np.sum(price * differs, axis=(1, 2))
    if cost.camera_cap:
        cap = cost.camera_cap * np.median(np.sum(wanted, axis=(1, 2))) * (cost.distance_cap_px or 1.0)
        energies = cap * energies / (cap + energies)
    return float(energies @ (cost.camera_weights or (1.0,) * len(model)))


@pytest.mark.parametrize("cost", COSTS)
def test_energy_is_what_the_definition_says(
    coarse_backend: CpuBackend, ring: Ring, random_poses: RandomPoses, cost: Cost
) -> None:
    rig, poses = ring(3), random_poses(6, 11)
    region = Region.whole(rig)
    wanted = coarse_backend.coverage(poses[:1], ALL_SURFACES, region)[0]
    ignored = pack(np.random.default_rng(3).random((3, *rig.shape_px)) < 0.2)
    picture = cost.priced(Picture.whole(rig, wanted)).ignoring(ignored)
    energies = coarse_backend.energy(Problem(poses[0], EVERY_DOF, ALL_SURFACES, picture, cost))(poses)
    counted = ~unpack(picture.ignored, 3)
    expected = [
        _by_definition(unpack(planes, 3), unpack(wanted, 3), counted, cost)
        for planes in coarse_backend.coverage(poses, ALL_SURFACES, region)
    ]
    np.testing.assert_allclose(energies, expected, rtol=1e-12)


@pytest.mark.parametrize("cost", COSTS)
def test_tallies_hold_the_blank_energy_and_combine_cameras(ring: Ring, cost: Cost) -> None:
    rig, rng = ring(3), np.random.default_rng(0)
    wanted: Mask = rng.random((3, *rig.shape_px)) < 0.3
    tally = cost.tally(cost.priced(Picture.whole(rig, pack(wanted))))
    np.testing.assert_array_equal(tally.blank, -tally.gain.sum(axis=(1, 2), where=wanted))
    nothing, everything = np.zeros_like(wanted), np.ones_like(wanted)
    both = np.array([tally.blank, tally.blank + tally.gain.sum(axis=(1, 2))])
    expected = [_by_definition(model, wanted, everything, cost) for model in (nothing, everything)]
    np.testing.assert_allclose(tally.energies(both), expected, rtol=1e-12)


def test_a_distance_cost_sees_farther_than_xor(
    coarse_backend: CpuBackend, ring: Ring, random_poses: RandomPoses
) -> None:
    """With no pixel in common, XOR says nothing about the way back; the distance to the contour does."""
    rig, pose = ring(3), random_poses(1, 1)[0]
    region = Region.whole(rig)
    wanted = coarse_backend.coverage(pose[None], ALL_SURFACES, region)[0]
    poses = np.repeat(pose[None], 20, axis=0)
    poses[:, 2] += np.linspace(1.0, 4.0, 20)
    shown = coarse_backend.coverage(poses, ALL_SURFACES, region)
    apart = ~np.any(shown & wanted, axis=(1, 2, 3)) & np.any(shown, axis=(1, 2, 3))
    problem = Problem(pose, EVERY_DOF, ALL_SURFACES, Picture.whole(rig, wanted))
    cost = Cost(distance_cap_px=100.0)
    by_distance = replace(problem, cost=cost, picture=cost.priced(problem.picture))
    nothing = pose + np.eye(N_DOF)[2] * 100.0
    distant, plain = (
        energy(poses[apart]) - energy(nothing[None])
        for energy in map(coarse_backend.energy, (by_distance, problem))
    )
    assert np.count_nonzero(apart) >= 3
    assert np.all(np.diff(distant / plain) > 0)


def test_a_failed_camera_hardly_pulls(coarse_body: Body, ring: Ring, random_poses: RandomPoses) -> None:
    """One camera sees foreground everywhere: capped, its pull nearly ends, that of a good camera does not."""
    rig, pose = ring(5), random_poses(1, 8)[0]
    backend = CpuBackend(coarse_body, rig)
    masks = unpack(backend.coverage(pose[None], ALL_SURFACES, Region.whole(rig))[0], 5)
    masks[2] = True
    moved = pose.copy()
    moved[0] += 0.1
    problem = Problem(pose, EVERY_DOF, ALL_SURFACES, Picture.whole(rig, pack(masks)))

    def pull(camera: int, cap: float) -> float:
        weights = tuple(float(c == camera) for c in range(5))
        there, here = backend.energy(replace(problem, cost=Cost(0.0, weights, cap)))(np.array([moved, pose]))
        return float(abs(there - here))

    assert pull(2, 0.5) < 0.02 * pull(2, 0.0)
    assert pull(0, 0.5) > 0.5 * pull(0, 0.0)


def test_a_wrong_number_of_weights_is_refused(ring: Ring) -> None:
    rig = ring(3)
    picture = Picture.whole(rig, np.zeros((1, *rig.shape_px), np.uint8))
    with pytest.raises(ValueError, match="camera_weights: expected 3"):
        Cost(camera_weights=(1.0, 1.0)).tally(picture)


def test_prices_must_be_there(ring: Ring) -> None:
    rig = ring(3)
    picture = Picture.whole(rig, np.zeros((1, *rig.shape_px), np.uint8))
    with pytest.raises(ValueError, match="prices"):
        Cost(distance_cap_px=2.0).tally(picture)


def test_planes_of_two_sizes_are_refused(ring: Ring) -> None:
    rig = ring(3)
    picture = Picture.whole(rig, np.zeros((1, *rig.shape_px), np.uint8))
    with pytest.raises(ValueError, match="of one size"):
        Cost().tally(replace(picture, ignored=picture.ignored[:, :-1]))


def test_prices_of_many_cameras(ring: Ring) -> None:
    """Cameras in a second plane, pictures that others hold, and a price for every pixel."""
    rig, rng = ring(11), np.random.default_rng(2)
    wanted, ignored = rng.random((2, 11, *rig.shape_px)) < 0.4
    cost = Cost(distance_cap_px=4.0)
    picture = cost.priced(Picture.whole(rig, pack(wanted))).ignoring(pack(ignored))
    picture.silhouettes.flags.writeable = False
    tally, prices = cost.tally(picture), picture.prices
    assert prices is not None
    price = np.where(unpack(picture.ignored, 11), 0, prices)
    np.testing.assert_array_equal(tally.gain, np.where(wanted, -price, price))
    np.testing.assert_array_equal(tally.blank, (price * wanted).sum(axis=(1, 2)))


@pytest.mark.parametrize("cap_px", [0.5, 3.2, 9.0])
def test_prices_in_a_window_with_its_margin_are_those_of_the_whole(ring: Ring, cap_px: float) -> None:
    """Wherever the window lies, over the picture's edges too: so may a worker know no more than it needs."""
    rig, rng, cost = ring(3), np.random.default_rng(1), Cost(distance_cap_px=cap_px)
    height_px, width_px = rig.shape_px
    masks: Mask = rng.random((3, height_px // 8, width_px // 8)) < 0.4
    whole = Picture.whole(rig, pack(masks.repeat(8, axis=1).repeat(8, axis=2)))
    priced, size, margin = cost.priced(whole), 20, cost.margin_px
    for _ in range(20):
        origins = rng.integers((-25, -25), (width_px + 5, height_px + 5), (3, 2)).astype(np.int32)
        wide = cost.priced(whole.window(origins - np.int32(margin), size + 2 * margin, size + 2 * margin))
        window, expected = wide.window(origins, size, size), priced.window(origins, size, size)
        counted = ~unpack(window.ignored, 3)
        assert window.prices is not None
        assert expected.prices is not None
        np.testing.assert_array_equal(window.prices[counted], expected.prices[counted])


def test_the_edge_of_the_picture_is_no_contour(ring: Ring) -> None:
    """Where the actor leaves the picture nobody knows where the contour is."""
    rig = ring(1)
    mask: Mask = np.zeros((1, *rig.shape_px), bool)
    mask[:, :, :30] = True
    origin, size = np.array([[-10, 5]], np.int32), 60
    prices = (
        Cost(distance_cap_px=99.0).priced(Picture.whole(rig, pack(mask)).window(origin, size, size)).prices
    )
    assert prices is not None
    columns = np.arange(size) - 10
    distances = np.where(columns < 30, 29.5 - columns, columns - 29.5)
    np.testing.assert_array_equal(prices[0, :, 10:], np.tile(distances * DISTANCE_STEPS, (size, 1))[:, 10:])
