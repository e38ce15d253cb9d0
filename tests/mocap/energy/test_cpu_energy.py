"""The `cpu` backend: many cameras, and memory; test_every_backend.py has what holds for all."""

from collections.abc import Callable

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import SEGMENT_INDEX, SEGMENT_NAMES, dofs_of
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.types import Bytes, Floats

ALL = tuple(range(len(SEGMENT_NAMES)))
EVERY_DOF = tuple(range(N_DOF))
RandomPoses = Callable[[int, int], Floats]
Ring = Callable[[int], Rig]


def _silhouettes(backend: CpuBackend, rig: Rig, pose: Floats) -> Bytes:
    planes: Bytes = backend.coverage(pose[None], ALL, Region.whole(rig))[0]
    return planes


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
