"""What holds for the energy of every backend, of which each draws in its own way."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import SEGMENT_NAMES, dofs_of, segments_below
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Backend, Problem
from services.mocap.energy.bitplanes import count_bits, pack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.gl.backend import GlBackend
from services.mocap.energy.paper.backend import PaperBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.types import Bytes, Floats

ALL, EVERY_DOF = tuple(range(len(SEGMENT_NAMES))), tuple(range(N_DOF))
ARM, ARM_DOFS = segments_below("left_shoulder"), dofs_of("left_shoulder", "left_elbow")
Make = Callable[[Rig], Backend]
RandomPoses = Callable[[int, int], Floats]
Ring = Callable[[int], Rig]


@pytest.fixture(params=["cpu", "gl", "paper"])
def make(request: pytest.FixtureRequest, coarse_body: Body) -> Iterator[Make]:
    """`make(rig)`: a backend of the coarse body."""
    opened: list[Backend] = []
    kind = {"gl": GlBackend, "paper": PaperBackend}.get(request.param)
    device = request.getfixturevalue("shared_device") if kind else None

    def backend(rig: Rig) -> Backend:
        opened.append(kind(device, coarse_body, rig) if kind else CpuBackend(coarse_body, rig))
        return opened[-1]

    yield backend
    for made in opened:
        made.close()


def noise(rig: Rig, seed: int) -> Bytes:
    """Random planes, bits of cameras that do not exist among them."""
    shape = (-(-rig.n_cameras // 8), *rig.shape_px)
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def noisy_picture(rig: Rig, cut: str) -> Picture:
    """Silhouettes and ignored pixels that are nothing but noise."""
    picture = Picture.whole(rig, noise(rig, 2)).ignoring(noise(rig, 3))
    if cut == "halved":
        return picture.halved()
    origin_px = np.random.default_rng(4).integers(-30, 80, (rig.n_cameras, 2)).astype(np.int32)
    return picture.window(origin_px, 45, 37) if cut == "window" else picture


@pytest.mark.parametrize("n_cameras", [1, 3, 8, 11, 16])
@pytest.mark.parametrize("cut", ["whole", "halved", "window"])
@pytest.mark.parametrize("segments", [ALL, ARM])
def test_counts_the_differing_pixels_of_what_it_draws(
    make: Make, ring: Ring, random_poses: RandomPoses, n_cameras: int, cut: str, segments: tuple[int, ...]
) -> None:
    rig, poses = ring(n_cameras), random_poses(4, 1)
    backend, picture = make(rig), noisy_picture(rig, cut)
    real = pack(np.ones((n_cameras, *picture.silhouettes.shape[1:]), bool))
    model = backend.coverage(poses, segments, picture.region)
    expected = [count_bits((picture.silhouettes ^ drawn) & ~picture.ignored & real) for drawn in model]
    energies = backend.energy(Problem(poses[0], EVERY_DOF, segments, picture))(poses)
    assert energies.dtype == np.float64
    np.testing.assert_array_equal(energies, expected)


def test_a_model_against_its_own_silhouette_is_zero(
    make: Make, ring: Ring, random_poses: RandomPoses
) -> None:
    rig, poses = ring(5), random_poses(3, 5)
    backend = make(rig)
    for n, pose in enumerate(poses):
        own = Picture.whole(rig, backend.coverage(pose[None], ALL, Region.whole(rig))[0])
        energies = backend.energy(Problem(poses[0], EVERY_DOF, ALL, own))(poses)
        np.testing.assert_array_equal(energies == 0, np.arange(3) == n)


def test_a_batch_equals_its_poses_one_by_one_whatever_is_evaluated_between(
    make: Make, ring: Ring, random_poses: RandomPoses
) -> None:
    rig, poses = ring(3), random_poses(12, 8)
    backend = make(rig)
    energy = backend.energy(Problem(poses[0], EVERY_DOF, ALL, noisy_picture(rig, "whole")))
    other = backend.energy(Problem(poses[1], ARM_DOFS, ARM, noisy_picture(rig, "window")))
    together, limb, alone = energy(poses), other(poses[:, ARM_DOFS]), []
    for pose in poses:
        alone.append(energy(pose[None])[0])
        other(pose[None, ARM_DOFS])
        backend.coverage(pose[None], ARM, Region.whole(rig))
    np.testing.assert_array_equal(together, alone)
    np.testing.assert_array_equal(together[::-1], energy(poses[::-1]))
    np.testing.assert_array_equal(other(poses[:, ARM_DOFS]), limb)
    assert energy(poses[:0]).shape == (0,)


def test_pre_rendering_changes_the_energy_by_a_constant(
    make: Make, ring: Ring, random_poses: RandomPoses
) -> None:
    """Drawing the parts that stay, or ignoring their pixels: the same but for what those parts cost alone."""
    rig, (pose, truth), values = ring(9), random_poses(2, 6), random_poses(20, 7)[:, ARM_DOFS]
    backend, region = make(rig), Region.whole(rig)
    picture = Picture.whole(rig, backend.coverage(truth[None], ALL, region)[0])
    pre_render = backend.coverage(pose[None], tuple(s for s in ALL if s not in ARM), region)[0]
    drawn = backend.energy(Problem(pose, ARM_DOFS, ALL, picture))(values)
    ignored = backend.energy(Problem(pose, ARM_DOFS, ARM, picture.ignoring(pre_render)))(values)
    np.testing.assert_array_equal(drawn - ignored, count_bits(pre_render & ~picture.silhouettes))
    assert len(np.unique(drawn)) > 10


def test_what_lies_outside_a_smaller_picture_does_not_count(
    make: Make, ring: Ring, random_poses: RandomPoses
) -> None:
    rig, poses = ring(2), random_poses(4, 13)
    small = Rig(rig.P_px_world, np.array([[96, 72], [40, 30]], np.int32))
    backend, picture = make(small), Picture.whole(small, np.zeros((1, 72, 96), np.uint8))
    model = backend.coverage(poses, ALL, picture.region)
    expected = [count_bits(m & 1) + count_bits(m[:, :30, :40] & 2) for m in model]
    np.testing.assert_array_equal(backend.energy(Problem(poses[0], EVERY_DOF, ALL, picture))(poses), expected)
