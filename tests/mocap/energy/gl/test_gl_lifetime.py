"""Opening, losing and closing: clear errors, and nothing left behind."""

import ctypes
import re
from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np
import pytest

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import SEGMENT_NAMES, dofs_of, segments_below
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Energy, Problem
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.gl import device as device_module
from services.mocap.energy.gl.backend import GlBackend
from services.mocap.energy.gl.device import GlDevice, GlLostError, GlUnavailableError, is_software
from services.mocap.energy.picture import Picture, Region
from services.mocap.types import Floats

ALL = tuple(range(len(SEGMENT_NAMES)))
HAND, HAND_DOFS = segments_below("left_wrist"), dofs_of("left_wrist")
Growth = Callable[[Callable[[], object]], int]
Ring = Callable[[int], Rig]


def hand_energy(backend: GlBackend, rig: Rig, pose: Floats) -> Energy:
    picture = Picture.whole(rig, np.zeros((1, *rig.shape_px), np.uint8))
    window = picture.window(np.full((rig.n_cameras, 2), 30, np.int32), 16, 16)
    return backend.energy(Problem(pose, HAND_DOFS, HAND, window))


def test_says_what_it_is(shared_device: GlDevice) -> None:
    """As the driver says it when asked past moderngl."""
    ask = ctypes.CDLL("libGL.so.1").glGetString
    ask.restype = ctypes.c_char_p
    with shared_device.current():
        renderer, version = (ask(number).decode() for number in (0x1F01, 0x1F02))
    assert (shared_device.renderer, shared_device.version) == (renderer, version)
    assert shared_device.version[0] == "4"


@pytest.mark.parametrize(
    ("renderer", "software"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", True),
        ("softpipe", True),
        ("Software Rasterizer", True),
        ("D3D12 (Microsoft Basic Render Driver)", True),
        ("zink Vulkan 1.3(llvmpipe (LLVM 17.0.6, 256 bits) (MESA_LLVMPIPE))", True),
        ("Google SwiftShader", True),
        ("NVIDIA H100 PCIe/PCIe/SSE2", False),
        ("D3D12 (NVIDIA GeForce RTX 3080)", False),
        ("AMD Radeon RX 6800 (navi21, LLVM 15.0.6, DRM 3.49, 6.1.0)", False),
        ("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", False),
    ],
)
def test_programs_that_draw_are_known_by_their_names(renderer: str, software: bool) -> None:
    assert is_software(renderer) == software


def test_closing_gives_the_context_back(device: GlDevice, resident_growth: Growth) -> None:
    """One that stays open holds about 3 MB: a hundred that are closed must not take a tenth of theirs."""
    device.close()

    def open_and_close(times: int) -> None:
        for _ in range(times):
            GlDevice().close()

    open_and_close(5)
    assert resident_growth(lambda: open_and_close(100)) < 30 << 20


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


@pytest.mark.usefixtures("shared_device")
def test_a_kernel_that_does_not_link_as_nvidia_says_it(monkeypatch: pytest.MonkeyPatch) -> None:
    cause = "(0) : fatal error C9999: can't find __setVectorIndex function in stdlib"
    log = f"GLSL Linker failed\n\nProgram\n=======\nCompute info\n------------\n{cause}\n\n\n"

    def refuse(*_: Any, **__: Any) -> None:
        raise moderngl.Error(log)

    monkeypatch.setattr(moderngl.Context, "compute_shader", refuse)
    with pytest.raises(GlUnavailableError, match=f"compose does not compile: {re.escape(cause)}$"):
        GlDevice()


def test_close_releases_every_buffer(
    device: GlDevice, coarse_body: Body, ring: Ring, standing_pose: Floats, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[moderngl.Buffer] = []
    make = moderngl.Context.buffer

    def recorded(context: moderngl.Context, *arguments: Any, **named: Any) -> moderngl.Buffer:
        made.append(make(context, *arguments, **named))
        return made[-1]

    monkeypatch.setattr(moderngl.Context, "buffer", recorded)
    rig = ring(3)
    backend = GlBackend(device, coarse_body, rig)
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
    resident_growth: Growth,
) -> None:
    rig = ring(2)
    backend = GlBackend(shared_device, coarse_body, rig)
    energy, one = hand_energy(backend, rig, standing_pose), np.zeros((1, len(HAND_DOFS)))
    for n in (1, 10, 500):
        energy(one.repeat(n, axis=0))

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("a buffer was made during an evaluation")

    monkeypatch.setattr(moderngl.Context, "buffer", refuse)

    def evaluate() -> None:
        for _ in range(1000):
            energy(one)
        for _ in range(19):
            energy(one.repeat(500, axis=0))

    evaluate()  # a driver may take its own memory once: NVIDIA's takes 2 MB
    assert resident_growth(evaluate) < 2_000_000
    backend.close()


def test_a_closed_device_is_a_lost_one(
    device: GlDevice, coarse_body: Body, ring: Ring, standing_pose: Floats
) -> None:
    rig = ring(2)
    backend = GlBackend(device, coarse_body, rig)
    energy = hand_energy(backend, rig, standing_pose)
    device.close()
    device.close()
    for use in (
        lambda: energy(np.zeros((1, len(HAND_DOFS)))),
        lambda: backend.coverage(standing_pose[None], ALL, Region.whole(rig)),
        lambda: GlBackend(device, coarse_body, rig),
    ):
        with pytest.raises(GlLostError, match="OpenGL is closed"):
            use()
    backend.close()


@pytest.mark.parametrize("broken", ["error", "read"])
def test_a_driver_that_fails_is_a_lost_device(
    device: GlDevice,
    coarse_body: Body,
    ring: Ring,
    standing_pose: Floats,
    monkeypatch: pytest.MonkeyPatch,
    broken: str,
) -> None:
    rig = ring(2)
    backend = GlBackend(device, coarse_body, rig)
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
    device: GlDevice, coarse_body: Body, ring: Ring, standing_pose: Floats
) -> None:
    rig = ring(2)
    backend = GlBackend(device, coarse_body, rig)
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
    with pytest.raises(GlUnavailableError, match=r"^1 cameras of 16384 x 16384 pixels are too many"):
        backend.coverage(np.zeros((1, N_DOF)), ALL, region)
    backend.close()


@pytest.mark.parametrize(
    ("limit_bytes", "too_many"),
    [
        pytest.param(3 * 97 * 72 * 4, False, id="all fits"),
        pytest.param(3 * 97 * 72 * 4 - 1, True, id="the gain does not"),
        pytest.param(96 * 72 * 4 - 1, True, id="one image does not"),
    ],
)
def test_small_buffers_are_found_out_when_a_problem_is_prepared(
    shared_device: GlDevice,
    coarse_body: Body,
    ring: Ring,
    standing_pose: Floats,
    monkeypatch: pytest.MonkeyPatch,
    limit_bytes: int,
    too_many: bool,
) -> None:
    rig = ring(3)
    backend = GlBackend(shared_device, coarse_body, rig)
    monkeypatch.setattr(GlDevice, "max_buffer_bytes", limit_bytes)
    picture = Picture.whole(rig, np.zeros((1, *rig.shape_px), np.uint8))
    problem = Problem(standing_pose, tuple(range(N_DOF)), ALL, picture)
    if too_many:
        with pytest.raises(GlUnavailableError, match=r"^3 cameras of 96 x 72 pixels are too many .* MiB$"):
            backend.energy(problem)
    else:
        expected = CpuBackend(coarse_body, rig).energy(problem)(standing_pose[None].repeat(5, axis=0))
        assert backend.energy(problem)(standing_pose[None].repeat(5, axis=0)).tolist() == expected.tolist()
    backend.close()


def test_a_body_too_large_is_refused(
    shared_device: GlDevice, coarse_body: Body, ring: Ring, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(GlDevice, "max_buffer_bytes", 1000)
    with pytest.raises(GlUnavailableError, match=r"^the body has 672 vertices and 1920 edges: too many"):
        GlBackend(shared_device, coarse_body, ring(1))
