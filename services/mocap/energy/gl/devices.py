"""Which of a machine's EGL devices is taken: the first one on which a GPU draws."""

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

from services.mocap.energy.egl_setup import INDEX_VARIABLE

if TYPE_CHECKING:  # the CPU backend needs no OpenGL bindings
    from services.mocap.energy.gl.device import GlDevice

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
