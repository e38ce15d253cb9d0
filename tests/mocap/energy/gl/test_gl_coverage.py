"""The `gl` backend covers what the `cpu` backend covers, bit for bit, wherever the cameras stand."""

from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import segments_below
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy import gl
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.gl import device as device_module
from services.mocap.energy.gl import drawing
from services.mocap.energy.gl.backend import GlBackend
from services.mocap.energy.gl.device import GlDevice, GlUnavailableError
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.types import Bytes, Floats

LEFT_ARM = segments_below("left_shoulder")
Both = Callable[[Body, Rig], tuple[GlBackend, CpuBackend]]
Look = Callable[..., Camera]
RandomPoses = Callable[[int, int], Floats]
Ring = Callable[[int], Rig]
Point = tuple[float, float, float]


def same_coverage(
    backends: tuple[GlBackend, CpuBackend], poses: Floats, segments: tuple[int, ...], region: Region
) -> Bytes:
    """The planes that both backends draw."""
    gl, cpu = backends
    planes = gl.coverage(poses, segments, region)
    np.testing.assert_array_equal(planes, cpu.coverage(poses, segments, region))
    return planes


def test_cameras_anywhere(
    both: Both,
    coarse_body: Body,
    real_body: Body,
    look: Look,
    random_poses: RandomPoses,
    viewpoint: tuple[Point, Point, float],
) -> None:
    eye_m, target_m, focal_px = viewpoint
    rig = Rig.of((look(eye_m, target_m, focal_px),))
    for body, n in ((coarse_body, 60), (real_body, 10)):
        planes = same_coverage(both(body, rig), random_poses(n, 1), ALL_SURFACES, Region.whole(rig))
        assert planes.any() == (eye_m != (2.0, 0.0, 1.0))


@pytest.mark.parametrize("origin_px", [(30, 20), (-15, -11), (70, 50), (200, 10), (-200, 10), (10, -200)])
@pytest.mark.parametrize("segments", [ALL_SURFACES, LEFT_ARM])
def test_windows(
    both: Both,
    real_body: Body,
    ring: Ring,
    random_poses: RandomPoses,
    origin_px: tuple[int, int],
    segments: tuple[int, ...],
) -> None:
    region = Region(np.array([origin_px, origin_px[::-1]], np.int32), 33, 29)
    same_coverage(both(real_body, ring(2)), random_poses(20, 2), segments, region)


def test_a_skirt_that_thighs_swing(
    both: Both, skirted_body: Body, ring: Ring, random_poses: RandomPoses
) -> None:
    rig = ring(3)
    assert same_coverage(both(skirted_body, rig), random_poses(4, 8), ALL_SURFACES, Region.whole(rig)).any()


def test_half_resolution(both: Both, real_body: Body, ring: Ring, random_poses: RandomPoses) -> None:
    region = Region(np.array([[0, 0], [5, -3]], np.int32), 48, 36, 0.5)
    assert same_coverage(both(real_body, ring(2)), random_poses(20, 3), ALL_SURFACES, region).any()


def test_more_than_eight_cameras_and_mixed_picture_sizes(
    both: Both, coarse_body: Body, look: Look, random_poses: RandomPoses
) -> None:
    sizes = [(96, 72), (50, 80), (20, 20), (64, 33)] * 4
    eyes = [(4 * np.cos(k), 4 * np.sin(k), 0.2 * k) for k in range(16)]
    for n in (9, 16):
        cameras = tuple(look(e, width_px=w, height_px=h) for e, (w, h) in zip(eyes, sizes, strict=True))
        rig = Rig.of(cameras[:n])
        planes = same_coverage(both(coarse_body, rig), random_poses(5, 6), ALL_SURFACES, Region.whole(rig))
        assert planes.shape == (5, 2, 80, 96)


def test_batches_of_many_parts(
    both: Both, real_body: Body, ring: Ring, random_poses: RandomPoses, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seven images a part: parts begin and end amid the cameras of a pose."""
    monkeypatch.setattr(drawing, "_PART_IMAGES", 7)
    same_coverage(both(real_body, ring(3)), random_poses(9, 8), ALL_SURFACES, Region.whole(ring(3)))


@pytest.mark.parametrize("segments", [(), (3,), (15, 0, 7)])
def test_any_segments_in_any_order(
    both: Both, real_body: Body, ring: Ring, random_poses: RandomPoses, segments: tuple[int, ...]
) -> None:
    planes = same_coverage(both(real_body, ring(2)), random_poses(3, 9), segments, Region.whole(ring(2)))
    assert planes.any() == bool(segments)


def test_no_poses(both: Both, coarse_body: Body, ring: Ring) -> None:
    assert (
        same_coverage(
            both(coarse_body, ring(2)), np.zeros((0, N_DOF)), ALL_SURFACES, Region.whole(ring(2))
        ).shape[0]
        == 0
    )


def test_degenerate_triangles(
    both: Both, degenerate_body: Body, ring: Ring, random_poses: RandomPoses
) -> None:
    same_coverage(both(degenerate_body, ring(2)), random_poses(40, 7), ALL_SURFACES, Region.whole(ring(2)))


def test_a_box_that_faces_the_camera_square_on(both: Both, square_on: tuple[Body, Rig]) -> None:
    region = Region.whole(square_on[1])
    assert same_coverage(both(*square_on), np.zeros((1, N_DOF)), ALL_SURFACES, region).sum() == 16 * 16


@pytest.mark.parametrize("off_by", ["+ 2.0", "+ 1.0", "- 0.5", "- 1.0", "- 2.0"])
def test_a_division_that_is_off_changes_nothing(
    real_body: Body,
    ring: Ring,
    random_poses: RandomPoses,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    without_opengl: Callable[[Exception], NoReturn],
    off_by: str,
) -> None:
    """GLSL does not promise that it is rounded correctly: what a crossing is must not rest on it."""
    shaders, division = files(gl) / "shaders", "double(crossing) / double(divisor)"
    (tmp_path / "shaders").mkdir()
    for shader in shaders.iterdir():
        text = shader.read_text("utf-8")
        assert (division in text) == (shader.name == "outline.glsl")
        (tmp_path / "shaders" / shader.name).write_text(text.replace(division, f"{division} {off_by}"))
    monkeypatch.setattr(device_module, "files", lambda _: tmp_path)
    try:
        device = GlDevice()
    except GlUnavailableError as error:
        without_opengl(error)
    rig = ring(2)
    backends = GlBackend(device, real_body, rig), CpuBackend(real_body, rig)
    assert same_coverage(backends, random_poses(20, 10), ALL_SURFACES, Region.whole(rig)).any()
    device.close()
