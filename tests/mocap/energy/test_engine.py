"""Which backend is taken and why, and that a GPU which fails loses nothing."""

import logging
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from services.mocap.body.actor import Body
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.egl_setup import EglSetup
from services.mocap.energy.engine import ASKED_FOR, Engine, open_engine
from services.mocap.energy.gl import device as gl_device
from services.mocap.energy.gl.device import GlUnavailableError
from services.mocap.energy.picture import Picture, Region
from services.mocap.energy.settings import Choice, EngineSettings
from services.mocap.errors import UserError
from services.mocap.types import Floats

ALL = tuple(range(16))
DOFS = tuple(range(35))
NOTHING = EglSetup(None, None, (), False, None, None, None, None)
MESA = EglSetup(
    Path("libEGL.so.1"), Path("libGL.so.1"), (Path("50_mesa.json"),), False, None, None, None, None
)
NVIDIA_HIDDEN = EglSetup(
    Path("libEGL.so.1"),
    Path("libGL.so.1"),
    (Path("50_mesa.json"),),
    True,
    None,
    None,
    "compute,utility",
    None,
)

NO_MODERNGL = "the Python package moderngl cannot be loaded; run scripts/setup"
BROKEN = "#version 430\n#error broken\n"


class FakeDevice:
    """OpenGL as it might be elsewhere; draws nothing."""

    version = "4.6"

    def __init__(self, renderer: str, is_hardware: bool) -> None:
        self.renderer, self.is_hardware, self.closed = renderer, is_hardware, 0

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Callable[..., FakeDevice]:
    """`machine("renderer", is_hardware)`: the device that is opened from then on."""

    def set_up(renderer: str, is_hardware: bool) -> FakeDevice:
        made = FakeDevice(renderer, is_hardware)
        monkeypatch.setattr(gl_device, "GlDevice", lambda: made)
        return made

    return set_up


@pytest.fixture
def no_opengl(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise GlUnavailableError("libEGL.so.1 is not here")

    monkeypatch.setattr(gl_device, "GlDevice", refuse)


@pytest.fixture
def gl_asked() -> Iterator[Callable[[Choice], Engine]]:
    """`gl_asked("gl" | "paper")` opens a real engine; skipped, or failed, without OpenGL."""
    opened: list[Engine] = []

    def open_it(backend: Choice) -> Engine:
        try:
            opened.append(open_engine(EngineSettings(backend=backend)))
        except UserError as error:
            if os.environ.get("XORMOCAP_REQUIRE_GL") == "1":
                pytest.fail(str(error), pytrace=False)
            pytest.skip(str(error))
        return opened[-1]

    yield open_it
    for engine in opened:
        engine.close()


def _problem(body: Body, rig: Rig, poses: Floats) -> Problem:
    silhouettes = CpuBackend(body, rig).coverage(poses[:1], ALL, Region.whole(rig))[0]
    return Problem(poses[1], DOFS, ALL, Picture.whole(rig, silhouettes))


def _warnings(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def test_auto_takes_a_gpu(machine: Callable[..., FakeDevice]) -> None:
    device = machine("NVIDIA H100 PCIe/PCIe/SSE2", True)
    with open_engine(EngineSettings(), lambda: NOTHING) as engine:
        assert str(engine) == "gl backend: NVIDIA H100 PCIe/PCIe/SSE2 through EGL"
        assert device.closed == 0
    assert device.closed == 1


def test_auto_leaves_a_software_renderer(
    machine: Callable[..., FakeDevice], caplog: pytest.LogCaptureFixture
) -> None:
    device = machine("llvmpipe (LLVM 15)", False)
    with open_engine(EngineSettings(), lambda: MESA) as engine:
        assert device.closed == 1
        assert (engine.name, engine.reason) == (
            "cpu",
            "no hardware OpenGL: llvmpipe (LLVM 15) is a software renderer, slower than the cpu backend",
        )
    assert _warnings(caplog) == []


def test_a_gpu_that_is_here_but_hidden_is_said_loudly(
    machine: Callable[..., FakeDevice], caplog: pytest.LogCaptureFixture
) -> None:
    machine("llvmpipe (LLVM 15)", False)
    engine = open_engine(EngineSettings(), lambda: NVIDIA_HIDDEN)
    assert engine.name == "cpu"
    assert "NVIDIA_DRIVER_CAPABILITIES=graphics,compute,utility" in engine.reason
    (warning,) = _warnings(caplog)
    assert warning.startswith("an NVIDIA GPU is here but not used: no hardware OpenGL: llvmpipe")


@pytest.mark.usefixtures("no_opengl")
def test_auto_goes_without_opengl(caplog: pytest.LogCaptureFixture) -> None:
    engine = open_engine(EngineSettings(), lambda: NOTHING)
    assert str(engine) == (
        "cpu backend: no OpenGL that can be used: libEGL.so.1 is not here; "
        "run apt-get install --no-install-recommends libegl1 libgl1 libgl1-mesa-dri"
    )
    assert _warnings(caplog) == []


@pytest.mark.usefixtures("no_opengl")
@pytest.mark.parametrize("backend", ["gl", "paper"])
def test_what_is_asked_for_and_cannot_be_is_refused_with_the_remedy(backend: Choice) -> None:
    with pytest.raises(UserError) as refused:
        open_engine(EngineSettings(backend=backend), lambda: NOTHING)
    assert str(refused.value) == (
        f"--backend {backend}: libEGL.so.1 is not here; "
        "run apt-get install --no-install-recommends libegl1 libgl1 libgl1-mesa-dri"
    )


@pytest.mark.parametrize("backend", ["gl", "paper"])
def test_a_software_renderer_that_is_asked_for_is_warned_of(
    machine: Callable[..., FakeDevice], caplog: pytest.LogCaptureFixture, backend: Choice
) -> None:
    machine("llvmpipe", False)
    engine = open_engine(EngineSettings(backend=backend))
    assert (engine.name, engine.reason) == (backend, "asked for, on llvmpipe through EGL")
    assert _warnings(caplog) == [
        f"llvmpipe is a software renderer: the {backend} backend is slower on it than cpu is"
    ]


def test_cpu_looks_for_no_opengl(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl_device, "GlDevice", lambda: pytest.fail("opened"))
    engine = open_engine(EngineSettings(backend="cpu"))
    assert (engine.name, engine.reason) == ("cpu", ASKED_FOR)


@pytest.mark.parametrize(
    ("backend", "said"),
    [
        ("cpu", "cpu backend: asked for"),
        (
            "auto",
            f"cpu backend: no OpenGL that can be used: {NO_MODERNGL}",
        ),
        ("gl", f"--backend gl: {NO_MODERNGL}"),
    ],
)
def test_without_moderngl(backend: str, said: str) -> None:
    program = f"""
import sys
sys.modules["moderngl"] = None
from services.mocap.energy.engine import open_engine
from services.mocap.energy.settings import EngineSettings
from services.mocap.errors import UserError
try:
    print(open_engine(EngineSettings(backend={backend!r})))
except UserError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.startswith(said)


def test_settings_reach_the_cpu_backend(
    monkeypatch: pytest.MonkeyPatch, coarse_body: Body, ring: Callable[[int], Rig]
) -> None:
    got: list[int] = []
    monkeypatch.setattr(
        "services.mocap.energy.engine.CpuBackend",
        lambda body, rig, threads: got.append(threads),  # noqa: ARG005
    )
    open_engine(EngineSettings(backend="cpu", threads=3)).backend(coarse_body, ring(1))
    assert got == [3]


def test_falling_back_keeps_to_the_level_of_detail(
    gl_asked: Callable[[Choice], Engine],
    real_body: Body,
    ring: Callable[[int], Rig],
    random_poses: Callable[[int, int], Floats],
) -> None:
    rig, poses = ring(2), random_poses(3, 8)
    engine, region = gl_asked("gl"), Region.whole(rig)
    full = replace(_problem(real_body, rig, poses), detail_px=0.0)
    thinned = replace(full, detail_px=1.0)
    backend, cpu = engine.backend(real_body, rig), CpuBackend(real_body, rig)
    # The gl backend draws the full mesh, whatever may be.
    assert backend.energy(thinned)(poses).tolist() == cpu.energy(full)(poses).tolist()
    np.testing.assert_array_equal(backend.coverage(poses, ALL, region, 1.0), cpu.coverage(poses, ALL, region))
    energy = backend.energy(thinned)
    engine.close()
    assert energy(poses).tolist() == cpu.energy(thinned)(poses).tolist()
    np.testing.assert_array_equal(
        backend.coverage(poses, ALL, region, 1.0), cpu.coverage(poses, ALL, region, 1.0)
    )
    assert np.any(cpu.coverage(poses, ALL, region, 1.0) != cpu.coverage(poses, ALL, region))


@pytest.mark.parametrize("backend", ["gl", "paper"])
def test_closing_opengl_underneath_loses_nothing(
    gl_asked: Callable[[Choice], Engine],
    coarse_body: Body,
    ring: Callable[[int], Rig],
    random_poses: Callable[[int, int], Floats],
    caplog: pytest.LogCaptureFixture,
    backend: Choice,
) -> None:
    rig, poses = ring(3), random_poses(6, 5)
    engine, problem = gl_asked(backend), _problem(coarse_body, rig, poses)
    one, other = engine.backend(coarse_body, rig), engine.backend(coarse_body, rig)
    energy, others_energy = one.energy(problem), other.energy(problem)
    before = energy(poses)
    assert (one.name, energy(poses).tolist()) == (backend, before.tolist())
    caplog.clear()

    engine.close()  # as when the context is lost
    reference = CpuBackend(coarse_body, rig)
    expected = reference.energy(problem)(poses)
    assert energy(poses).tolist() == expected.tolist()
    assert (one.name, other.name, engine.name) == ("cpu", "cpu", "cpu")
    assert others_energy(poses[:2]).tolist() == expected[:2].tolist()
    region = Region.whole(rig)
    np.testing.assert_array_equal(other.coverage(poses, ALL, region), reference.coverage(poses, ALL, region))
    assert engine.backend(coarse_body, rig).name == "cpu"
    (line,) = _warnings(caplog)
    assert line.startswith(f"the {backend} backend failed (")
    assert line.endswith("): going on with cpu")
    assert "\n" not in line
    assert engine.reason.startswith(f"{backend} failed: ")
    one.close()
    other.close()


def test_a_shader_that_does_not_compile_later_loses_nothing(
    gl_asked: Callable[[Choice], Engine],
    coarse_body: Body,
    ring: Callable[[int], Rig],
    random_poses: Callable[[int, int], Floats],
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    engine = gl_asked("paper")
    monkeypatch.setattr("services.mocap.energy.paper.rasteriser.FRAGMENT_SHADER", BROKEN)
    rig, poses = ring(3), random_poses(4, 6)
    problem = _problem(coarse_body, rig, poses)
    caplog.clear()
    found = engine.backend(coarse_body, rig).energy(problem)(poses)
    assert found.tolist() == CpuBackend(coarse_body, rig).energy(problem)(poses).tolist()
    (line,) = _warnings(caplog)
    assert line.startswith("the paper backend failed (")
    assert line.endswith("): going on with cpu")


def test_a_shader_that_does_not_compile_at_the_start_leaves_cpu(
    gl_asked: Callable[[Choice], Engine], monkeypatch: pytest.MonkeyPatch
) -> None:
    gl_asked("gl").close()  # there is OpenGL
    monkeypatch.setattr(gl_device, "_HEADER", BROKEN)
    engine = open_engine(EngineSettings(), lambda: MESA)
    assert engine.name == "cpu"
    assert "does not compile" in engine.reason
    with pytest.raises(UserError, match=r"^--backend gl: .* does not compile"):
        open_engine(EngineSettings(backend="gl"), lambda: MESA)


def test_a_gpu_backend_gives_back_what_it_holds(
    gl_asked: Callable[[Choice], Engine], coarse_body: Body, ring: Callable[[int], Rig]
) -> None:
    engine = gl_asked("gl")
    backend = engine.backend(coarse_body, ring(2))
    backend.close()
    backend.close()
    engine.close()
    backend.close()
