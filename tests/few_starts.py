"""A quicker search for first poses, for tests of what comes before or after it."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def few_starts() -> Iterator[None]:
    """In this process, a search for a first pose begins with fewer starts."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("services.mocap.search.first_pose._MOST_ALIGNED", 8)
        for name in ("_MOST_SEARCHED", "_MOST_SEARCHED_OF_HEADING"):
            patched.setattr(f"services.mocap.search.first_pose.{name}", 2)
        yield
