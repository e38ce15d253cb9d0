"""What the `cpu` backend's energy is, and what it must not depend on."""

from collections.abc import Callable

import numpy as np
import pytest

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import SEGMENT_INDEX, SEGMENT_NAMES, dofs_of, segments_below
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.bitplanes import count_bits
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.types import Bytes, Floats

ALL = tuple(range(len(SEGMENT_NAMES)))
EVERY_DOF = tuple(range(N_DOF))
ARM = segments_below("left_shoulder")
ARM_DOFS = dofs_of("left_shoulder", "left_elbow")
RandomPoses = Callable[[int, int], Floats]
Ring = Callable[[int], Rig]


def _silhouettes(backend: CpuBackend, rig: Rig, pose: Floats, segments: tuple[int, ...] = ALL) -> Bytes:
    planes: Bytes = backend.coverage(pose[None], segments, Region.whole(rig))[0]
    return planes


def _random_planes(rig: Rig, seed: int) -> Bytes:
    shape = (-(-rig.n_cameras // 8), *rig.shape_px)
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def _masked(planes: Bytes, rig: Rig) -> Bytes:
    """Planes without the bits of cameras that do not exist."""
    valid = np.array([(1 << min(8, rig.n_cameras - 8 * p)) - 1 for p in range(len(planes))], np.uint8)
    return planes & valid[:, None, None]


@pytest.mark.parametrize("n_cameras", [1, 8, 11, 16])
def test_counts_the_differing_pixels(
    coarse_body: Body, ring: Ring, random_poses: RandomPoses, n_cameras: int
) -> None:
    rig = ring(n_cameras)
    backend, poses = CpuBackend(coarse_body, rig), random_poses(5, 1)
    picture = Picture.whole(rig, _masked(_random_planes(rig, 2), rig))
    picture = picture.ignoring(_masked(_random_planes(rig, 3), rig))
    model = backend.coverage(poses, ALL, picture.region)
    expected = [count_bits((picture.silhouettes ^ drawn) & ~picture.ignored) for drawn in model]
    energies = backend.energy(Problem(poses[0], EVERY_DOF, ALL, picture))(poses)
    assert energies.dtype == np.float64
    np.testing.assert_array_equal(energies, expected)


@pytest.mark.parametrize("cut", ["halved", "window"])
def test_counts_in_windows_and_at_half_resolution(
    coarse_body: Body, ring: Ring, random_poses: RandomPoses, cut: str
) -> None:
    rig = ring(3)
    backend, poses = CpuBackend(coarse_body, rig), random_poses(5, 4)
    whole = Picture.whole(rig, _masked(_random_planes(rig, 5), rig))
    origin_px = np.array([[10, 5], [-20, 30], [60, -7]], np.int32)
    picture = whole.halved() if cut == "halved" else whole.window(origin_px, 45, 40)
    model = backend.coverage(poses, ARM, picture.region)
    expected = [count_bits((picture.silhouettes ^ drawn) & ~picture.ignored) for drawn in model]
    np.testing.assert_array_equal(backend.energy(Problem(poses[0], EVERY_DOF, ARM, picture))(poses), expected)


def test_a_batch_equals_its_poses_one_by_one(
    coarse_backend: CpuBackend, ring: Ring, random_poses: RandomPoses
) -> None:
    rig, poses = ring(3), random_poses(20, 6)
    picture = Picture.whole(rig, _silhouettes(coarse_backend, rig, poses[0]))
    energy = coarse_backend.energy(Problem(poses[0], EVERY_DOF, ALL, picture))
    together = energy(poses)
    np.testing.assert_array_equal(together, [energy(pose[None])[0] for pose in poses])
    np.testing.assert_array_equal(together[::-1], energy(poses[::-1]))
    assert energy(poses[:0]).shape == (0,)


def test_a_model_against_its_own_silhouette_is_zero(
    real_body: Body, ring: Ring, random_poses: RandomPoses
) -> None:
    rig = ring(4)
    backend, poses = CpuBackend(real_body, rig), random_poses(3, 7)
    for pose in poses:
        picture = Picture.whole(rig, _silhouettes(backend, rig, pose))
        energies = backend.energy(Problem(pose, EVERY_DOF, ALL, picture))(poses)
        assert energies[np.all(poses == pose, axis=1)] == 0
        assert np.count_nonzero(energies) == 2


def test_problems_do_not_disturb_each_other(
    coarse_backend: CpuBackend, ring: Ring, random_poses: RandomPoses
) -> None:
    rig, poses = ring(3), random_poses(4, 8)
    picture = Picture.whole(rig, _silhouettes(coarse_backend, rig, poses[0]))
    first = coarse_backend.energy(Problem(poses[0], EVERY_DOF, ALL, picture))
    before = first(poses)
    second = coarse_backend.energy(Problem(poses[1], ARM_DOFS, ARM, picture.halved()))
    second(poses[:, ARM_DOFS])
    np.testing.assert_array_equal(first(poses), before)


def test_pre_rendering_changes_the_energy_by_a_constant(
    coarse_backend: CpuBackend, ring: Ring, random_poses: RandomPoses
) -> None:
    """Drawing the parts that stay, or ignoring their pixels: the same but for what those parts cost alone."""
    rig, (pose, truth) = ring(3), random_poses(2, 9)
    others = tuple(s for s in ALL if s not in ARM)
    picture = Picture.whole(rig, _silhouettes(coarse_backend, rig, truth))
    pre_render = _silhouettes(coarse_backend, rig, pose, others)
    values = random_poses(25, 10)[:, ARM_DOFS]
    drawn = coarse_backend.energy(Problem(pose, ARM_DOFS, ALL, picture))(values)
    ignored = coarse_backend.energy(Problem(pose, ARM_DOFS, ARM, picture.ignoring(pre_render)))(values)
    constant = count_bits(pre_render & ~picture.silhouettes)
    np.testing.assert_array_equal(drawn - ignored, constant)
    assert len(np.unique(drawn)) > 10


def test_many_cameras_equal_the_sum_of_their_parts(
    coarse_body: Body, ring: Ring, random_poses: RandomPoses
) -> None:
    rig, poses = ring(13), random_poses(4, 11)
    truth = random_poses(1, 12)[0]

    def energies(part: Rig) -> Floats:
        backend = CpuBackend(coarse_body, part)
        picture = Picture.whole(part, _silhouettes(backend, part, truth))
        return backend.energy(Problem(truth, EVERY_DOF, ALL, picture))(poses)

    parts = [Rig(rig.P_px_world[k : k + 4], rig.sizes_px[k : k + 4]) for k in range(0, 13, 4)]
    np.testing.assert_array_equal(energies(rig), np.sum([energies(part) for part in parts], axis=0))


def test_what_lies_outside_a_smaller_picture_does_not_count(
    coarse_body: Body, ring: Ring, random_poses: RandomPoses
) -> None:
    rig = ring(2)
    small = Rig(rig.P_px_world, np.array([[96, 72], [40, 30]], np.int32))
    poses = random_poses(4, 13)
    backend = CpuBackend(coarse_body, small)
    picture = Picture.whole(small, np.zeros((1, 72, 96), np.uint8))
    model = backend.coverage(poses, ALL, picture.region)
    expected = [count_bits(m & 1) + count_bits(m[:, :30, :40] & 2) for m in model]
    np.testing.assert_array_equal(backend.energy(Problem(poses[0], EVERY_DOF, ALL, picture))(poses), expected)


def test_ten_thousand_evaluations_leave_memory_flat(
    coarse_backend: CpuBackend,
    ring: Ring,
    standing_pose: Floats,
    resident_growth: Callable[[Callable[[], object]], int],
) -> None:
    """Of the whole process: what compiled code takes is not Python's to count."""
    rig = ring(3)
    picture = Picture.whole(rig, _silhouettes(coarse_backend, rig, standing_pose))
    window = picture.window(np.full((3, 2), 30, np.int32), 16, 16)
    hand, dofs = (SEGMENT_INDEX["left_hand"],), dofs_of("left_wrist")
    energy = coarse_backend.energy(Problem(standing_pose, dofs, hand, window))
    one, many = np.zeros((1, len(dofs))), np.zeros((100, len(dofs)))

    def evaluate(times: int) -> None:
        for _ in range(times):
            energy(many)
            for _ in range(100):
                energy(one)

    evaluate(2)
    assert resident_growth(lambda: evaluate(50)) < 2_000_000
