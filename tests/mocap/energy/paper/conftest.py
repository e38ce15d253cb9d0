"""The device that the `paper` backend draws on; without one its tests are skipped, or fail if required."""

import os
from collections.abc import Iterator

import pytest

from services.mocap.energy.gl.device import GlDevice, GlUnavailableError

REQUIRED = "XORMOCAP_REQUIRE_GL"


@pytest.fixture
def device() -> Iterator[GlDevice]:
    try:
        opened = GlDevice()
    except GlUnavailableError as error:
        if os.environ.get(REQUIRED) == "1":
            pytest.fail(f"{REQUIRED}=1, but {error}", pytrace=False)
        pytest.skip(f"no OpenGL through EGL: {error}")
    yield opened
    opened.close()
