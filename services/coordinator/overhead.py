"""What a coordinator's frame costs beside the fitting: messages, hand-out, bookkeeping.

It is processor time, which other work on the machine does not change and waiting does not add to.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Overhead:
    """Adds up the calling thread's processor time that went into fitting; the rest of a frame is overhead."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """A frame begins."""
        self._began_s, self._fitted_s = time.thread_time(), 0.0

    @contextmanager
    def fitting(self) -> Iterator[None]:
        """What is done inside is fitting."""
        began_s = time.thread_time()
        yield
        self._fitted_s += time.thread_time() - began_s

    @contextmanager
    def talking(self) -> Iterator[None]:
        """What is done inside is not, though it is within a fitting."""
        began_s = time.thread_time()
        yield
        self._fitted_s -= time.thread_time() - began_s

    def of_frame(self) -> float:
        """Seconds of overhead since the frame's beginning; the next frame begins."""
        overhead_s = time.thread_time() - self._began_s - self._fitted_s
        self.begin()
        return max(overhead_s, 0.0)
