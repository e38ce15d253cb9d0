"""Waiting for what other threads and processes do."""

import time
from collections.abc import Callable


def until(
    condition: Callable[[], bool],
    what: str = "it never happened",
    timeout_s: float = 60.0,
    turn: Callable[[], object] = lambda: time.sleep(0.01),
) -> None:
    """Take turns until a condition holds; fails where it does not within a time."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, what
        turn()
