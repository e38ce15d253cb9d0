"""A tool that listens."""

from collections.abc import Iterator

import pytest
from vmc_tool import Tool


@pytest.fixture
def tool() -> Iterator[Tool]:
    """It hears whatever is sent to its port."""
    listening = Tool()
    yield listening
    listening.close()
