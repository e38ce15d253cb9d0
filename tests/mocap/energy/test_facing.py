"""The planes never rule out an edge that the snapped corners make outline."""

import numpy as np
import pytest

from services.mocap.body.actor import Body
from services.mocap.body.skeleton import SEGMENT_NAMES
from services.mocap.energy.cpu.facing import EYE_SIZE, HIDDEN, NEAR, SEEN, find_candidates, lenses_of, look
from services.mocap.energy.cpu.mesh import BLOCK, FlatMesh
from services.mocap.energy.snapping import project_snapped
from services.mocap.types import Floats, Indices, Ints, Longs, Mask, Singles

WIDTH_PX, HEIGHT_PX = 320, 240


def _turned(rng: np.random.Generator) -> Floats:
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turned: Floats = R * np.sign(np.linalg.det(R))
    return turned


def _random_M(rng: np.random.Generator, sphere_m: Floats, about_the_camera: bool = False) -> Floats:
    """A camera that sees the sphere somewhere, from very near to far, at any focal length and offset; or one
    within it, or with it behind."""
    focal_px = 10 ** rng.uniform(0.5, 4.5)
    K = np.array(
        [
            [focal_px, rng.normal(), rng.uniform(-300, 600)],
            [0, focal_px * rng.uniform(0.5, 2), 100],
            [0, 0, 1],
        ]
    )
    R = _turned(rng)
    radii = rng.uniform(-1.5, 1.0) if about_the_camera else 10 ** rng.uniform(0.1, 2.5)
    depth_m = sphere_m[3] * radii + 0.05
    t = np.array([rng.normal() * depth_m * 0.3, rng.normal() * depth_m * 0.3, depth_m]) - R @ sphere_m[:3]
    return K @ np.column_stack([R, t])


def _look(rng: np.random.Generator, M: Floats, sphere_m: Floats, eye: Singles) -> int:
    """How a camera sees a segment that stands anywhere in the world, M projecting from the segment."""
    T_world_segment = np.eye(4)
    T_world_segment[:3, :3], T_world_segment[:3, 3] = _turned(rng), rng.normal(size=3)
    P = M @ np.linalg.inv(T_world_segment)
    lens = lenses_of(P[None], WIDTH_PX, HEIGHT_PX)[0]
    return int(look(T_world_segment, M, lens, sphere_m, WIDTH_PX, HEIGHT_PX, eye))


def _is_outline(edges: Indices, uv: Ints) -> Mask:
    """Which edges (E, 4) have one front face, by snapped corners uv (V, 2)."""
    a, b, c, d = (uv[edges[:, k]].astype(np.int64) for k in range(4))

    def turn(p: Longs, q: Longs, r: Longs) -> Longs:
        return (q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0]

    one_front: Mask = (turn(a, b, c) < 0) != (turn(b, a, d) < 0)
    return one_front


@pytest.mark.parametrize("mirrored", [False, True])
def test_no_outline_is_missed(real_body: Body, mirrored: bool) -> None:
    mesh, rng = FlatMesh.of(real_body), np.random.default_rng(0)
    flags, found = np.zeros(len(mesh.planes) + BLOCK, np.uint8), np.zeros(len(mesh.edges) + 1, np.uint32)
    eye, share, views = np.zeros(EYE_SIZE, np.float32), [], []
    for trial in range(560):
        s = trial % len(SEGMENT_NAMES)
        M = _random_M(rng, mesh.spheres_m[s], about_the_camera=trial % 5 == 0)
        if mirrored:
            M[0] *= -1
        view = _look(rng, M, mesh.spheres_m[s], eye)
        views.append(view)
        if view != SEEN:
            continue
        first, last = mesh.starts[1, s], mesh.starts[1, s + 1]
        n = find_candidates(mesh.planes, mesh.block_planes, first, last, eye, flags, found)
        is_outline = np.zeros(len(mesh.edges), bool)
        uv, _ = project_snapped(mesh.xyz_m.T, M)
        own = slice(BLOCK * first, BLOCK * last)
        is_outline[own] = _is_outline(mesh.edges[own], uv)
        assert np.isin(np.flatnonzero(is_outline), found[:n]).all()
        share.append(n / (BLOCK * (last - first)))
    assert set(views) == {HIDDEN, NEAR, SEEN}
    assert views.count(SEEN) > 100
    assert np.median(share) < 0.3  # it would be no use if it ruled out little


def test_hidden_means_outside_and_near_means_near(real_body: Body) -> None:
    mesh, rng = FlatMesh.of(real_body), np.random.default_rng(1)
    eye, views = np.zeros(EYE_SIZE, np.float32), []
    for trial in range(300):
        s, about_the_camera = trial % len(SEGMENT_NAMES), trial % 5 == 0
        M = _random_M(rng, mesh.spheres_m[s], about_the_camera)
        M[0] += rng.normal() * 300 * M[2]
        M[1] += rng.normal() * 300 * M[2]
        own = slice(mesh.starts[0, s], mesh.starts[0, s + 1])
        uv, depth_m = project_snapped(mesh.xyz_m[:, own].T, M)
        view = _look(rng, M, mesh.spheres_m[s], eye)
        views.append(view)
        assert view == NEAR or not about_the_camera
        if view == HIDDEN:
            (left, top), (right, bottom) = uv.min(axis=0) / 256, uv.max(axis=0) / 256
            assert right < 0 or left > WIDTH_PX - 1 or bottom < 0 or top > HEIGHT_PX - 1
        if view != NEAR:
            assert depth_m.min() >= 0.05
    assert set(views) == {HIDDEN, NEAR, SEEN}
    assert views.count(HIDDEN) > 30
