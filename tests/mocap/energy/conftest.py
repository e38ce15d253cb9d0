"""Coarse bodies that the slow reference can draw often, cameras about them, random poses, and OpenGL.

Without OpenGL tests that need it are skipped, or fail where the environment says that there has to be one.
"""

import gc
import os
from collections.abc import Callable, Iterator
from typing import NoReturn

import numpy as np
import psutil
import pytest
import trimesh

from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.body.garments import Skirt
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import LOWER, SEGMENT_NAMES, UPPER
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.gl.device import GlDevice, GlUnavailableError
from services.mocap.types import Floats

Look = Callable[..., Camera]
REQUIRED = "XORMOCAP_REQUIRE_GL"
Point = tuple[float, float, float]


@pytest.fixture(scope="session")
def real_body() -> Body:
    return build_body(Actor())


@pytest.fixture(scope="session")
def skirted_body() -> Body:
    return build_body(Actor(skirt=Skirt(length=0.3, flare=0.1)))


@pytest.fixture(scope="session")
def coarse_body(real_body: Body) -> Body:
    """Every segment an ellipsoid of 80 triangles in the real segment's bounding box."""
    return _of_balls(real_body, subdivisions=1)


@pytest.fixture(scope="session")
def coarsest_body(real_body: Body) -> Body:
    """The same of 20 triangles."""
    return _of_balls(real_body, subdivisions=0)


def _of_balls(real_body: Body, subdivisions: int) -> Body:
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    vertices_m = []
    for real in real_body.vertices_m:
        low, high = real.min(axis=0), real.max(axis=0)
        vertices_m.append((low + high) / 2 + np.asarray(ball.vertices) * (high - low) / 2)
    faces = np.asarray(ball.faces, np.int32)
    return Body(real_body.offsets_m, tuple(vertices_m), (faces,) * len(vertices_m), real_body.height_m)


@pytest.fixture(scope="session")
def degenerate_body(coarse_body: Body) -> Body:
    """With faces without area, slivers, a flat segment and one that shrinks to a point."""
    flat = trimesh.creation.icosphere(subdivisions=1, radius=0.2)
    flat.vertices[:, 2] = 0.0
    point = trimesh.creation.icosphere(subdivisions=0)
    point.vertices *= 1e-9
    sliver = trimesh.creation.icosphere(subdivisions=2, radius=0.4)
    sliver.vertices[:, :2] *= 1e-6
    collapsed = trimesh.creation.icosphere(subdivisions=1, radius=0.15)
    collapsed.vertices[:20] = collapsed.vertices[0]
    vertices_m, faces = list(coarse_body.vertices_m), list(coarse_body.faces)
    for segment, mesh in enumerate((flat, point, sliver, collapsed)):
        vertices_m[segment], faces[segment] = np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32)
    return Body(coarse_body.offsets_m, tuple(vertices_m), tuple(faces), coarse_body.height_m)


@pytest.fixture(scope="session")
def square_on(real_body: Body) -> tuple[Body, Rig]:
    """A box with its corners on pixel centres and its sides seen edge-on: every tie of the rule.

    In the zero pose it covers 16 x 16 pixels: columns 24 to 39, rows 16 to 31.
    """
    box = trimesh.creation.box(extents=(0.5, 0.5, 0.5))
    vertices_m, faces = np.asarray(box.vertices), np.asarray(box.faces, np.int32)
    body = Body(
        real_body.offsets_m * 0, (vertices_m,) * len(SEGMENT_NAMES), (faces,) * len(SEGMENT_NAMES), 1.0
    )
    R = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    K = np.array([[64.0, 0.0, 32.0], [0.0, 64.0, 24.0], [0.0, 0.0, 1.0]])
    return body, Rig.of((Camera("camera", 64, 48, K, np.zeros(4), R, np.array([0.0, 0.0, 2.25])),))


@pytest.fixture(scope="session")
def standing_pose(real_body: Body) -> Floats:
    """(D,) upright on the floor in the T pose."""
    pose = np.zeros(N_DOF)
    pose[2] = real_body.pelvis_height_m
    return pose


@pytest.fixture(scope="session")
def random_poses(standing_pose: Floats) -> Callable[[int, int], Floats]:
    """`random_poses(n, seed)`: (n, D) poses all over the joint limits, about the origin."""

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


@pytest.fixture(scope="session")
def without_opengl() -> Callable[[Exception], NoReturn]:
    """`without_opengl(error)` skips the test, or fails it where there has to be OpenGL."""

    def give_up(error: Exception) -> NoReturn:
        if os.environ.get(REQUIRED) == "1":
            pytest.fail(f"{REQUIRED}=1, but {error}", pytrace=False)
        pytest.skip(f"no OpenGL through EGL: {error}")

    return give_up


@pytest.fixture(scope="session")
def shared_device(without_opengl: Callable[[Exception], NoReturn]) -> Iterator[GlDevice]:
    """One device for all tests that leave it as it was."""
    yield from _opened(without_opengl)


@pytest.fixture
def device(without_opengl: Callable[[Exception], NoReturn]) -> Iterator[GlDevice]:
    """A device that a test may close."""
    yield from _opened(without_opengl)


def _opened(without_opengl: Callable[[Exception], NoReturn]) -> Iterator[GlDevice]:
    try:
        opened = GlDevice()
    except GlUnavailableError as error:
        without_opengl(error)
    yield opened
    opened.close()


@pytest.fixture
def resident_growth() -> Callable[[Callable[[], object]], int]:
    """`resident_growth(work)`: by how many bytes work leaves this process larger."""

    def measure(work: Callable[[], object]) -> int:
        before_bytes = _resident_bytes()
        work()
        return _resident_bytes() - before_bytes

    return measure


def _resident_bytes() -> int:
    gc.collect()
    return int(psutil.Process().memory_info().rss)


_VIEWPOINTS = [
    pytest.param(((4.0, 0.5, 1.4), (0.0, 0.0, 0.9), 90.0), id="inside"),
    pytest.param(((1.2, -0.8, 1.6), (0.5, 0.4, 0.9), 90.0), id="partly outside"),
    pytest.param(((2.0, 0.0, 1.0), (4.0, 0.2, 1.0), 90.0), id="behind the camera"),
    pytest.param(((0.35, 0.25, 1.1), (0.0, 0.0, 0.9), 60.0), id="about the near plane"),
    pytest.param(((0.0, 0.02, 0.95), (1.0, 0.3, 0.9), 60.0), id="within the body"),
    pytest.param(((0.9, 0.3, 0.4), (0.0, 0.0, 0.9), 20.0), id="wide angle"),
    pytest.param(((40.0, 5.0, 3.0), (0.0, 0.0, 0.9), 90.0), id="a few pixels in all"),
    pytest.param(((30.0, 5.0, 3.0), (0.0, 0.3, 1.3), 4000.0), id="long focal length"),
    pytest.param(((0.35, 0.25, 1.1), (0.0, 0.0, 0.9), 4e6), id="coordinates at their limit"),
]
"""Where a camera stands and looks, in metres, and its focal length in pixels."""


@pytest.fixture(params=_VIEWPOINTS)
def viewpoint(request: pytest.FixtureRequest) -> tuple[Point, Point, float]:
    """A camera anywhere: outside, inside and behind the body, up to where coordinates end."""
    found: tuple[Point, Point, float] = request.param
    return found


@pytest.fixture(params=_VIEWPOINTS[:-1])
def moderate_viewpoint(request: pytest.FixtureRequest) -> tuple[Point, Point, float]:
    """The same, for rasterisers whose coordinates end sooner."""
    found: tuple[Point, Point, float] = request.param
    return found
