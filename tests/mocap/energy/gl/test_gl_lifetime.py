"""Opening, losing and closing: clear errors, and nothing left behind."""

import gc
from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np
import psutil
import pytest

from services.mocap.body.actor import Body
from services.mocap.body.skeleton import dofs_of, segments_below
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Energy, Problem
from services.mocap.energy.gl import device as device_module
from services.mocap.energy.gl.backend import GlBackend
from services.mocap.energy.gl.device import GlDevice, GlLostError, GlUnavailableError
from services.mocap.energy.picture import Picture, Region
from services.mocap.types import Floats

ALL = tuple(range(16))
HAND, HAND_DOFS = segments_below("left_wrist"), dofs_of("left_wrist")
Ring = Callable[[int], Rig]


def hand_energy(backend: GlBackend, rig: Rig, pose: Floats) -> Energy:
    picture = Picture.whole(rig, np.zeros((1, *rig.shape_px), np.uint8))
    window = picture.window(np.full((rig.n_cameras, 2), 30, np.int32), 16, 16)
    return backend.energy(Problem(pose, HAND_DOFS, HAND, window))


def test_says_what_it_is(shared_device: GlDevice) -> None:
    assert shared_device.renderer in shared_device.context.info["GL_RENDERER"]
    assert shared_device.version[0] == "4"
    assert shared_device.is_hardware != ("llvmpipe" in shared_device.renderer)


def test_no_such_egl_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GLCONTEXT_DEVICE_INDEX", "4711")
    with pytest.raises(GlUnavailableError, match=r"^OpenGL 4.3 on EGL cannot be opened: .+$"):
        GlDevice()


@pytest.mark.usefixtures("shared_device")
def test_an_extension_that_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(moderngl.Context, "extensions", property(lambda _: set()))
    with pytest.raises(GlUnavailableError, match=r"GL_ARB_gpu_shader_int64 is missing"):
        GlDevice()


@pytest.mark.usefixtures("shared_device")
def test_a_kernel_that_does_not_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_module, "_HEADER", "#version 430\n#define GROUP nonsense\n")
    with pytest.raises(GlUnavailableError, match=r"the kernel compose does not compile: \d.*\berror\b.*$"):
        GlDevice()


def test_close_releases_every_buffer(
    own_device: GlDevice,
    coarse_body: Body,
    ring: Ring,
    standing_pose: Floats,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[moderngl.Buffer] = []
    make = moderngl.Context.buffer

    def recorded(context: moderngl.Context, *arguments: Any, **named: Any) -> moderngl.Buffer:
        made.append(make(context, *arguments, **named))
        return made[-1]

    monkeypatch.setattr(moderngl.Context, "buffer", recorded)
    rig = ring(3)
    backend = GlBackend(own_device, coarse_body, rig)
    backend.coverage(standing_pose[None], ALL, Region.whole(rig))
    energy = hand_energy(backend, rig, standing_pose)
    energy(np.zeros((50, len(HAND_DOFS))))
    assert len(made) > 10
    backend.close()
    assert all(type(buffer.mglo).__name__ == "InvalidObject" for buffer in made)
    backend.close()
    with pytest.raises(GlLostError, match="this gl backend is closed"):
        energy(np.zeros((1, len(HAND_DOFS))))


def test_ten_thousand_evaluations_leave_memory_flat(
    shared_device: GlDevice,
    coarse_body: Body,
    ring: Ring,
    standing_pose: Floats,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = ring(2)
    backend = GlBackend(shared_device, coarse_body, rig)
    energy, one = hand_energy(backend, rig, standing_pose), np.zeros((1, len(HAND_DOFS)))
    for n in (1, 10, 500):
        energy(one.repeat(n, axis=0))

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("a buffer was made during an evaluation")

    monkeypatch.setattr(moderngl.Context, "buffer", refuse)
    before = _resident_bytes()
    for _ in range(1000):
        energy(one)
    for _ in range(19):
        energy(one.repeat(500, axis=0))
    assert _resident_bytes() - before < 2_000_000
    backend.close()


def _resident_bytes() -> int:
    gc.collect()
    return int(psutil.Process().memory_info().rss)


def test_a_closed_device_is_a_lost_one(
    own_device: GlDevice, coarse_body: Body, ring: Ring, standing_pose: Floats
) -> None:
    rig = ring(2)
    backend = GlBackend(own_device, coarse_body, rig)
    energy = hand_energy(backend, rig, standing_pose)
    own_device.close()
    own_device.close()
    for use in (
        lambda: energy(np.zeros((1, len(HAND_DOFS)))),
        lambda: backend.coverage(standing_pose[None], ALL, Region.whole(rig)),
        lambda: GlBackend(own_device, coarse_body, rig),
    ):
        with pytest.raises(GlLostError, match="OpenGL is closed"):
            use()
    backend.close()


@pytest.mark.parametrize("broken", ["error", "read"])
def test_a_driver_that_fails_is_a_lost_device(
    own_device: GlDevice,
    coarse_body: Body,
    ring: Ring,
    standing_pose: Floats,
    monkeypatch: pytest.MonkeyPatch,
    broken: str,
) -> None:
    rig = ring(2)
    backend = GlBackend(own_device, coarse_body, rig)
    energy = hand_energy(backend, rig, standing_pose)

    def fail(*_: Any) -> bytes:
        raise moderngl.Error("cannot map the buffer")

    if broken == "error":
        monkeypatch.setattr(moderngl.Context, "error", property(lambda _: "GL_UNKNOWN_ERROR"))
    else:
        monkeypatch.setattr(moderngl.Buffer, "read", fail)
    with pytest.raises(GlLostError, match=r"stopped working: .*(GL_UNKNOWN_ERROR|cannot map the buffer)"):
        energy(np.zeros((1, len(HAND_DOFS))))


def test_backends_share_a_device(
    shared_device: GlDevice, coarse_body: Body, real_body: Body, ring: Ring, standing_pose: Floats
) -> None:
    rig = ring(2)
    first, second = GlBackend(shared_device, coarse_body, rig), GlBackend(shared_device, real_body, rig)
    drawn = first.coverage(standing_pose[None], ALL, Region.whole(rig))
    assert not np.array_equal(second.coverage(standing_pose[None], ALL, Region.whole(rig)), drawn)
    second.close()
    np.testing.assert_array_equal(first.coverage(standing_pose[None], ALL, Region.whole(rig)), drawn)
    first.close()


def test_another_current_context_does_not_matter(
    own_device: GlDevice, coarse_body: Body, ring: Ring, standing_pose: Floats
) -> None:
    rig = ring(2)
    backend = GlBackend(own_device, coarse_body, rig)
    drawn = backend.coverage(standing_pose[None], ALL, Region.whole(rig))
    other = GlDevice()
    with other.current():
        np.testing.assert_array_equal(backend.coverage(standing_pose[None], ALL, Region.whole(rig)), drawn)
    other.close()
    np.testing.assert_array_equal(backend.coverage(standing_pose[None], ALL, Region.whole(rig)), drawn)


def test_the_device_stays_current_until_the_outermost_user_is_done(
    shared_device: GlDevice, coarse_body: Body, ring: Ring, standing_pose: Floats
) -> None:
    rig = ring(2)
    backend = GlBackend(shared_device, coarse_body, rig)
    with shared_device.current() as context:
        buffer = context.buffer(b"four")
        backend.coverage(standing_pose[None], ALL, Region.whole(rig))
        assert buffer.read() == b"four"
        buffer.release()
    backend.close()


def test_a_body_that_is_not_closed_is_refused(shared_device: GlDevice, coarse_body: Body, ring: Ring) -> None:
    faces = (coarse_body.faces[0][1:], *coarse_body.faces[1:])
    body = Body(coarse_body.offsets_m, coarse_body.vertices_m, faces, coarse_body.height_m)
    with pytest.raises(ValueError, match="not closed"):
        GlBackend(shared_device, body, ring(1))


def test_a_picture_too_large_is_refused(shared_device: GlDevice, coarse_body: Body, ring: Ring) -> None:
    backend = GlBackend(shared_device, coarse_body, ring(1))
    region = Region(np.zeros((1, 2), np.int32), 16384, 16384)
    with pytest.raises(ValueError, match="16384 x 16384 pixels are too many"):
        backend.coverage(np.zeros((1, 35)), ALL, region)
    backend.close()
