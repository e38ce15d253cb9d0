"""What `xormocap doctor` says of OpenGL, on machines that are not this one."""

from dataclasses import replace
from pathlib import Path

import pytest

from services import doctor
from services.doctor import Check, opengl_checks
from services.mocap.energy.egl_setup import EglSetup

MESA = EglSetup(
    libegl=Path("/usr/lib/libEGL.so.1"),
    libgl=Path("/usr/lib/libGL.so.1"),
    vendor_files=(Path("/usr/share/glvnd/egl_vendor.d/50_mesa.json"),),
    nvidia_driver=False,
    nvidia_library=None,
    nvidia_vendor_file=None,
    capabilities=None,
    overriding=None,
)
VENDOR_FILE = Path("/etc/glvnd/egl_vendor.d/10_nvidia.json")
NVIDIA = replace(
    MESA,
    nvidia_driver=True,
    nvidia_library=Path("/usr/lib/libEGL_nvidia.so.0"),
    nvidia_vendor_file=VENDOR_FILE,
)


class FakeDevice:
    """OpenGL as it might be elsewhere."""

    def __init__(self, renderer: str, version: str, is_hardware: bool) -> None:
        self.renderer, self.version, self.is_hardware = renderer, version, is_hardware


LLVMPIPE = FakeDevice("llvmpipe (LLVM 15)", "4.5 Mesa", False)
H100 = FakeDevice("NVIDIA H100/PCIe/SSE2", "4.6.0 NVIDIA 570", True)


def _findings(setup: EglSetup, device: FakeDevice | str) -> dict[str, str]:
    checks = opengl_checks(setup, device)  # type: ignore[arg-type]  # looks like a GlDevice
    assert all(check.ok for check in checks), "cpu works all the same"
    return {check.name: check.finding for check in checks}


def test_nothing_there() -> None:
    bare = replace(MESA, libegl=None, libgl=None, vendor_files=())
    assert _findings(bare, "libEGL cannot be loaded") == {
        "EGL": "no libEGL.so.1 and no libGL.so.1; vendor files: none",
        "OpenGL": "none, so that only the cpu backend runs here: libEGL cannot be loaded",
        "for a GPU": "run apt-get install --no-install-recommends libegl1 libgl1 libgl1-mesa-dri",
    }


def test_mesa_on_a_machine_without_a_gpu() -> None:
    assert _findings(MESA, LLVMPIPE) == {
        "EGL": "/usr/lib/libEGL.so.1; vendor files: /usr/share/glvnd/egl_vendor.d/50_mesa.json",
        "OpenGL": "llvmpipe (LLVM 15): a software renderer; 4.5 Mesa, with compute shaders, fp64 and int64",
    }


def test_an_nvidia_gpu_that_works() -> None:
    found = _findings(NVIDIA, H100)
    assert found["NVIDIA"] == f"a driver, with /usr/lib/libEGL_nvidia.so.0 and {VENDOR_FILE}"
    assert found["OpenGL"].startswith("NVIDIA H100/PCIe/SSE2: hardware; 4.6.0 NVIDIA 570")
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


def test_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_TIMED_S", 0.05)
    found = {check.name: check for check in doctor.examine()}
    assert isinstance(found["EGL"], Check)
    assert {"python", "libraries", "OpenGL", "backend", "energy"} <= set(found)
    assert found["backend"].finding.startswith(("auto takes cpu: ", "auto takes gl: "))
    assert "cpu backend, " in found["energy"].finding
