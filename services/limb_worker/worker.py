"""What a limb worker does between its links and its solver."""

import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from proto.link import Link
from proto.messages import Blob, BlobRequest, LimbRefusal, LimbTask, Message
from proto.sockets import wait
from services.blob_store import UnusableBlobError
from services.limb_worker.metrics import HELD, WAITING, note_answer
from services.limb_worker.solver import LimbSolver
from services.listener import hear
from services.logs import about
from services.mocap.energy.engine import Engine
from services.pose_size import with_whole_poses
from services.process import STOP_CHECK_S

_MOST_AT_ONCE = 64
"""Messages read from one coordinator before the others get their turn."""
_TASKS_HELD = 8
"""At most this many tasks of one coordinator are held; the oldest is dropped first. A correct coordinator
sends one at a time."""

log = logging.getLogger(__name__)


class Turns:
    """A worker's tasks that it has not started, by coordinator, numbered from 0, who are served in turn, one
    task each."""

    def __init__(self, coordinators: int) -> None:
        self._held: list[deque[LimbTask]] = [deque(maxlen=_TASKS_HELD) for _ in range(coordinators)]
        self._next = 0

    def __len__(self) -> int:
        return sum(len(held) for held in self._held)

    def __iter__(self) -> Iterator[tuple[int, LimbTask]]:
        """All tasks that are held, with their coordinators' numbers."""
        return ((number, task) for number, held in enumerate(self._held) for task in held)

    def add(self, coordinator: int, task: LimbTask) -> None:
        """Hold a task; a coordinator that sends too many loses its oldest, and none of another's."""
        self._held[coordinator].append(task)

    def forget(self, coordinator: int) -> None:
        """Drop the tasks of a coordinator that no longer waits for them."""
        self._held[coordinator].clear()

    def take(self, is_ready: Callable[[LimbTask], bool]) -> tuple[int, LimbTask] | None:
        """The next task and its coordinator; None if none is ready.

        A coordinator without a ready task loses only this turn.
        """
        for step in range(len(self._held)):
            number = (self._next + step) % len(self._held)
            task = next((held for held in self._held[number] if is_ready(held)), None)
            if task is not None:
                self._held[number].remove(task)
                self._next = (number + 1) % len(self._held)
                return number, task
        return None


class Worker:
    """Receives tasks from coordinators, requests missing content, and returns results."""

    def __init__(self, links: Sequence[Link], engine: Engine) -> None:
        self._links, self._turns = links, Turns(len(links))
        self._solver = LimbSolver(engine, takes=len(links))

    def listen(self) -> None:
        """Wait briefly for messages, then handle them until a task is ready."""
        is_ready = any(not self._solver.blobs.missing(task) for _, task in self._turns)
        wait([link.socket for link in self._links], 0.0 if is_ready else STOP_CHECK_S)
        for number, link in enumerate(self._links):
            hear(link, partial(self._act, number), most=_MOST_AT_ONCE)

    def _act(self, number: int, message: Message) -> None:
        """Handle one message of a coordinator."""
        message = with_whole_poses(message)
        if isinstance(message, LimbTask):
            self._turns.add(number, message)
            self._ask_for(number, message)
        elif isinstance(message, Blob):
            try:
                self._solver.blobs.add(message)
            except UnusableBlobError as error:
                log.warning("unusable content: %s", error)
                return
            if message.kind == "actor":  # it may need a mesh
                for giver, task in self._turns:
                    self._ask_for(giver, task)

    def _ask_for(self, number: int, task: LimbTask) -> None:
        for content in self._solver.blobs.missing(task):
            self._links[number].send(BlobRequest(hash=content))

    def work(self) -> None:
        """Solve the next task, if one is ready."""
        taken = self._turns.take(lambda task: not self._solver.blobs.missing(task))
        WAITING.set(sum(bool(self._solver.blobs.missing(task)) for _, task in self._turns))
        HELD.set(len(self._turns))
        if taken is None:
            return
        number, task = taken
        about(take=task.take, frame=task.frame, limb=task.limb, **{"pass": task.pass_index})
        answer = self._solver.solve(task)
        if isinstance(answer, LimbRefusal):
            log.warning("refused a task: %s", answer.reason)
        note_answer(answer)
        self._links[number].send(answer)

    def tick(self) -> None:
        """Stay registered everywhere; a coordinator at which this worker registers again sends its tasks
        again."""
        for number, link in enumerate(self._links):
            if link.tick():
                self._turns.forget(number)
