"""A GPU that fails loses nothing."""

import logging
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NoReturn

import numpy as np
import pytest

from machines import MESA
from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import SEGMENT_NAMES
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.engine import Engine, open_engine
from services.mocap.energy.gl import device as gl_device
from services.mocap.energy.picture import Picture, Region
from services.mocap.energy.settings import Choice, EngineSettings
from services.mocap.errors import UserError
from services.mocap.types import Floats

ALL = tuple(range(len(SEGMENT_NAMES)))
DOFS = tuple(range(N_DOF))
BROKEN = "#version 430\n#error broken\n"


@pytest.fixture
def gl_asked(without_opengl: Callable[[Exception], NoReturn]) -> Iterator[Callable[[Choice], Engine]]:
    """`gl_asked("gl" | "paper")` opens a real engine; skipped, or failed, without OpenGL."""
    opened: list[Engine] = []

    def open_it(backend: Choice) -> Engine:
        try:
            opened.append(open_engine(EngineSettings(backend=backend)))
        except UserError as error:
            without_opengl(error)
        return opened[-1]

    yield open_it
    for engine in opened:
        engine.close()


def _problem(body: Body, rig: Rig, poses: Floats) -> Problem:
    silhouettes = CpuBackend(body, rig).coverage(poses[:1], ALL, Region.whole(rig))[0]
    return Problem(poses[1], DOFS, ALL, Picture.whole(rig, silhouettes))


def _warnings(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


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


def test_pictures_too_large_for_a_gpu_lose_nothing(
    gl_asked: Callable[[Choice], Engine],
    coarse_body: Body,
    ring: Callable[[int], Rig],
    random_poses: Callable[[int, int], Floats],
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One image has room, what all cameras' pixels gain has none."""
    rig, poses = ring(3), random_poses(4, 6)
    engine, problem = gl_asked("gl"), _problem(coarse_body, rig, poses)
    backend = engine.backend(coarse_body, rig)
    monkeypatch.setattr(gl_device.GlDevice, "max_buffer_bytes", 2 * 97 * 72 * 4)
    caplog.clear()
    found = backend.energy(problem)(poses)
    assert found.tolist() == CpuBackend(coarse_body, rig).energy(problem)(poses).tolist()
    (line,) = _warnings(caplog)
    assert line.startswith("the gl backend failed (3 cameras of 96 x 72 pixels are too many")
    assert line.endswith("): going on with cpu")
    assert backend.name == "cpu"


def test_a_shader_that_does_not_compile_later_loses_nothing(
    gl_asked: Callable[[Choice], Engine],
    coarse_body: Body,
    ring: Callable[[int], Rig],
    random_poses: Callable[[int, int], Floats],
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    engine = gl_asked("paper")
    monkeypatch.setattr("services.mocap.energy.paper.rasteriser._FRAGMENT_SHADER", BROKEN)
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
