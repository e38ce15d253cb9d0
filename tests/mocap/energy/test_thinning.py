"""Thinned meshes stay closed, as near to the full mesh as they say, and as large in the picture."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import segment_transforms
from services.mocap.body.skeleton import SEGMENT_NAMES
from services.mocap.body.surface import Level
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.detail.bound import farthest_bound
from services.mocap.energy.detail.distance import farthest_point, tree_of
from services.mocap.energy.detail.thinning import ERRORS_M, thinned_levels
from services.mocap.energy.picture import Region
from services.mocap.types import Floats, Ints, Mask

FOCAL_PX, WIDTH_PX, HEIGHT_PX = 320.0, 320, 240
FINER = 4  # times as many pixels a side, so that what lies between two pixel centres is seen
PIXEL_SAMPLING_PX = 0.75
"""To the nearest pixel centre, and 1/256 pixel of snapping."""


@pytest.fixture(scope="module")
def ladders(real_body: Body) -> list[list[Level]]:
    return [thinned_levels(v, f) for v, f in zip(real_body.vertices_m, real_body.faces, strict=True)]


@pytest.fixture(scope="module")
def rig_of(look: Callable[..., Camera]) -> Callable[[int], Rig]:
    """`rig_of(scale)`: eight cameras 4 m from the middle, that many times 320 pixels wide."""

    def make(scale: int) -> Rig:
        angles = 2 * np.pi * np.arange(8) / 8 + 0.2
        size = {"focal_px": FOCAL_PX * scale, "width_px": WIDTH_PX * scale, "height_px": HEIGHT_PX * scale}
        return Rig.of(tuple(look((4 * np.cos(a), 4 * np.sin(a), 1.4), **size) for a in angles))

    return make


def _body_of(body: Body, ladders: list[list[Level]], k: int) -> Body:
    levels = [ladder[k] for ladder in ladders]
    vertices_m, faces = tuple(lv.vertices_m for lv in levels), tuple(lv.faces for lv in levels)
    return replace(body, vertices_m=vertices_m, faces=faces)


def _silhouettes(body: Body, rig: Rig, poses: Floats) -> Mask:
    """(N, C, H, W) of the whole body."""
    planes = CpuBackend(body, rig).coverage(poses, tuple(range(len(SEGMENT_NAMES))), Region.whole(rig))
    return np.array([unpack(p, rig.n_cameras) for p in planes])


def _distance_px(mask: Mask) -> NDArray[np.float32]:
    """From every pixel to the nearest one in the mask."""
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE))


def _bounds_px(body: Body, rig: Rig, pose: Floats, errors_m: Floats) -> Floats:
    """(C,) by how much moving any surface point by its segment's error can move it in the picture."""
    bounds_px = np.zeros(rig.n_cameras)
    T_world_segment = segment_transforms(pose[None], body.offsets_m)[0]
    for vertices_m, T, error_m in zip(body.vertices_m, T_world_segment, errors_m, strict=True):
        points_world_m = vertices_m @ T[:3, :3].T + T[:3, 3]
        for c, P in enumerate(rig.P_px_world):
            homogeneous = points_world_m @ P[:, :3].T + P[:, 3]
            uv, depth_m = homogeneous[:, :2] / homogeneous[:, 2:], homogeneous[:, 2]
            stretch = np.linalg.norm(P[:2, :3] - uv[..., None] * P[2, :3], ord=2, axis=(1, 2))
            moved_px = stretch * error_m / (depth_m - error_m)
            bounds_px[c] = max(bounds_px[c], float(moved_px.max()))
    return bounds_px


def _sampled(vertices_m: Floats, faces: Ints, n: int) -> Floats:
    mesh = trimesh.Trimesh(vertices_m, faces, process=False)
    return np.concatenate([trimesh.sample.sample_surface(mesh, n, seed=1)[0], vertices_m[np.unique(faces)]])


def _assert_sound(vertices_m: Floats, faces: Ints, levels: list[Level], errors_m: tuple[float, ...]) -> None:
    full_tree, n_before = tree_of(vertices_m, faces), len(faces)
    for level in levels:
        mesh = trimesh.Trimesh(level.vertices_m, level.faces, process=False)
        assert mesh.is_watertight and mesh.is_winding_consistent
        assert mesh.volume > 0
        assert len(level.faces) <= 0.7 * n_before
        assert any(level.error_m <= allowed for allowed in errors_m)
        tree = tree_of(level.vertices_m, level.faces)
        assert farthest_point(_sampled(vertices_m, faces, 3000), tree) <= level.error_m + 1e-9
        samples_m = _sampled(level.vertices_m, level.faces, 3000)
        assert farthest_point(samples_m, full_tree) <= level.error_m + 1e-9
        n_before = len(level.faces)


def test_a_body_is_thinned_to_few_faces(real_body: Body, ladders: list[list[Level]]) -> None:
    for vertices_m, faces, ladder in zip(real_body.vertices_m, real_body.faces, ladders, strict=True):
        assert len(ladder) == len(ERRORS_M)
        assert all(level.error_m <= allowed for level, allowed in zip(ladder, ERRORS_M, strict=True))
        _assert_sound(vertices_m, faces, ladder, ERRORS_M)
    totals = [sum(len(ladder[k].faces) for ladder in ladders) for k in range(len(ERRORS_M))]
    assert all(n <= most for n, most in zip(totals, (8500, 4500, 2200, 1000), strict=True))


def test_the_same_mesh_gives_the_same_levels(real_body: Body, ladders: list[list[Level]]) -> None:
    again = thinned_levels(real_body.vertices_m[6], real_body.faces[6])
    for level, other in zip(ladders[6], again, strict=True):
        assert np.array_equal(level.vertices_m, other.vertices_m) and np.array_equal(level.faces, other.faces)
        assert level.error_m == other.error_m


@pytest.mark.parametrize("k", range(len(ERRORS_M)))
def test_silhouettes_lie_no_farther_apart_than_the_error(
    real_body: Body,
    ladders: list[list[Level]],
    rig_of: Callable[[int], Rig],
    random_poses: Callable[[int, int], Floats],
    k: int,
) -> None:
    rig, pose = rig_of(FINER), random_poses(1, 3)
    full = _silhouettes(real_body, rig, pose)[0]
    thin = _silhouettes(_body_of(real_body, ladders, k), rig, pose)[0]
    errors_m = np.array([ladder[k].error_m for ladder in ladders])
    bounds_px = _bounds_px(real_body, rig, pose[0], errors_m) + PIXEL_SAMPLING_PX
    for a, b, bound_px in zip(full, thin, bounds_px, strict=True):
        assert _distance_px(a)[b].max() <= bound_px
        assert _distance_px(b)[a].max() <= bound_px


@pytest.mark.parametrize(
    ("k", "mean_share", "worst_share"),
    [(0, 0.004, 0.008), (1, 0.008, 0.014), (2, 0.016, 0.026), (3, 0.034, 0.05)],
)
def test_silhouettes_differ_in_few_pixels(
    real_body: Body,
    ladders: list[list[Level]],
    rig_of: Callable[[int], Rig],
    random_poses: Callable[[int, int], Floats],
    k: int,
    mean_share: float,
    worst_share: float,
) -> None:
    rig, poses = rig_of(1), random_poses(12, 3)
    full = _silhouettes(real_body, rig, poses)
    thin = _silhouettes(_body_of(real_body, ladders, k), rig, poses)
    areas_px, differing_px = full.sum(axis=(2, 3)), (full ^ thin).sum(axis=(2, 3))
    assert differing_px.sum() <= mean_share * areas_px.sum()
    assert (differing_px / areas_px).max() <= worst_share
    assert abs(thin.sum() / full.sum() - 1) < 0.01


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.icosphere(subdivisions=4, radius=0.1),
        trimesh.creation.capsule(height=0.3, radius=0.05),
        trimesh.creation.box((0.2, 0.3, 0.4)).subdivide().subdivide().subdivide(),
        trimesh.creation.torus(0.1, 0.03),
        trimesh.creation.icosphere(subdivisions=4, radius=0.1) + trimesh.creation.icosphere(3, 0.03),
    ],
    ids=["ball", "capsule", "box", "ring", "two"],
)
def test_own_meshes_are_thinned(mesh: trimesh.Trimesh) -> None:
    vertices_m, faces = np.array(mesh.vertices), np.array(mesh.faces, np.int32)
    levels = thinned_levels(vertices_m, faces)
    assert len(levels) >= 1
    _assert_sound(vertices_m, faces, levels, ERRORS_M)


def test_a_flat_box_needs_few_faces() -> None:
    mesh = trimesh.creation.box((0.2, 0.3, 0.4)).subdivide().subdivide().subdivide()
    levels = thinned_levels(np.array(mesh.vertices), np.array(mesh.faces, np.int32))
    assert len(levels[0].faces) <= 24


def test_faces_without_area_do_no_harm() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    vertices_m, faces = np.array(ball.vertices), np.array(ball.faces, np.int32)
    vertices_m[faces[::40, 1]] = vertices_m[faces[::40, 0]]
    levels = thinned_levels(vertices_m, faces)
    assert levels
    _assert_sound(vertices_m, faces, levels, ERRORS_M)


def test_a_vertex_without_faces_does_not_count() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    vertices_m, faces = np.array(ball.vertices), np.array(ball.faces, np.int32)
    lonely = np.concatenate([[[9.0, 9.0, 9.0]], vertices_m])
    levels, expected = thinned_levels(lonely, faces + 1), thinned_levels(vertices_m, faces)
    assert [level.error_m for level in levels] == [level.error_m for level in expected]


@pytest.mark.parametrize("how", ["tetrahedron", "open", "inside out", "none"])
def test_what_cannot_be_thinned_has_no_levels(how: str) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    vertices_m, faces = np.array(ball.vertices), np.array(ball.faces, np.int32)
    if how == "tetrahedron":
        vertices_m = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
        faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
    faces = {"open": faces[1:], "inside out": faces[:, ::-1], "none": faces[:0]}.get(how, faces)
    assert thinned_levels(vertices_m, faces) == []


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.01), st.floats(0.02, 0.4), st.floats(0.0005, 0.02))
def test_any_lump_keeps_within_the_error(seed: int, rough_m: float, radius_m: float, error_m: float) -> None:
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=radius_m)
    vertices_m = np.array(ball.vertices) * rng.uniform(0.3, 1.0, 3) + rng.normal(0, 0.1 * rough_m, (642, 3))
    faces = np.array(ball.faces, np.int32)
    levels = thinned_levels(vertices_m, faces, (error_m, 2 * error_m))
    _assert_sound(vertices_m, faces, levels, (2 * error_m,))


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_the_bound_is_tight_and_never_too_small(seed: int) -> None:
    """Against triangles that lie anywhere: dense samples come close to the bound, and none lies beyond it."""
    rng = np.random.default_rng(seed)
    source, target = rng.uniform(0, 1, (9, 3)), rng.uniform(0, 1, (30, 3))
    source_faces, target_faces = (
        np.arange(9, dtype=np.int32).reshape(3, 3),
        np.arange(30, dtype=np.int32).reshape(10, 3),
    )
    tree = tree_of(target, target_faces)
    bound = farthest_bound(source[source_faces], tree, 0.02, np.inf)
    farthest = farthest_point(_sampled(source, source_faces, 20000), tree)
    assert farthest <= bound + 1e-9
    assert bound <= max(1.02 * (farthest + 0.03), 0.02)
