"""Who kills services and holds them up."""

import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

from bench.soak.dice import Dice
from bench.soak.latency import Stopwatch
from services.runs.launcher import Launcher

_KILLED_SHARE = 60
"""Of a hundred victims; the others hang for a while."""
_FINE = 2**20
_LOOK_S = 0.05


@dataclass(frozen=True)
class FaultPlan:
    """Which faults are injected, and how often."""

    most: Mapping[str, int]
    """Whom it strikes, and how often in one run at most."""
    longest_wait_s: float
    """Between two faults; half of it in the mean."""
    hang_s: tuple[float, float]
    """For how long somebody is held up, at least and at most."""
    first_frame: int = 0
    frames_between: int = 0
    """How many frames are left in peace at the beginning, and after each fault."""


@dataclass(frozen=True)
class Fault:
    """A service that was killed or held up."""

    name: str
    way: str
    frame: int
    """Which was being solved just then."""


class FaultInjector:
    """Strikes services of one run at random moments, in a thread of its own."""

    def __init__(self, dice: Dice, plan: FaultPlan, most: int) -> None:
        """most: faults at most."""
        self._dice, self._plan, self._most = dice, plan, most
        self._next_frame = plan.first_frame
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._work, name="injector", daemon=True)
        self._counts: Counter[str] = Counter()
        self._hanging: dict[int, float] = {}
        self.struck: list[Fault] = []
        self.tell: Callable[[int], None] = lambda _: None
        """Is called with the number of faults after each of them."""

    @property
    def faults(self) -> Counter[str]:
        """What was done, by the victim."""
        return Counter(f"{fault.name} {fault.way}" for fault in self.struck)

    def begin(self, launcher: Launcher, stopwatch: Stopwatch) -> None:
        """Begin with a run's processes."""
        self._launcher, self._stopwatch = launcher, stopwatch
        self._thread.start()

    def end(self) -> None:
        """Do nothing any more, and let those go on that hang."""
        self._ending.set()
        if self._thread.ident is not None:
            self._thread.join()
        self._wake(at_once=True)

    def _work(self) -> None:
        next_s = time.monotonic() + self._between(0.0, self._plan.longest_wait_s)
        while not self._ending.wait(_LOOK_S):
            self._wake(at_once=False)
            is_time = time.monotonic() > next_s and self._stopwatch.frame >= self._next_frame
            if len(self.struck) < self._most and is_time and self._strike():
                next_s = time.monotonic() + self._between(0.0, self._plan.longest_wait_s)

    def _between(self, low: float, high: float) -> float:
        return low + (high - low) * self._dice.below(_FINE) / _FINE

    def _strike(self) -> bool:
        """Kill somebody or hold them up; False where nobody of the kind is there to whom that may be done."""
        name = self._dice.pick(list(self._plan.most))
        pids = [pid for pid in self._launcher.pids(name) if pid not in self._hanging]
        if self._counts[name] >= self._plan.most[name] or not pids:
            return False
        pid, is_killed = self._dice.pick(pids), self._dice.below(100) < _KILLED_SHARE
        fault = Fault(name, "killed" if is_killed else "held up", self._stopwatch.frame)
        try:
            os.kill(pid, signal.SIGKILL if is_killed else signal.SIGSTOP)
        except ProcessLookupError:  # it has just ended
            return False
        if not is_killed:
            self._hanging[pid] = time.monotonic() + self._between(*self._plan.hang_s)
        self._counts[name] += 1
        self._next_frame = fault.frame + self._plan.frames_between
        self.struck.append(fault)
        self.tell(len(self.struck))
        return True

    def _wake(self, *, at_once: bool) -> None:
        """Let those go on whose time is up."""
        for pid, until_s in list(self._hanging.items()):
            if at_once or time.monotonic() > until_s:
                del self._hanging[pid]
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGCONT)
