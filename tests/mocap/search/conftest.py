"""What the search's tests share: a model, its own silhouettes, and how far a pose is off."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from few_starts import few_starts
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, joint_positions
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Energy, Problem
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.model import Model
from services.mocap.synth.studio import studio_cameras
from services.mocap.types import Bytes, Floats


class CountingBackend(CpuBackend):
    """The `cpu` backend, counting every single evaluation."""

    evaluations = 0

    def energy(self, problem: Problem) -> Energy:
        energy = super().energy(problem)

        def counting(values: Floats) -> Floats:
            self.evaluations += len(values)
            return energy(values)

        return counting


@pytest.fixture(scope="module")
def quick_first_pose() -> Iterator[None]:
    """A search for the first pose with fewer starts, for tests of what comes before or after it."""
    with few_starts():
        yield


@pytest.fixture(scope="session")
def model() -> Model:
    """A person of 1.75 m before eight cameras of 320x240 pixels; its backend has `evaluations`."""
    body, rig = build_body(Actor(height=1.75)), Rig.of(studio_cameras(8))
    return Model(body, rig, CountingBackend(body, rig))


@pytest.fixture(scope="session")
def standing(model: Model) -> Callable[..., Floats]:
    """`standing(**degrees)`: a pose (D,) upright on the floor near the middle, some parameters changed.

    A parameter without its side is set on both.
    """

    def make(**degrees: float) -> Floats:
        pose = np.zeros(N_DOF)
        pose[:3] = 0.3, -0.2, model.body.pelvis_height_m
        for name, value in degrees.items():
            for sided in (name, f"left_{name}", f"right_{name}"):
                if sided in DOF_INDEX:
                    pose[DOF_INDEX[sided]] = np.radians(value)
        return pose

    return make


@pytest.fixture(scope="session")
def silhouettes_of(model: Model) -> Callable[[Floats], Bytes]:
    """`silhouettes_of(pose)`: the bit-planes (P, H, W) that the model itself shows the cameras."""
    return lambda pose: model.backend.coverage(pose[None], ALL_SURFACES, Region.whole(model.rig))[0]


@pytest.fixture(scope="session")
def picture_of(model: Model, silhouettes_of: Callable[[Floats], Bytes]) -> Callable[[Floats], Picture]:
    """`picture_of(pose)`: the same as a whole picture to search in."""
    return lambda pose: Picture.whole(model.rig, silhouettes_of(pose))


@pytest.fixture(scope="session")
def sinking_arms(standing: Callable[..., Floats]) -> Floats:
    """(9, D): both arms sink slowly from the side, and the actor walks on."""
    poses = np.array([standing(shoulder_elevation=-10.0 - 6.0 * k, elbow_flexion=40.0) for k in range(9)])
    poses[:, 0] += 0.03 * np.arange(9)
    return poses


@pytest.fixture(scope="session")
def sinking_arms_seen(sinking_arms: Floats, silhouettes_of: Callable[[Floats], Bytes]) -> list[TriPlanes]:
    """The silhouettes of these poses."""
    return [TriPlanes.sure(silhouettes_of(pose)) for pose in sinking_arms]


@pytest.fixture(scope="session")
def joint_errors_mm(model: Model) -> Callable[[Floats, Floats], Floats]:
    """`joint_errors_mm(pose, truth)`: the distance (J,) of each joint from where it should be."""

    def errors(pose: Floats, truth: Floats) -> Floats:
        found, true = joint_positions(np.stack([pose, truth]), model.body.offsets_m)
        off_mm: Floats = 1000.0 * np.linalg.norm(found - true, axis=1)
        return off_mm

    return errors
