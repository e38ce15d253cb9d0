"""A coarse body that the slow reference can draw often, cameras about it, and random poses."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
import trimesh

from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import LOWER, UPPER
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.types import Floats

Look = Callable[..., Camera]


@pytest.fixture(scope="session")
def real_body() -> Body:
    return build_body(Actor())


@pytest.fixture(scope="session")
def coarse_body(real_body: Body) -> Body:
    """Every segment an ellipsoid of 80 triangles in the real segment's bounding box."""
    ball = trimesh.creation.icosphere(subdivisions=1)
    vertices_m = []
    for real in real_body.vertices_m:
        low, high = real.min(axis=0), real.max(axis=0)
        vertices_m.append((low + high) / 2 + np.asarray(ball.vertices) * (high - low) / 2)
    faces = np.asarray(ball.faces, np.int32)
    return Body(real_body.offsets_m, tuple(vertices_m), (faces,) * len(vertices_m), real_body.height_m)


@pytest.fixture(scope="session")
def standing_pose(real_body: Body) -> Floats:
    """(35,) upright on the floor in the T pose."""
    pose = np.zeros(N_DOF)
    pose[2] = real_body.pelvis_height_m
    return pose


@pytest.fixture(scope="session")
def random_poses(standing_pose: Floats) -> Callable[[int, int], Floats]:
    """`random_poses(n, seed)`: (n, 35) poses all over the joint limits, about the origin."""

    def draw(n: int, seed: int) -> Floats:
        low = np.where(np.isfinite(LOWER), LOWER, -0.4)
        high = np.where(np.isfinite(UPPER), UPPER, 0.4)
        poses: Floats = np.random.default_rng(seed).uniform(low, high, (n, N_DOF))
        poses[:, 2] += standing_pose[2]
        return poses

    return draw


@pytest.fixture(scope="session")
def look() -> Look:
    """A pinhole at `eye_m` that looks at `target_m`."""

    def make(
        eye_m: tuple[float, float, float],
        target_m: tuple[float, float, float] = (0.0, 0.0, 0.9),
        focal_px: float = 90.0,
        width_px: int = 96,
        height_px: int = 72,
    ) -> Camera:
        ahead = np.array(target_m) - np.array(eye_m)
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, [0.1, 0.0, 1.0])  # tilted, so that nothing lines up with pixel rows
        right /= np.linalg.norm(right)
        R = np.array([right, np.cross(ahead, right), ahead])
        K = np.array(
            [
                [focal_px, 0.2, width_px / 2 - 0.7],
                [0.0, 1.03 * focal_px, height_px / 2 + 0.4],
                [0.0, 0.0, 1.0],
            ]
        )
        return Camera("camera", width_px, height_px, K, np.zeros(4), R, -R @ np.array(eye_m))

    return make


@pytest.fixture(scope="session")
def ring(look: Look) -> Callable[[int], Rig]:
    """`ring(n)`: n cameras 4 m from the middle."""

    def make(n: int) -> Rig:
        angles = 2 * np.pi * np.arange(n) / n + 0.2
        return Rig.of(tuple(look((4 * np.cos(a), 4 * np.sin(a), 1.4)) for a in angles))

    return make


@pytest.fixture
def coarse_backend(coarse_body: Body, ring: Callable[[int], Rig]) -> Iterator[CpuBackend]:
    """The coarse body before three cameras."""
    backend = CpuBackend(coarse_body, ring(3))
    yield backend
    backend.close()
