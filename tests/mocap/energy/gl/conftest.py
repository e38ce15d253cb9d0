"""The device that the `gl` backend runs on, and the `cpu` backend at full detail beside it.

Without OpenGL these tests are skipped, or fail where the environment says that there has to be one.
"""

import os
from collections.abc import Callable, Iterator

import pytest

from services.mocap.body.actor import Body
from services.mocap.camera.rig import Rig
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.gl.backend import GlBackend
from services.mocap.energy.gl.device import GlDevice, GlUnavailableError

REQUIRED = "XORMOCAP_REQUIRE_GL"


def open_device() -> GlDevice:
    try:
        return GlDevice()
    except GlUnavailableError as error:
        if os.environ.get(REQUIRED) == "1":
            pytest.fail(f"{REQUIRED}=1, but {error}", pytrace=False)
        pytest.skip(f"no OpenGL through EGL: {error}")


@pytest.fixture(scope="session")
def shared_device() -> Iterator[GlDevice]:
    """One device for all tests that leave it as it was."""
    device = open_device()
    yield device
    device.close()


@pytest.fixture
def own_device() -> Iterator[GlDevice]:
    """A device that a test may close."""
    device = open_device()
    yield device
    device.close()


@pytest.fixture
def both(shared_device: GlDevice) -> Iterator[Callable[[Body, Rig], tuple[GlBackend, CpuBackend]]]:
    """`both(body, rig)`: the `gl` backend, and the `cpu` backend that it has to equal."""
    opened: list[GlBackend] = []

    def make(body: Body, rig: Rig) -> tuple[GlBackend, CpuBackend]:
        opened.append(GlBackend(shared_device, body, rig))
        return opened[-1], CpuBackend(body, rig)

    yield make
    for backend in opened:
        backend.close()
