"""The `gl` backend, and beside it the `cpu` backend at full detail that it has to equal."""

from collections.abc import Callable, Iterator

import pytest

from services.mocap.body.actor import Body
from services.mocap.camera.rig import Rig
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.gl.backend import GlBackend
from services.mocap.energy.gl.device import GlDevice


@pytest.fixture
def both(shared_device: GlDevice) -> Iterator[Callable[[Body, Rig], tuple[GlBackend, CpuBackend]]]:
    """`both(body, rig)`: the `gl` backend and the `cpu` backend."""
    opened: list[GlBackend] = []

    def make(body: Body, rig: Rig) -> tuple[GlBackend, CpuBackend]:
        opened.append(GlBackend(shared_device, body, rig))
        return opened[-1], CpuBackend(body, rig)

    yield make
    for backend in opened:
        backend.close()
