"""Assigns limb tasks to workers, without a socket: registration, assignment, loss, delay, duplicates."""

import logging
from collections import Counter, OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from proto.messages import MAX_BACKENDS, Beat, Hello, LimbRefusal, LimbResult, LimbTask, Message, OfLimbTask
from proto.streams import FROM_CLIENTS, TO_CLIENTS
from services.blob_store import keep_latest
from services.coordinator.metrics import TURNAROUND
from services.mocap.body.skeleton import LOWER, UPPER
from services.mocap.search.chains import LIMBS
from services.mocap.take.marks import LimbName

log = logging.getLogger(__name__)

Identity: TypeAlias = bytes
Key: TypeAlias = tuple[str | int, ...]
"""What a result is recognised by."""

FIRST_DEADLINE_S = 20.0
"""Deadline before any task was timed: a worker may have to build its meshes first."""
DEADLINE_FLOOR_S = 0.5
"""Least time beyond the usual duration; machines are slow now and then."""
DEADLINE_FACTOR = 4.0
"""Number of mean deviations added to it."""
_NEW_SHARE, _NEW_DEVIATION_SHARE = 0.125, 0.25
_MOST_MISSING = 64


def key_of(message: OfLimbTask) -> Key:
    """What a limb task, its result and its refusal have in common."""
    return tuple(message.task_key.values())


def in_words(task: OfLimbTask) -> str:
    """A task as text for a log line."""
    return (
        f"the task take={task.take} frame={task.frame} pass={task.pass_index} limb={task.limb} "
        f"shard={task.shard}/{task.shards}"
    )


def is_sound(result: LimbResult) -> bool:
    """Whether a result has the limb's parameters, all within the joint limits."""
    dofs, values = list(LIMBS[result.limb].dofs), result.values
    return values.shape == (len(dofs),) and bool(np.all((values >= LOWER[dofs]) & (values <= UPPER[dofs])))


@dataclass
class _Worker:
    name: str
    backend: str
    heard_s: float
    task: Key | None = None
    given_s: float = 0.0


@dataclass
class _Open:
    """A task that has no result yet."""

    task: LimbTask
    submitted_s: float
    given_to: list[Identity] = field(default_factory=list)
    given_s: float = 0.0


class _Deadline:
    """A moving estimate of tasks' usual duration and its deviation, like TCP's of the round-trip time; both
    vary with the limb and the machine's load."""

    def __init__(self) -> None:
        self._usual_s: float | None = None
        self._deviation_s = 0.0

    @property
    def seconds(self) -> float:
        """Time after which a task is late."""
        if self._usual_s is None:
            return FIRST_DEADLINE_S
        return DEADLINE_FLOOR_S + self._usual_s + DEADLINE_FACTOR * self._deviation_s

    def note(self, seconds: float) -> None:
        """Note a task's duration since it was given to a worker."""
        if self._usual_s is None:
            self._usual_s, self._deviation_s = seconds, seconds / 2
            return
        off_s = seconds - self._usual_s
        self._usual_s += _NEW_SHARE * off_s
        self._deviation_s += _NEW_DEVIATION_SHARE * (abs(off_s) - self._deviation_s)


class Dispatcher:
    """Gives tasks to idle workers and collects their results.

    send(identity, message) -> False if that peer is gone; now() -> seconds on a monotonic clock.
    """

    def __init__(self, send: Callable[[Identity, Message], bool], now: Callable[[], float]) -> None:
        self._send, self._now = send, now
        self._workers: dict[Identity, _Worker] = {}
        self._missing: OrderedDict[Identity, _Worker] = OrderedDict()
        """Forgotten workers, the latest last. One that was only delayed continues when it is heard again. One
        that lost its connection returns with another identity."""
        self._open: dict[Key, _Open] = {}
        self._queue: deque[Key] = deque()
        self._results: list[LimbResult] = []
        self._probed_s = 0.0
        self._deadline = _Deadline()
        self.retries = 0
        self.dropped = 0
        self.helped: Counter[str] = Counter()
        """Results of workers that counted, by their energy backend; at most as many of
        those as a message may hold."""

    @property
    def workers(self) -> dict[str, str]:
        """Names of the registered workers, and the energy backends that they started with."""
        return {worker.name: worker.backend for worker in self._workers.values()}

    @property
    def busy(self) -> dict[str, LimbName]:
        """The limb that each busy worker is searching, by its name."""
        open_tasks = {w.name: self._open[w.task] for w in self._workers.values() if w.task in self._open}
        return {name: opened.task.limb for name, opened in open_tasks.items()}

    @property
    def n_waiting(self) -> int:
        """Tasks that no worker has."""
        return len(self._queue)

    @property
    def n_workers(self) -> int:
        """Workers that are registered."""
        return len(self._workers)

    @property
    def pending(self) -> bool:
        """Whether a submitted task still lacks its result."""
        return bool(self._open)

    def submit(self, tasks: list[LimbTask]) -> None:
        """Add new tasks; open tasks of an earlier submission are cancelled."""
        now = self._now()
        self._open = {key_of(task): _Open(task, now) for task in tasks}
        self._queue = deque(self._open)
        self._results = []
        self._assign()

    def heard(self, identity: Identity, hello: Hello | None = None) -> bool:
        """Note a sign of life: a hello registers a worker, a missing one is back, and a task that it has had
        for too long is queued again; returns False for a peer that has not registered."""
        if hello is not None:
            for old in [i for i, w in self._workers.items() if i == identity or w.name == hello.name]:
                self._forget(old, "registered anew")
            for old in [i for i, w in self._missing.items() if i == identity or w.name == hello.name]:
                del self._missing[old]
            self._workers[identity] = _Worker(hello.name, hello.backend or "unknown", self._now())
            self._assign()
        elif identity in self._missing:
            self._workers[identity] = self._missing.pop(identity)
            log.info("%s is back", self._workers[identity].name)
            self._assign()
        if identity not in self._workers:
            return False
        worker, now = self._workers[identity], self._now()
        worker.heard_s = now
        if worker.task is not None and now - worker.given_s > max(FROM_CLIENTS.silence_s, self.deadline_s):
            self._release(worker)  # the task or its result was lost: a worker sends nothing while it solves
        return True

    def finished(self, identity: Identity, message: LimbResult | LimbRefusal) -> None:
        """Add a result or refusal; one that is not expected or makes no sense is counted and dropped.

        The result counts whichever worker solved the task: it may have been forgotten or registered again.
        """
        key = key_of(message)
        worker = self._workers.get(identity)
        holder = worker if worker is not None and worker.task == key else None
        if key not in self._open:
            self.dropped += 1
        elif isinstance(message, LimbResult) and is_sound(message):
            if holder is not None:
                self._deadline.note(self._now() - holder.given_s)
            if message.backend in self.helped or len(self.helped) < MAX_BACKENDS:
                self.helped[message.backend] += 1
            self.add_result(message)
        else:
            self.dropped += isinstance(message, LimbResult)
            reason = message.reason if isinstance(message, LimbRefusal) else "its result makes no sense"
            name = worker.name if worker else "a stranger"
            log.warning("%s failed at %s: %s", name, in_words(message), reason)
        if holder is not None:
            self._release(holder)
        self._assign()

    def add_result(self, result: LimbResult) -> None:
        """Add a sound result; one that came before stays."""
        key = key_of(result)
        opened = self._open.pop(key, None)
        if opened is not None:
            TURNAROUND.observe(self._now() - opened.submitted_s)
            self._results.append(result)
            self._queue = deque(k for k in self._queue if k != key)

    def take_waiting(self) -> LimbTask | None:
        """A task for which no worker is free, for the coordinator to solve itself."""
        if not self._queue:
            return None
        key = self._queue.popleft()
        self.retries += bool(self._open[key].given_to)
        return self._open[key].task

    def collect(self) -> list[LimbResult]:
        """The results since the last call."""
        results, self._results = self._results, []
        return results

    def tick(self) -> None:
        """Handle lost and silent workers, and late tasks."""
        now = self._now()
        if now - self._probed_s >= TO_CLIENTS.every_s:
            self._probed_s = now  # a beat checks the connection: libzmq reports a lost one at once
            for identity, worker in list(self._workers.items()):
                if not self._send(identity, Beat()):
                    self._forget(identity, "connection lost")
                elif worker.task is None and now - worker.heard_s > FROM_CLIENTS.silence_s:
                    self._forget(identity, "silent")
        for key, opened in self._open.items():
            late = opened.given_to and now - opened.given_s > self.deadline_s
            if late and key not in self._queue:
                log.warning(
                    "%s is late after %.1f s: another worker gets it too",
                    in_words(opened.task),
                    now - opened.given_s,
                )
                self._queue.append(key)
        self._assign()

    @property
    def deadline_s(self) -> float:
        """How long a task may take before another worker gets it too."""
        return self._deadline.seconds

    def _forget(self, identity: Identity, reason: str) -> None:
        worker = self._workers.pop(identity)
        log.warning("forgot %s: %s", worker.name, reason)
        self._release(worker)
        keep_latest(self._missing, identity, worker, _MOST_MISSING)

    def _release(self, worker: _Worker) -> None:
        """Take a worker's task away; if it is not solved, it goes to another worker."""
        if worker.task in self._open and worker.task not in self._queue:
            self._queue.append(worker.task)
        worker.task = None

    def _assign(self) -> None:
        """Give waiting tasks to idle workers that have not had them yet."""
        for identity, worker in list(self._workers.items()):
            key = next((k for k in self._queue if identity not in self._open[k].given_to), None)
            if worker.task is not None or key is None:
                continue
            opened = self._open[key]
            if not self._send(identity, opened.task):
                self._forget(identity, "connection lost")
                continue
            self._queue.remove(key)
            self.retries += bool(opened.given_to)
            opened.given_to.append(identity)
            opened.given_s = worker.given_s = self._now()
            worker.task = key
