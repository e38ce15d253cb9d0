"""Which backend is taken, and why."""

import logging
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace

import pytest

from machines import MESA
from services.mocap.body.actor import Body
from services.mocap.camera.rig import Rig
from services.mocap.energy.cost import Cost
from services.mocap.energy.engine import ASKED_FOR, check_cost, open_engine
from services.mocap.energy.gl import device as gl_device
from services.mocap.energy.gl.device import GlUnavailableError, NoSuchDeviceError, is_software
from services.mocap.energy.settings import Choice, EngineSettings
from services.mocap.errors import UserError

NOTHING = replace(MESA, libegl=None, libgl=None, vendor_files=())
NVIDIA_HIDDEN = replace(MESA, nvidia_driver=True, capabilities="compute,utility")

NO_MODERNGL = "the Python package moderngl cannot be loaded; run scripts/setup"
LAPTOP_GPU = "NVIDIA GeForce RTX 3050 Laptop GPU"


class FakeDevice:
    """OpenGL as it might be elsewhere; draws nothing."""

    version = "4.6"

    def __init__(self, renderer: str, is_hardware: bool, index: int) -> None:
        self.renderer, self.is_hardware, self.index, self.closed = renderer, is_hardware, index, 0

    def close(self) -> None:
        self.closed += 1


Machine = Callable[..., list[FakeDevice]]


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    """`machine("renderer", …)`: its EGL devices from then on, by what they draw with; a device whose text
    begins with "no" cannot be opened, for that reason."""
    monkeypatch.delenv("GLCONTEXT_DEVICE_INDEX", raising=False)

    def set_up(*renderers: str) -> list[FakeDevice]:
        opened: list[FakeDevice] = []

        def open_device(index: int = 0) -> FakeDevice:
            index = int(os.environ.get("GLCONTEXT_DEVICE_INDEX", index))
            if index >= len(renderers):
                raise NoSuchDeviceError(f"found {len(renderers)} devices")
            if renderers[index].startswith("no"):
                raise GlUnavailableError(renderers[index])
            opened.append(FakeDevice(renderers[index], not is_software(renderers[index]), index))
            return opened[-1]

        monkeypatch.setattr(gl_device, "GlDevice", open_device)
        return opened

    return set_up


def _warnings(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def test_auto_takes_a_gpu(machine: Machine) -> None:
    opened = machine("NVIDIA H100 PCIe/PCIe/SSE2")
    with open_engine(EngineSettings(), lambda: NOTHING) as engine:
        assert str(engine) == "gl backend: NVIDIA H100 PCIe/PCIe/SSE2 through EGL, device 0"
        assert [device.closed for device in opened] == [0]
    assert [device.closed for device in opened] == [1]


@pytest.mark.parametrize(
    "before", [("llvmpipe",), ("no permission",), ("llvmpipe", "no driver", "softpipe"), ("no EGL", "swrast")]
)
@pytest.mark.parametrize("backend", ["auto", "gl"])
def test_a_gpu_behind_others_is_found(
    machine: Machine, caplog: pytest.LogCaptureFixture, before: tuple[str, ...], backend: Choice
) -> None:
    opened = machine(*before, LAPTOP_GPU, "AMD Radeon")
    with open_engine(EngineSettings(backend=backend), lambda: MESA) as engine:
        assert engine.name == "gl"
        assert engine.reason.endswith(f"{LAPTOP_GPU} through EGL, device {len(before)}")
        *others, taken = opened
        assert taken.renderer == LAPTOP_GPU
        assert taken.closed == 0
        assert all(device.closed == 1 for device in others)
    assert _warnings(caplog) == []


def test_the_device_that_the_user_names_is_taken(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = machine(LAPTOP_GPU, "llvmpipe", "AMD Radeon")
    monkeypatch.setenv("GLCONTEXT_DEVICE_INDEX", "2")
    with open_engine(EngineSettings(), lambda: MESA) as engine:
        assert str(engine) == "gl backend: AMD Radeon through EGL, device 2"
    monkeypatch.setenv("GLCONTEXT_DEVICE_INDEX", "1")
    with open_engine(EngineSettings(), lambda: MESA) as engine:
        assert engine.reason.startswith("no hardware OpenGL: llvmpipe is a software renderer")
    monkeypatch.setenv("GLCONTEXT_DEVICE_INDEX", "3")
    with open_engine(EngineSettings(), lambda: MESA) as engine:
        assert engine.reason == "no OpenGL that can be used: found 3 devices"
    assert len(opened) == 2


def test_auto_leaves_a_software_renderer(machine: Machine, caplog: pytest.LogCaptureFixture) -> None:
    opened = machine("llvmpipe (LLVM 15)")
    with open_engine(EngineSettings(), lambda: MESA) as engine:
        assert [device.closed for device in opened] == [1]
        assert (engine.name, engine.reason) == (
            "cpu",
            "no hardware OpenGL: llvmpipe (LLVM 15) is a software renderer, slower than the cpu backend",
        )
    assert _warnings(caplog) == []


def test_a_gpu_that_cannot_be_used_is_not_forgotten_over_a_software_renderer(machine: Machine) -> None:
    machine("no int64 on the GPU", "llvmpipe")
    with open_engine(EngineSettings(), lambda: MESA) as engine:
        assert engine.reason.endswith("slower than the cpu backend; no int64 on the GPU")


@pytest.mark.parametrize("renderers", [("llvmpipe (LLVM 15)",), ("no display",)])
def test_a_gpu_that_is_here_but_hidden_is_said_loudly(
    machine: Machine, caplog: pytest.LogCaptureFixture, renderers: tuple[str, ...]
) -> None:
    machine(*renderers)
    engine = open_engine(EngineSettings(), lambda: NVIDIA_HIDDEN)
    assert engine.name == "cpu"
    assert "NVIDIA_DRIVER_CAPABILITIES=graphics,compute,utility" in engine.reason
    (warning,) = _warnings(caplog)
    assert warning == f"an NVIDIA GPU is here but not used: {engine.reason}"


def test_how_an_integrated_gpu_would_be_used_is_in_the_reason(
    machine: Machine, caplog: pytest.LogCaptureFixture
) -> None:
    machine("llvmpipe")
    engine = open_engine(EngineSettings(), lambda: replace(MESA, mesa_card="Intel"))
    assert "--device /dev/dri" in engine.reason
    assert _warnings(caplog) == []


def test_auto_goes_without_opengl(machine: Machine, caplog: pytest.LogCaptureFixture) -> None:
    machine(*["no libEGL.so.1"] * 40)
    engine = open_engine(EngineSettings(), lambda: NOTHING)
    assert str(engine) == (
        "cpu backend: no OpenGL that can be used: no libEGL.so.1; "
        "run apt-get install --no-install-recommends libegl1 libgl1 libgl1-mesa-dri"
    )
    assert _warnings(caplog) == []


@pytest.mark.parametrize("backend", ["gl", "paper"])
def test_what_is_asked_for_and_cannot_be_is_refused_with_the_remedy(
    machine: Machine, backend: Choice
) -> None:
    machine()
    with pytest.raises(UserError) as refused:
        open_engine(EngineSettings(backend=backend), lambda: NOTHING)
    assert str(refused.value) == (
        f"--backend {backend}: found 0 devices; "
        "run apt-get install --no-install-recommends libegl1 libgl1 libgl1-mesa-dri"
    )


@pytest.mark.parametrize("backend", ["gl", "paper"])
def test_a_software_renderer_that_is_asked_for_is_warned_of(
    machine: Machine, caplog: pytest.LogCaptureFixture, backend: Choice
) -> None:
    machine("llvmpipe")
    engine = open_engine(EngineSettings(backend=backend))
    assert (engine.name, engine.reason) == (backend, "asked for, on llvmpipe through EGL, device 0")
    assert _warnings(caplog) == [
        f"llvmpipe is a software renderer: the {backend} backend is slower on it than cpu is"
    ]


def test_a_cost_that_paper_does_not_know_is_refused() -> None:
    cost = Cost(camera_weights=(1.0, 0.5))
    with pytest.raises(UserError) as refused:
        check_cost(EngineSettings(backend="paper"), cost)
    assert str(refused.value) == (
        "--backend paper: counts differing pixels and knows only the camera_weights 0 and 1: leave that "
        "setting out, or choose another backend"
    )
    check_cost(EngineSettings(backend="paper"), Cost())
    for other in ("auto", "gl", "cpu"):
        check_cost(EngineSettings(backend=other), cost)


def test_cpu_looks_for_no_opengl(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl_device, "GlDevice", lambda: pytest.fail("opened"))
    engine = open_engine(EngineSettings(backend="cpu"))
    assert (engine.name, engine.reason) == ("cpu", ASKED_FOR)


@pytest.mark.parametrize(
    ("backend", "said"),
    [
        ("cpu", "cpu backend: asked for"),
        ("auto", f"cpu backend: no OpenGL that can be used: {NO_MODERNGL}"),
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
