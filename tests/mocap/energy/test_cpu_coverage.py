"""The `cpu` backend covers what the reference covers, bit for bit, wherever the cameras stand."""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import segment_transforms
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.energy.reference import rasterise
from services.mocap.types import Floats, Mask

ALL = tuple(range(16))
Look = Callable[..., Camera]


def reference_masks(body: Body, rig: Rig, pose: Floats, region: Region) -> Mask:
    """The masks (C, h, w) that the reference draws."""
    T_world_segment = segment_transforms(pose[None], body.offsets_m)[0]
    masks = np.zeros((rig.n_cameras, region.height_px, region.width_px), bool)
    for c, P in enumerate(region.projections(rig)):
        for s, T in enumerate(T_world_segment):
            vertices_world_m = body.vertices_m[s] @ T[:3, :3].T + T[:3, 3]
            masks[c] |= rasterise(vertices_world_m, body.faces[s], P, region.width_px, region.height_px)
    return masks


def assert_same(body: Body, rig: Rig, poses: Floats, region: Region) -> Mask:
    """Compare backend and reference; returns the masks (N, C, h, w)."""
    planes = CpuBackend(body, rig).coverage(poses, ALL, region)
    masks = np.array([unpack(planes_of_pose, rig.n_cameras) for planes_of_pose in planes])
    for pose, mask in zip(poses, masks, strict=True):
        np.testing.assert_array_equal(mask, reference_masks(body, rig, pose, region))
    return masks


@pytest.mark.parametrize(
    ("eye_m", "target_m", "focal_px"),
    [
        pytest.param((4.0, 0.5, 1.4), (0.0, 0.0, 0.9), 90.0, id="inside"),
        pytest.param((1.2, -0.8, 1.6), (0.5, 0.4, 0.9), 90.0, id="partly outside"),
        pytest.param((2.0, 0.0, 1.0), (4.0, 0.2, 1.0), 90.0, id="behind the camera"),
        pytest.param((0.35, 0.25, 1.1), (0.0, 0.0, 0.9), 60.0, id="about the near plane"),
        pytest.param((0.0, 0.02, 0.95), (1.0, 0.3, 0.9), 60.0, id="within the body"),
        pytest.param((0.9, 0.3, 0.4), (0.0, 0.0, 0.9), 20.0, id="wide angle"),
        pytest.param((40.0, 5.0, 3.0), (0.0, 0.0, 0.9), 90.0, id="a few pixels in all"),
        pytest.param((30.0, 5.0, 3.0), (0.0, 0.3, 1.3), 4000.0, id="long focal length"),
    ],
)
def test_equals_the_reference(
    coarse_body: Body,
    look: Look,
    random_poses: Callable[[int, int], Floats],
    eye_m: tuple[float, float, float],
    target_m: tuple[float, float, float],
    focal_px: float,
) -> None:
    rig = Rig.of((look(eye_m, target_m, focal_px),))
    masks = assert_same(coarse_body, rig, random_poses(8, 1), Region.whole(rig))
    assert masks.any() == (eye_m != (2.0, 0.0, 1.0))


@pytest.mark.parametrize("origin_px", [(30, 20), (-15, -11), (70, 50), (200, 10), (-200, 10), (10, -200)])
def test_windows_equal_the_reference(
    coarse_body: Body,
    ring: Callable[[int], Rig],
    random_poses: Callable[[int, int], Floats],
    origin_px: tuple[int, int],
) -> None:
    region = Region(np.array([origin_px], np.int32), 33, 29)
    assert_same(coarse_body, ring(1), random_poses(4, 2), region)


def test_half_resolution_equals_the_reference(
    coarse_body: Body, ring: Callable[[int], Rig], random_poses: Callable[[int, int], Floats]
) -> None:
    region = Region(np.array([[0, 0], [5, -3]], np.int32), 48, 36, 0.5)
    assert_same(coarse_body, ring(2), random_poses(4, 3), region)


def test_a_window_is_a_crop_of_the_whole(
    real_body: Body, ring: Callable[[int], Rig], random_poses: Callable[[int, int], Floats]
) -> None:
    rig = ring(2)
    backend, poses = CpuBackend(real_body, rig), random_poses(3, 4)
    whole = backend.coverage(poses, ALL, Region.whole(rig))
    window = backend.coverage(poses, ALL, Region(np.full((2, 2), 17, np.int32), 50, 40))
    np.testing.assert_array_equal(window, whole[:, :, 17:57, 17:67])


def test_the_real_body_equals_the_reference(
    real_body: Body, ring: Callable[[int], Rig], random_poses: Callable[[int, int], Floats]
) -> None:
    rig = ring(1)
    assert_same(real_body, rig, random_poses(2, 5), Region.whole(rig))


def test_more_than_eight_cameras_and_mixed_picture_sizes(
    coarse_body: Body, look: Look, random_poses: Callable[[int, int], Floats]
) -> None:
    sizes = [(96, 72), (50, 80), (20, 20)] * 3
    eyes = [(4 * np.cos(k), 4 * np.sin(k), 0.2 * k) for k in range(9)]
    cameras = tuple(look(e, width_px=w, height_px=h) for e, (w, h) in zip(eyes, sizes, strict=True))
    rig = Rig.of(cameras)
    masks = assert_same(coarse_body, rig, random_poses(1, 6), Region.whole(rig))
    assert masks.shape == (1, 9, 80, 96)
    assert masks[0].any(axis=(1, 2)).all()


def test_no_segments_cover_nothing(coarse_backend: CpuBackend, ring: Callable[[int], Rig]) -> None:
    region = Region.whole(ring(3))
    assert not coarse_backend.coverage(np.zeros((2, 35)), (), region).any()


def _with_segment(body: Body, segment: int, mesh: trimesh.Trimesh) -> Body:
    vertices_m, faces = list(body.vertices_m), list(body.faces)
    vertices_m[segment], faces[segment] = np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32)
    return Body(body.offsets_m, tuple(vertices_m), tuple(faces), body.height_m)


def test_degenerate_triangles(
    coarse_body: Body, ring: Callable[[int], Rig], random_poses: Callable[[int, int], Floats]
) -> None:
    """Faces without area, slivers, a flat segment and one that shrinks to a point."""
    flat = trimesh.creation.icosphere(subdivisions=1, radius=0.2)
    flat.vertices[:, 2] = 0.0
    point = trimesh.creation.icosphere(subdivisions=0)
    point.vertices *= 1e-9
    sliver = trimesh.creation.icosphere(subdivisions=2, radius=0.4)
    sliver.vertices[:, :2] *= 1e-6
    collapsed = trimesh.creation.icosphere(subdivisions=1, radius=0.15)
    collapsed.vertices[:20] = collapsed.vertices[0]
    body = coarse_body
    for segment, mesh in enumerate((flat, point, sliver, collapsed)):
        body = _with_segment(body, segment, mesh)
    assert_same(body, ring(2), random_poses(4, 7), Region.whole(ring(2)))


def test_a_box_that_faces_the_camera_square_on(coarse_body: Body) -> None:
    """Corners on pixel centres and faces seen edge-on: every tie of the rule."""
    box = trimesh.creation.box(extents=(0.5, 0.5, 0.5))
    body = Body(
        coarse_body.offsets_m * 0, (np.asarray(box.vertices),) * 16, (np.asarray(box.faces),) * 16, 1.0
    )
    R = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    K = np.array([[64.0, 0.0, 32.0], [0.0, 64.0, 24.0], [0.0, 0.0, 1.0]])
    camera = Camera("camera", 64, 48, K, np.zeros(4), R, np.array([0.0, 0.0, 2.25]))
    rig = Rig.of((camera,))
    masks = assert_same(body, rig, np.zeros((1, 35)), Region.whole(rig))
    assert masks.sum() == 16 * 16  # from pixel 24 up to but not including 40, by the top-left rule
