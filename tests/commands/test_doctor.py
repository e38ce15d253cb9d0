"""What `xormocap doctor` says of OpenGL, on machines that are not this one."""

from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from machines import MESA
from services import cli
from services.commands import doctor
from services.commands.doctor import Check, State, opengl_checks
from services.mocap.energy.egl_setup import EglSetup
from services.mocap.energy.engine import Engine, Found
from services.mocap.energy.settings import EngineSettings

VENDOR_FILE = Path("/etc/glvnd/egl_vendor.d/10_nvidia.json")
NVIDIA = replace(
    MESA,
    nvidia_driver=True,
    nvidia_library=Path("/usr/lib/libEGL_nvidia.so.0"),
    nvidia_vendor_file=VENDOR_FILE,
)


class FakeDevice:
    """OpenGL as it might be elsewhere."""

    index = 0

    def __init__(self, renderer: str, version: str, is_hardware: bool) -> None:
        self.renderer, self.version, self.is_hardware = renderer, version, is_hardware


LLVMPIPE = FakeDevice("llvmpipe (LLVM 15)", "4.5 Mesa", False)
H100 = FakeDevice("NVIDIA H100/PCIe/SSE2", "4.6.0 NVIDIA 570", True)


def _findings(setup: EglSetup, device: FakeDevice | str, *failures: str) -> dict[str, str]:
    """Findings by name; device: what draws, or why nothing does."""
    found = Found(None, (device,)) if isinstance(device, str) else Found(device, failures)  # type: ignore[arg-type]
    checks = opengl_checks(setup, found)
    for check in checks:  # cpu works all the same
        assert check.state is (State.HINT if check.name == "for a GPU" else State.OK)
    return {check.name: check.finding for check in checks}


def test_nothing_there() -> None:
    bare = replace(MESA, libegl=None, libgl=None, vendor_files=())
    assert _findings(bare, "libEGL cannot be loaded") == {
        "EGL": "no libEGL.so.1 and no libGL.so.1; vendor files: none",
        "OpenGL": "none, so only the cpu backend runs here: libEGL cannot be loaded",
        "for a GPU": "run apt-get install --no-install-recommends libegl1 libgl1 libgl1-mesa-dri",
    }


def test_mesa_on_a_machine_without_a_gpu() -> None:
    assert _findings(MESA, LLVMPIPE) == {
        "EGL": "/usr/lib/libEGL.so.1; vendor files: /usr/share/glvnd/egl_vendor.d/50_mesa.json",
        "OpenGL": "device 0, llvmpipe (LLVM 15): a software renderer; 4.5 Mesa, with compute shaders, fp64 "
        "and int64",
    }


def test_an_nvidia_gpu_that_works() -> None:
    found = _findings(NVIDIA, H100)
    assert found["NVIDIA"] == f"driver found, with /usr/lib/libEGL_nvidia.so.0 and {VENDOR_FILE}"
    assert found["OpenGL"].startswith("device 0, NVIDIA H100/PCIe/SSE2: hardware; 4.6.0 NVIDIA 570")
    assert "for a GPU" not in found


@pytest.mark.parametrize("device", [LLVMPIPE, "no display"])
@pytest.mark.parametrize(
    ("missing", "remedy"),
    [
        ({"capabilities": "compute,utility", "nvidia_library": None}, "NVIDIA_DRIVER_CAPABILITIES=graphics"),
        ({"nvidia_library": None}, "libnvidia-gl"),
        ({"nvidia_vendor_file": None}, "/usr/share/glvnd/egl_vendor.d/10_nvidia.json"),
        ({"nvidia_vendor_file": None, "overriding": "__EGL_VENDOR_LIBRARY_DIRS"}, "unset __EGL_VENDOR"),
    ],
)
def test_an_nvidia_gpu_that_is_hidden(
    missing: dict[str, str | None], remedy: str, device: FakeDevice | str
) -> None:
    hidden = replace(NVIDIA, **missing)  # type: ignore[arg-type]
    assert remedy in _findings(hidden, device)["for a GPU"]
    assert "for a GPU" not in _findings(hidden, H100), "it works in some way that was not thought of"


def test_a_gpu_that_cannot_be_used_beside_a_software_renderer() -> None:
    assert _findings(MESA, LLVMPIPE, "GeForce GT 710: too old")["for a GPU"] == "GeForce GT 710: too old"


class FallingEngine(Engine):
    """gl that fails at the evaluation of that number."""

    def __init__(self, at: int) -> None:
        super().__init__(EngineSettings(), "gl", "H100 through EGL, device 0")
        self.rates_until = at

    def after(self, _: Engine, batch: int) -> float:
        """In place of a measurement."""
        self.rates_until -= 1
        if self.rates_until == 0:
            self.name, self.reason = "cpu", "gl failed: H100 stopped working"
        return 100.0 * batch


@pytest.mark.parametrize("at", [2, 3])
def test_a_gpu_that_fails_while_it_is_timed_gets_no_figures(at: int, monkeypatch: pytest.MonkeyPatch) -> None:
    engine = FallingEngine(at)
    monkeypatch.setattr(doctor, "_rate", engine.after)
    assert doctor.energy_checks(engine, Engine(EngineSettings(), "cpu", "asked for")) == [
        Check("backend", State.HINT, "auto chooses cpu: gl failed: H100 stopped working"),
        Check("energy", State.OK, "cpu backend, 100 evaluations per second on one core"),
    ]


def test_a_gpu_has_its_figures_beside_those_of_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    engine = FallingEngine(at=4)
    monkeypatch.setattr(doctor, "_rate", engine.after)
    backend, energy = doctor.energy_checks(engine, Engine(EngineSettings(), "cpu", "asked for"))
    assert backend == Check("backend", State.OK, "auto chooses gl: H100 through EGL, device 0")
    assert energy.finding == (
        "cpu backend, 100 evaluations per second on one core; "
        "gl backend, 100 one by one and 25600 in batches of 256"
    )


def test_hints_are_told_from_what_is_well_and_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    checks = [Check("a", State.OK, "fine"), Check("b", State.HINT, "could be better")]
    monkeypatch.setattr(doctor, "examine", lambda: checks)
    result = CliRunner().invoke(cli.app, ["doctor"])
    assert result.exit_code == 0
    assert [line.split() for line in result.output.splitlines()] == [
        ["ok", "a", "fine"],
        ["hint", "b", "could", "be", "better"],
    ]
    checks.append(Check("c", State.MISSING, "install it"))
    result = CliRunner().invoke(cli.app, ["doctor"])
    assert result.exit_code == 1
    assert result.output.splitlines()[-1].split() == ["missing", "c", "install", "it"]


def test_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_TIMED_S", 0.05)
    found = {check.name: check for check in doctor.examine()}
    assert isinstance(found["EGL"], Check)
    assert {"python", "libraries", "OpenGL", "backend", "energy"} <= set(found)
    assert found["backend"].finding.startswith(("auto chooses cpu: ", "auto chooses gl: "))
    assert "cpu backend, " in found["energy"].finding
