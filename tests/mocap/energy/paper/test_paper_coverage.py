"""The `paper` backend draws what `cpu` draws but for a stated few pixels of edges, and counts plain XOR."""

from collections.abc import Callable

import moderngl
import numpy as np
import pytest

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import segments_below
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.cost import Cost
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.gl.device import GlDevice
from services.mocap.energy.paper.backend import PaperBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.types import Floats, Mask

MOST_OF_BOUNDARY = 0.001
"""Of the real body llvmpipe draws 2 in 118,000 boundary pixels otherwise; GPUs may round in other ways."""
RandomPoses = Callable[[int, int], Floats]
Ring = Callable[[int], Rig]
Point = tuple[float, float, float]


def boundary(masks: Mask) -> Mask:
    """The pixels (…, H, W) beside one of another value."""
    on_it: Mask = np.zeros_like(masks)
    across, down = masks[..., 1:] != masks[..., :-1], masks[..., 1:, :] != masks[..., :-1, :]
    on_it[..., 1:] |= across
    on_it[..., :-1] |= across
    on_it[..., 1:, :] |= down
    on_it[..., :-1, :] |= down
    return on_it


def assert_close(
    device: GlDevice,
    body: Body,
    rig: Rig,
    poses: Floats,
    region: Region,
    segments: tuple[int, ...] = ALL_SURFACES,
) -> Mask:
    """Compare both backends; returns the masks (N, C, h, w) of `cpu`."""

    def masks(backend: CpuBackend | PaperBackend, region: Region) -> Mask:
        found = backend.coverage(poses, segments, region)
        return np.array([unpack(planes, rig.n_cameras) for planes in found])

    cpu, paper = CpuBackend(body, rig), PaperBackend(device, body, rig)
    expected, drawn = masks(cpu, region), masks(paper, region)
    paper.close()
    beyond_px = round(1.0 / region.scale)
    around = Region(region.origin_px - beyond_px, region.width_px + 2, region.height_px + 2, region.scale)
    # An edge may lie between a region's last pixel and the next one outside it.
    edge = boundary(masks(cpu, around))[..., 1:-1, 1:-1]
    differs = expected != drawn
    assert not np.any(differs & ~edge)
    assert np.count_nonzero(differs) <= 1 + MOST_OF_BOUNDARY * np.count_nonzero(edge)
    return expected


def test_draws_what_cpu_draws(
    device: GlDevice,
    coarse_body: Body,
    look: Callable[..., Camera],
    random_poses: RandomPoses,
    moderate_viewpoint: tuple[Point, Point, float],
) -> None:
    eye_m, target_m, focal_px = moderate_viewpoint
    rig = Rig.of((look(eye_m, target_m, focal_px),))
    masks = assert_close(device, coarse_body, rig, random_poses(40, 1), Region.whole(rig))
    assert masks.any() == (eye_m != (2.0, 0.0, 1.0))


@pytest.mark.parametrize("origin_px", [(30, 20), (-15, -11), (70, 50), (200, 10), (-200, 10), (10, -200)])
def test_windows(
    device: GlDevice, coarse_body: Body, ring: Ring, random_poses: RandomPoses, origin_px: tuple[int, int]
) -> None:
    region = Region(np.array([origin_px, (12, 7)], np.int32), 33, 29)
    assert_close(device, coarse_body, ring(2), random_poses(20, 2), region)


def test_half_resolution(device: GlDevice, coarse_body: Body, ring: Ring, random_poses: RandomPoses) -> None:
    region = Region(np.array([[0, 0], [5, -3]], np.int32), 48, 36, 0.5)
    assert_close(device, coarse_body, ring(2), random_poses(20, 3), region)


def test_real_bodies(
    device: GlDevice, real_body: Body, skirted_body: Body, ring: Ring, random_poses: RandomPoses
) -> None:
    rig = ring(8)
    for body in (real_body, skirted_body):
        assert_close(device, body, rig, random_poses(5, 4), Region.whole(rig))


def test_some_segments(device: GlDevice, real_body: Body, ring: Ring, random_poses: RandomPoses) -> None:
    rig, arm = ring(3), segments_below("left_shoulder")
    others = tuple(s for s in ALL_SURFACES if s not in arm)
    for segments in (arm, others, (15, 3, 0)):
        assert_close(device, real_body, rig, random_poses(3, 5), Region.whole(rig), segments)


@pytest.mark.parametrize("step_bytes", [16, 256])  # Mesa's and NVIDIA's; both hold with either driver
def test_sixteen_cameras_of_mixed_picture_sizes(
    step_bytes: int,
    device: GlDevice,
    coarse_body: Body,
    look: Callable[..., Camera],
    random_poses: RandomPoses,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    info = device.context.info
    step_bytes = max(step_bytes, info["GL_UNIFORM_BUFFER_OFFSET_ALIGNMENT"])
    changed = info | {"GL_UNIFORM_BUFFER_OFFSET_ALIGNMENT": step_bytes}
    monkeypatch.setattr(moderngl.Context, "info", property(lambda _: changed))
    sizes = [(96, 72), (50, 80), (20, 20), (31, 77)] * 4
    eyes = [(4 * np.cos(k), 4 * np.sin(k), 0.15 * k) for k in range(16)]
    rig = Rig.of(tuple(look(e, width_px=w, height_px=h) for e, (w, h) in zip(eyes, sizes, strict=True)))
    masks = assert_close(device, coarse_body, rig, random_poses(10, 6), Region.whole(rig))
    assert masks.any(axis=(0, 2, 3)).all()


def test_no_camera_touches_the_bit_of_another(
    device: GlDevice, coarse_body: Body, ring: Ring, random_poses: RandomPoses
) -> None:
    """Drawn together or each alone: the same to the last bit, though they cover each other's pixels."""
    rig, poses = ring(11), random_poses(5, 7)
    together = PaperBackend(device, coarse_body, rig).coverage(poses, ALL_SURFACES, Region.whole(rig))
    masks = np.array([unpack(planes, 11) for planes in together])
    for c in range(11):
        alone = Rig(rig.P_px_world[c : c + 1], rig.sizes_px[c : c + 1])
        drawn = PaperBackend(device, coarse_body, alone).coverage(poses, ALL_SURFACES, Region.whole(alone))
        np.testing.assert_array_equal(masks[:, c], drawn[:, 0].astype(bool))
    assert np.all(together[:, 1] < 8)


def test_no_segments_cover_nothing(device: GlDevice, coarse_body: Body, ring: Ring) -> None:
    rig = ring(9)
    assert (
        not PaperBackend(device, coarse_body, rig).coverage(np.zeros((2, N_DOF)), (), Region.whole(rig)).any()
    )


def test_another_cost_is_refused(device: GlDevice, coarse_body: Body, ring: Ring) -> None:
    rig, cost = ring(2), Cost(camera_weights=(1.0, 2.0))
    picture = Picture.whole(rig, np.zeros((1, *rig.shape_px), np.uint8))
    problem = Problem(np.zeros(N_DOF), tuple(range(N_DOF)), ALL_SURFACES, picture, cost)
    with pytest.raises(
        ValueError, match=r"^the paper backend knows only the camera_weights 0 and 1: .*another backend$"
    ):
        PaperBackend(device, coarse_body, rig).energy(problem)


def test_a_camera_that_is_absent_does_not_count(
    device: GlDevice, coarse_body: Body, ring: Ring, random_poses: RandomPoses
) -> None:
    """Cameras are left out by a weight of zero."""
    rig, poses = ring(3), random_poses(4, 5)
    backend, dofs = PaperBackend(device, coarse_body, rig), tuple(range(N_DOF))
    seen = Picture.whole(rig, backend.coverage(poses[:1], ALL_SURFACES, Region.whole(rig))[0])
    cost = Cost(camera_weights=(1.0, 0.0, 1.0))
    weighed = backend.energy(Problem(poses[0], dofs, ALL_SURFACES, seen, cost))(poses)
    absent = Problem(poses[0], dofs, ALL_SURFACES, seen.without_cameras([1]))
    np.testing.assert_array_equal(weighed, backend.energy(absent)(poses))
    assert (weighed < backend.energy(Problem(poses[0], dofs, ALL_SURFACES, seen))(poses))[1:].all()
