"""Work on several cameras or frames at the same time, on all cores: libraries and compiled code allow it."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

_Given = TypeVar("_Given")
_Made = TypeVar("_Made")

N_CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
"""Those that this process may use."""
_POOL = ThreadPoolExecutor(N_CORES, "side-by-side")
"""Its threads start when they are first needed."""


def side_by_side(work: Callable[[_Given], _Made], given: Iterable[_Given]) -> list[_Made]:
    """What work makes of each, in order; raises what it raises first, once no more of it is being done.

    The work must not call this function.
    """
    futures = [_POOL.submit(work, one) for one in given]
    try:
        return [future.result() for future in futures]
    finally:
        for future in futures:
            future.cancel()
        wait(futures)
