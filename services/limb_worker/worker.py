"""What a limb worker does between its links and its solver."""

import logging
import time
from collections.abc import Sequence
from functools import partial

from proto.link import Link
from proto.messages import Blob, BlobRequest, LimbRefusal, LimbTask, Message
from proto.sockets import wait
from proto.streams import ASK_AGAIN_S
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

log = logging.getLogger(__name__)


class Worker:
    """Receives tasks from coordinators, requests missing content, and returns results."""

    def __init__(self, links: Sequence[Link], engine: Engine) -> None:
        self._links = links
        self._tasks: dict[int, LimbTask] = {}
        """The coordinators, numbered from 0, each with its task that is not started; the one that has waited
        longest is first. A correct coordinator sends one task at a time; else only the newest is held."""
        self._solver = LimbSolver(engine, takes=len(links))
        self._asked_s = 0.0

    def listen(self) -> None:
        """Wait briefly for messages, then handle them until a task is ready."""
        is_ready = any(map(self._is_ready, self._tasks.values()))
        wait([link.socket for link in self._links], 0.0 if is_ready else STOP_CHECK_S)
        for number, link in enumerate(self._links):
            hear(link, partial(self._act, number), most=_MOST_AT_ONCE)

    def _act(self, number: int, message: Message) -> None:
        """Handle one message of a coordinator."""
        message = with_whole_poses(message)
        if isinstance(message, LimbTask):
            self._tasks[number] = message
            self._ask_for(number, message)
        elif isinstance(message, Blob):
            try:
                self._solver.blobs.add(message)
            except UnusableBlobError as error:
                log.warning("unusable content: %s", error)
                return
            if message.kind == "actor":  # it may need a mesh
                for giver, task in self._tasks.items():
                    self._ask_for(giver, task)

    def _ask_for(self, number: int, task: LimbTask) -> None:
        for content in self._solver.blobs.missing(task):
            self._asked_s = time.monotonic()
            self._links[number].send(BlobRequest(hash=content))

    def work(self) -> None:
        """Solve the first task that is ready, if any."""
        ready = [number for number, task in self._tasks.items() if self._is_ready(task)]
        WAITING.set(len(self._tasks) - len(ready))
        HELD.set(len(self._tasks) - bool(ready))
        if not ready:
            return
        number = ready[0]
        task = self._tasks.pop(number)
        about(take=task.take, frame=task.frame, limb=task.limb, **{"pass": task.pass_index})
        answer = self._solver.solve(task)
        if isinstance(answer, LimbRefusal):
            log.warning("refused a task: %s", answer.reason)
        note_answer(answer)
        self._links[number].send(answer)

    def _is_ready(self, task: LimbTask) -> bool:
        return not self._solver.blobs.missing(task)

    def tick(self) -> None:
        """Stay registered everywhere, and ask again for content that has not come.

        A coordinator at which this worker registers again sends its tasks again.
        """
        for number, link in enumerate(self._links):
            if link.tick():
                self._tasks.pop(number, None)
        if time.monotonic() - self._asked_s > ASK_AGAIN_S:  # what was sent may be lost, or damaged
            for giver, task in self._tasks.items():
                self._ask_for(giver, task)
