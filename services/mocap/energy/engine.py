"""Which backend evaluates the energy in this process: chosen once, and why; another where a GPU fails."""

import logging
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self, TypeAlias

from services.mocap.body.actor import Body
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Backend
from services.mocap.energy.cost import Cost
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.egl_setup import INDEX_VARIABLE, EglSetup
from services.mocap.energy.settings import EngineSettings
from services.mocap.errors import UserError

if TYPE_CHECKING:  # the CPU backend needs no OpenGL bindings
    from services.mocap.energy.gl.device import GlDevice

log = logging.getLogger(__name__)

EngineName: TypeAlias = Literal["gl", "cpu", "paper"]
ASKED_FOR = "asked for"
_MOST_DEVICES = 32


@dataclass(frozen=True)
class Found:
    """What looking for a device came to."""

    device: "GlDevice | None"
    """A GPU's if there is one, else the first software renderer's; open, and the caller's to close."""
    failures: tuple[str, ...] = ()
    """Why those that might have been better cannot be used."""

    @property
    def problem(self) -> str:
        """The failures as one sentence."""
        return "; ".join(self.failures)


class Engine:
    """Makes backends of one kind, for any body and rig; use it in the thread that opened it."""

    def __init__(
        self, settings: EngineSettings, name: EngineName, reason: str, device: "GlDevice | None" = None
    ) -> None:
        """Made by open_engine. device: what gl and paper draw on; closed with the engine."""
        self.settings, self.name, self.reason = settings, name, reason
        self._device = device

    def __str__(self) -> str:
        return f"{self.name} backend: {self.reason}"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def backend(self, body: Body, rig: Rig) -> Backend:
        """A backend for a body in a rig; one that needs a GPU continues with cpu if the GPU fails."""
        if self._device is None:
            return self.make(body, rig)
        from services.mocap.energy.fallback import FallbackBackend

        return FallbackBackend(self, body, rig)

    def make(self, body: Body, rig: Rig) -> Backend:
        """A backend of the present kind; raises GlUnavailableError or GlLostError where its GPU fails."""
        if self._device is None:
            return CpuBackend(body, rig, self.settings.threads)
        if self.name == "paper":
            from services.mocap.energy.paper.backend import PaperBackend

            return PaperBackend(self._device, body, rig)
        from services.mocap.energy.gl.backend import GlBackend

        return GlBackend(self._device, body, rig)

    def fall_back(self, error: Exception) -> None:
        """Go on with cpu, because of an error; says so in the log, once."""
        if self._device is not None:
            log.warning("the %s backend failed (%s): going on with cpu", self.name, error)
            self.reason = f"{self.name} failed: {error}"
            self.name = "cpu"
            self.close()
            self._device = None

    def close(self) -> None:
        """Give back the GPU; backends that need it find it lost."""
        if self._device is not None:
            with suppress(Exception):  # one that was lost may not even be given back
                self._device.close()


def check_cost(settings: EngineSettings, cost: Cost) -> None:
    """Raises UserError where the backend that is asked for does not know a cost."""
    if settings.backend == "paper" and not cost.is_plain:
        raise UserError(
            "--backend paper: counts differing pixels and knows only the camera_weights 0 and 1: leave that "
            "setting out, or choose another backend"
        )


def find_device() -> Found:
    """Open EGL devices one after the other until a GPU draws; only the one that GLCONTEXT_DEVICE_INDEX names
    where that is set. Never call it before a fork: EGL does not survive one.
    """
    try:
        from services.mocap.energy.gl.device import GlDevice, GlUnavailableError, NoSuchDeviceError
    except ImportError as error:
        return Found(None, (f"the Python package {error.name} cannot be loaded; run scripts/setup",))
    software: GlDevice | None = None
    failures: list[str] = []
    for index in range(1 if os.environ.get(INDEX_VARIABLE) else _MOST_DEVICES):
        try:
            device = GlDevice(index)
        except NoSuchDeviceError as error:
            if index == 0:  # there is none at all, or not the one that is named
                failures.append(str(error))
            break
        except GlUnavailableError as error:
            failures.append(str(error))
            continue
        if device.is_hardware:
            if software is not None:
                software.close()
            return Found(device)
        if software is None:
            software = device
        else:
            device.close()
    return Found(software, tuple(dict.fromkeys(failures)))  # without libEGL every index fails alike


def open_engine(settings: EngineSettings, look: Callable[[], EglSetup] = EglSetup.look) -> Engine:
    """Choose the backend for this process, and open the GPU where that takes one.

    look: finds out what to tell the user where there is no OpenGL. Raises UserError where a backend was asked
    for that cannot run here. Never call it before a fork: EGL does not survive one.
    """
    if settings.backend == "cpu":
        return Engine(settings, "cpu", ASKED_FOR)
    found = find_device()
    if settings.backend == "auto":
        return _choose(settings, found, look)
    device = found.device
    if device is None:
        raise UserError(f"--backend {settings.backend}: {found.problem}{_with_remedy(look())}")
    if not device.is_hardware:
        log.warning(
            "%s is a software renderer: the %s backend is slower on it than cpu is",
            device.renderer,
            settings.backend,
        )
    return Engine(settings, settings.backend, f"{ASKED_FOR}, on {_named(device)}", device)


def _choose(settings: EngineSettings, found: Found, look: Callable[[], EglSetup]) -> Engine:
    """What auto takes; a GPU that is here and cannot be used is worth a warning."""
    device = found.device
    if device is None:
        reason = f"no OpenGL that can be used: {found.problem}"
    elif device.is_hardware:
        return Engine(settings, "gl", _named(device), device)
    else:
        device.close()
        reason = f"no hardware OpenGL: {device.renderer} is a software renderer, slower than the cpu backend"
        if found.failures:
            reason += f"; {found.problem}"
    setup = look()
    if setup.gpu or device is None:
        reason += _with_remedy(setup)
    if setup.nvidia_driver:  # others may be integrated ones, no quicker than the CPU beside them
        log.warning("an NVIDIA GPU is here but not used: %s", reason)
    return Engine(settings, "cpu", reason)


def _named(device: "GlDevice") -> str:
    return f"{device.renderer} through EGL, device {device.index}"


def _with_remedy(setup: EglSetup) -> str:
    remedy = setup.remedy()
    return f"; {remedy}" if remedy else ""
