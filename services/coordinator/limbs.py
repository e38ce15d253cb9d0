"""Gives the limbs of a pass to the workers; the coordinator solves those for which no worker is free."""

import itertools
import secrets
import time
from collections.abc import Callable, Iterator

from proto.messages import MAX_SHARDS, LimbResult, LimbTask
from services.coordinator.dispatch import Dispatcher
from services.coordinator.overhead import Overhead
from services.mocap.search.chains import LIMBS
from services.mocap.search.descent import Solution
from services.mocap.search.jobs import LimbJob
from services.mocap.search.limb import solve_limb
from services.mocap.search.model import Model
from services.mocap.take.marks import LimbName

_FIRST_PASSES = 2**30
"""The first pass has a random number below this, which leaves as many for those that follow."""
_RESULT_WAIT_S = 0.02
"""How long to wait for a result before checking for late tasks and lost workers."""


class RemoteLimbs:
    """A LimbPool over the wire."""

    def __init__(
        self,
        model: Model,
        take: str,
        run: str,
        actor: str,
        dispatcher: Dispatcher,
        pump: Callable[[float], None],
        shards: int = 1,
        overhead: Overhead | None = None,
    ) -> None:
        """`pump(seconds)` sends and receives messages, waiting at most that long. actor: its content hash.

        shards: how many workers share a limb's grid. It is fixed for a run, because poses depend on it in the
        last digits and must not depend on which workers die. overhead: counts the time spent here except for
        solving.
        """
        self._model, self._dispatcher, self._pump = model, dispatcher, pump
        self._take, self._run = take, run
        self._actor, self._rig = actor, model.rig.content_hash
        self._shards = min(shards, MAX_SHARDS)
        self._jobs: dict[LimbName, LimbJob] = {}
        self._overhead = overhead or Overhead()
        self.frame = 0
        """The frame that jobs belong to."""
        self._passes = itertools.count(secrets.randbelow(_FIRST_PASSES))
        """Numbers of passes. They start at random, so that a late result of an earlier coordinator, which may
        be of another search of the same frame, is not taken for one of this coordinator's."""

    def start(self, jobs: list[LimbJob]) -> None:
        """See LimbPool.start."""
        with self._overhead.talking():
            self._pump(0.0)
            self._jobs = {job.limb: job for job in jobs}
            number = next(self._passes)
            self._dispatcher.submit(
                [
                    LimbTask(
                        take=self._take,
                        run=self._run,
                        frame=self.frame,
                        pass_index=number,
                        limb=job.limb,
                        shard=shard,
                        shards=self._shards,
                        actor=self._actor,
                        rig=self._rig,
                        search=job.settings.model_dump(mode="json"),
                        pose=job.pose,
                        origin_px=job.window.region.origin_px,
                        window=job.window.silhouettes,
                        unsure=job.window.sent_unsure,
                        classes=job.window.sent_classes,
                    )
                    for job in jobs
                    for shard in range(self._shards)
                ]
            )

    def finish(self) -> Iterator[tuple[LimbName, Solution]]:
        """See LimbPool.finish. Of a limb's shards the one with the least energy is used, the first of
        equals."""
        with self._overhead.talking():
            self._pump(0.0)
            while self._dispatcher.pending:
                self._dispatcher.tick()
                task = self._dispatcher.take_waiting()
                if task is not None:
                    self._dispatcher.add_result(self._solve_here(task))
                self._pump(0.0 if task is not None else _RESULT_WAIT_S)
        results = sorted(self._dispatcher.collect(), key=lambda result: (result.energy_px, result.shard))
        for name in self._jobs:
            shards = [result for result in results if result.limb == name]
            evaluations = sum(result.evaluations for result in shards)
            seconds = max(result.seconds for result in shards)
            yield (
                name,
                Solution(LIMBS[name].dofs, shards[0].values, shards[0].energy_px, evaluations, seconds),
            )

    def _solve_here(self, task: LimbTask) -> LimbResult:
        job = self._jobs[task.limb]
        shard = (task.shard, task.shards)
        began_s = time.perf_counter()
        with self._overhead.fitting():
            found = solve_limb(self._model, job.limb, job.window, job.pose, job.settings, shard)
        return LimbResult(
            **task.task_key,
            energy_px=found.energy_px,
            evaluations=found.evaluations,
            seconds=time.perf_counter() - began_s,
            backend=self._model.backend.name,
            values=found.values,
        )
