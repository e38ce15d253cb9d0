"""The limbs of a pass as jobs that other processes can solve."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import LIMBS
from services.mocap.search.descent import Solution
from services.mocap.search.limb import limb_picture, solve_limb
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.take.marks import LimbName
from services.mocap.types import Floats


@dataclass(frozen=True, eq=False)
class LimbJob:
    """One limb of one pass, ready to be solved anywhere."""

    limb: LimbName
    window: Picture
    pose: Floats
    settings: SearchSettings


class LimbPool(Protocol):
    """Something that solves limbs while the caller does other work."""

    def start(self, jobs: list[LimbJob]) -> None:
        """Start the jobs of one pass."""
        ...

    def finish(self) -> Iterable[tuple[LimbName, Solution]]:
        """Wait for the solutions of all started jobs, by limb, in any order."""
        ...


class LocalLimbs:
    """Solves limbs in this process: on the CPU several at the same time, else one after the other."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._jobs: list[LimbJob] = []

    def start(self, jobs: list[LimbJob]) -> None:
        """See LimbPool.start."""
        self._jobs = jobs

    def finish(self) -> Iterator[tuple[LimbName, Solution]]:
        """See LimbPool.finish."""

        def solved(model: Model, job: LimbJob) -> tuple[LimbName, Solution]:
            began_s = time.perf_counter()
            found = solve_limb(model, job.limb, job.window, job.pose, job.settings)
            return job.limb, replace(found, seconds=time.perf_counter() - began_s)

        if len(self._jobs) > 1 and isinstance(self._model.backend, CpuBackend):
            yield from self._model.copies.each(solved, self._jobs)
        else:
            yield from (solved(self._model, job) for job in self._jobs)


def limb_jobs(
    model: Model,
    whole: Picture,
    pose: Floats,
    settings: SearchSettings,
    limbs: Iterable[LimbName] = tuple(LIMBS),
) -> list[LimbJob]:
    """The limbs of a pass, each with its part of the input."""
    return [LimbJob(name, limb_picture(model, name, whole, pose, settings), pose, settings) for name in limbs]
