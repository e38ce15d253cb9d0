"""The cost of a coordinator's frame besides fitting: messages, dispatch, bookkeeping.

It is processor time, so neither waiting nor other work on the machine counts.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Overhead:
    """Sums the calling thread's processor time for fitting; the rest of a frame is overhead."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """A frame begins."""
        self._began_s, self._fitted_s = time.thread_time(), 0.0

    @contextmanager
    def fitting(self) -> Iterator[None]:
        """Time inside this block counts as fitting."""
        began_s = time.thread_time()
        yield
        self._fitted_s += time.thread_time() - began_s

    @contextmanager
    def talking(self) -> Iterator[None]:
        """Time inside this block counts as overhead, even within a fitting block."""
        began_s = time.thread_time()
        yield
        self._fitted_s -= time.thread_time() - began_s

    def end_frame(self) -> float:
        """Seconds of overhead since the frame's beginning; the next frame begins."""
        overhead_s = time.thread_time() - self._began_s - self._fitted_s
        self.begin()
        return max(overhead_s, 0.0)
