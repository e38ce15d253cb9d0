"""The `cpu` backend covers what the reference covers, bit for bit, wherever the cameras stand."""

from collections.abc import Callable

import numpy as np
import pytest

from reference_rasteriser import rasterise
from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF, surface_transforms
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.types import Floats, Mask

Look = Callable[..., Camera]
Point = tuple[float, float, float]


def reference_masks(body: Body, rig: Rig, pose: Floats, region: Region) -> Mask:
    """The masks (C, h, w) that the reference draws."""
    T_world_surface = surface_transforms(pose[None], body.offsets_m)[0]
    masks = np.zeros((rig.n_cameras, region.height_px, region.width_px), bool)
    for c, P in enumerate(region.projections(rig)):
        for (vertices_m, faces), T in zip(body.surfaces, T_world_surface, strict=True):
            vertices_world_m = vertices_m @ T[:3, :3].T + T[:3, 3]
            masks[c] |= rasterise(vertices_world_m, faces, P, region.width_px, region.height_px)
    return masks


def assert_same(body: Body, rig: Rig, poses: Floats, region: Region) -> Mask:
    """Compare backend and reference; returns the masks (N, C, h, w)."""
    planes = CpuBackend(body, rig).coverage(poses, ALL_SURFACES, region)
    masks = np.array([unpack(planes_of_pose, rig.n_cameras) for planes_of_pose in planes])
    for pose, mask in zip(poses, masks, strict=True):
        np.testing.assert_array_equal(mask, reference_masks(body, rig, pose, region))
    return masks


def test_equals_the_reference(
    coarse_body: Body,
    coarsest_body: Body,
    look: Look,
    random_poses: Callable[[int, int], Floats],
    viewpoint: tuple[Point, Point, float],
) -> None:
    eye_m, target_m, focal_px = viewpoint
    rig = Rig.of((look(eye_m, target_m, focal_px),))
    for body, n in ((coarse_body, 6), (coarsest_body, 60)):
        masks = assert_same(body, rig, random_poses(n, 3), Region.whole(rig))
        assert masks.any() == (eye_m != (2.0, 0.0, 1.0))


def test_a_skirt_that_thighs_swing(
    skirted_body: Body,
    real_body: Body,
    ring: Callable[[int], Rig],
    random_poses: Callable[[int, int], Floats],
) -> None:
    rig, poses = ring(1), random_poses(2, 4)
    dressed = assert_same(skirted_body, rig, poses, Region.whole(rig))
    bare = assert_same(real_body, rig, poses, Region.whole(rig))
    assert np.all(dressed >= bare)
    assert np.all(dressed.sum(axis=(1, 2, 3)) > bare.sum(axis=(1, 2, 3)))


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
    whole = backend.coverage(poses, ALL_SURFACES, Region.whole(rig))
    window = backend.coverage(poses, ALL_SURFACES, Region(np.full((2, 2), 17, np.int32), 50, 40))
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
    assert not coarse_backend.coverage(np.zeros((2, N_DOF)), (), region).any()


def test_degenerate_triangles(
    degenerate_body: Body, ring: Callable[[int], Rig], random_poses: Callable[[int, int], Floats]
) -> None:
    assert_same(degenerate_body, ring(2), random_poses(4, 7), Region.whole(ring(2)))


def test_a_box_that_faces_the_camera_square_on(square_on: tuple[Body, Rig]) -> None:
    masks = assert_same(*square_on, np.zeros((1, N_DOF)), Region.whole(square_on[1]))
    assert masks.sum() == 16 * 16  # by the top-left rule
    assert masks[0, 0, 16:32, 24:40].all()
