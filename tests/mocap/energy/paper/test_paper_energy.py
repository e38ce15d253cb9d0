"""The `paper` backend counts what it has drawn, and knows nothing but plain XOR."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import SEGMENT_NAMES, dofs_of, segments_below
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.bitplanes import count_bits, pack
from services.mocap.energy.cost import Cost
from services.mocap.energy.gl.device import GlDevice
from services.mocap.energy.paper.backend import PaperBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.types import Bytes, Floats

ALL, EVERY_DOF = tuple(range(len(SEGMENT_NAMES))), tuple(range(N_DOF))
ARM, ARM_DOFS = segments_below("left_shoulder"), dofs_of("left_shoulder", "left_elbow")
RandomPoses = Callable[[int, int], Floats]
Ring = Callable[[int], Rig]


def _noise(rig: Rig, seed: int) -> Bytes:
    """Random planes, bits of cameras that do not exist among them."""
    shape = (-(-rig.n_cameras // 8), *rig.shape_px)
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def _picture(rig: Rig, cut: str) -> Picture:
    picture = Picture.whole(rig, _noise(rig, 2)).ignoring(_noise(rig, 3))
    if cut == "halved":
        return picture.halved()
    origin_px = np.random.default_rng(4).integers(-30, 80, (rig.n_cameras, 2)).astype(np.int32)
    return picture.window(origin_px, 45, 37) if cut == "window" else picture


@pytest.mark.parametrize("n_cameras", [1, 3, 8, 11, 16])
@pytest.mark.parametrize("cut", ["whole", "halved", "window"])
@pytest.mark.parametrize("segments", [ALL, ARM])
def test_counts_the_differing_pixels_of_what_it_draws(
    device: GlDevice,
    coarse_body: Body,
    ring: Ring,
    random_poses: RandomPoses,
    n_cameras: int,
    cut: str,
    segments: tuple[int, ...],
) -> None:
    rig, poses = ring(n_cameras), random_poses(4, 1)
    backend, picture = PaperBackend(device, coarse_body, rig), _picture(rig, cut)
    real = pack(np.ones((n_cameras, *picture.silhouettes.shape[1:]), bool))
    model = backend.coverage(poses, segments, picture.region)
    expected = [count_bits((picture.silhouettes ^ drawn) & ~picture.ignored & real) for drawn in model]
    energies = backend.energy(Problem(poses[0], EVERY_DOF, segments, picture))(poses)
    assert energies.dtype == np.float64
    np.testing.assert_array_equal(energies, expected)


def test_a_model_against_its_own_silhouette_is_zero(
    device: GlDevice, coarse_body: Body, ring: Ring, random_poses: RandomPoses
) -> None:
    rig, poses = ring(5), random_poses(3, 5)
    backend = PaperBackend(device, coarse_body, rig)
    own = Picture.whole(rig, backend.coverage(poses[:1], ALL, Region.whole(rig))[0])
    energies = backend.energy(Problem(poses[0], EVERY_DOF, ALL, own))(poses)
    assert energies[0] == 0
    assert np.all(energies[1:] > 0)


def test_pre_rendering_changes_the_energy_by_a_constant(
    device: GlDevice, coarse_body: Body, ring: Ring, random_poses: RandomPoses
) -> None:
    rig, (pose, truth) = ring(9), random_poses(2, 6)
    backend, others = PaperBackend(device, coarse_body, rig), tuple(s for s in ALL if s not in ARM)
    region = Region.whole(rig)
    picture = Picture.whole(rig, backend.coverage(truth[None], ALL, region)[0])
    pre_render = backend.coverage(pose[None], others, region)[0]
    values = random_poses(20, 7)[:, ARM_DOFS]
    drawn = backend.energy(Problem(pose, ARM_DOFS, ALL, picture))(values)
    ignored = backend.energy(Problem(pose, ARM_DOFS, ARM, picture.ignoring(pre_render)))(values)
    np.testing.assert_array_equal(drawn - ignored, count_bits(pre_render & ~picture.silhouettes))


def test_a_batch_equals_its_poses_one_by_one_whatever_is_evaluated_between(
    device: GlDevice, coarse_body: Body, ring: Ring, random_poses: RandomPoses
) -> None:
    rig, poses = ring(3), random_poses(12, 8)
    backend = PaperBackend(device, coarse_body, rig)
    energy = backend.energy(Problem(poses[0], EVERY_DOF, ALL, _picture(rig, "whole")))
    other = backend.energy(Problem(poses[0], ARM_DOFS, ARM, _picture(rig, "window")))
    together, alone = energy(poses), []
    for pose in poses:
        alone.append(energy(pose[None])[0])
        other(pose[None, ARM_DOFS])
    np.testing.assert_array_equal(together, alone)
    assert energy(poses[:0]).shape == (0,)


@pytest.mark.parametrize(
    "cost", [Cost(distance_cap_px=4.0), Cost(camera_weights=(1.0, 2.0)), Cost(camera_cap=0.5)]
)
def test_another_cost_is_refused(device: GlDevice, coarse_body: Body, ring: Ring, cost: Cost) -> None:
    rig = ring(2)
    backend = PaperBackend(device, coarse_body, rig)
    problem = Problem(np.zeros(N_DOF), EVERY_DOF, ALL, _picture(rig, "whole"), cost)
    with pytest.raises(ValueError, match=r"^the paper backend knows plain XOR only: .*another backend$"):
        backend.energy(problem)
