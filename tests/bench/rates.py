"""Evaluations per second, taken in turns so that whatever else the machine does hits all alike."""

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass

from services.mocap.energy.backend import Energy
from services.mocap.types import Floats

BATCHES = (8, 32, 128, 512, 2048, 8192)
"""Batch sizes that are tried, beside one pose at a time."""
_TRIAL_S = 0.02
_TURN_S = 0.04
_LONGEST_CALL_S = 0.15
"""Batches that would take longer are not tried."""
_SLOW_CALL_S = 0.05
_SLOW_TURNS = 3
"""So many turns are enough for calls slower than that."""


@dataclass(frozen=True, eq=False)
class Runner:
    """One energy, evaluated batch after batch."""

    backend: str
    energy: Energy
    values: Floats
    """(N, d), evaluated round and round."""
    batch: int = 1

    def rate(self, at_least_s: float) -> float:
        """Evaluations per second over at least one call."""
        n_batches, count, began = len(self.values) // self.batch, 0, time.perf_counter()
        while True:
            first = count % n_batches * self.batch
            self.energy(self.values[first : first + self.batch])
            count += 1
            elapsed_s = time.perf_counter() - began
            if elapsed_s >= at_least_s:
                return count * self.batch / elapsed_s


def with_best_batch(single: Runner) -> list[Runner]:
    """The runner, and beside it one of the batch size that a short trial finds quicker, if there is one."""
    single.rate(0.0)  # compiled, allocated
    best, best_rate = single, single.rate(_TRIAL_S)
    for batch in BATCHES:
        if batch / best_rate > _LONGEST_CALL_S or batch > len(single.values):
            break
        runner = Runner(single.backend, single.energy, single.values, batch)
        runner.rate(0.0)
        rate = runner.rate(_TRIAL_S)
        if rate > best_rate:
            best, best_rate = runner, rate
    return [single] if best is single else [single, best]


def median_rates(runners: Sequence[Runner], repeats: int) -> list[float]:
    """The median of every runner's rates over some turns."""
    rates: list[list[float]] = [[] for _ in runners]
    for turn in range(repeats):
        for runner, taken in zip(runners, rates, strict=True):
            is_slow = bool(taken) and runner.batch / taken[0] > _SLOW_CALL_S
            if turn < _SLOW_TURNS or not is_slow:
                taken.append(runner.rate(_TURN_S))
    return [statistics.median(taken) for taken in rates]
