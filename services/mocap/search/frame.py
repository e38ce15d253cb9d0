"""Solving one frame: passes of torso, limbs and head until the energy stops falling."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from services.mocap.body.kinematics import clip_to_limits
from services.mocap.energy.cost import Cost
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import LIMBS, LimbName
from services.mocap.search.settings import SearchSettings
from services.mocap.search.solve import (
    Model,
    Solution,
    solve_head,
    solve_limb,
    solve_torso,
    stage_window,
    whole_body_energy,
)
from services.mocap.types import Floats


@dataclass(frozen=True, eq=False)
class LimbJob:
    """One limb of one pass, ready to be solved anywhere."""

    pass_index: int
    limb: LimbName
    window: Picture
    pose: Floats
    settings: SearchSettings


class LimbPool(Protocol):
    """Something that solves limbs while the caller does other work."""

    def start(self, jobs: list[LimbJob]) -> None:
        """Take over the jobs of one pass."""
        ...

    def finish(self) -> Iterable[Solution]:
        """Wait for the solutions of all started jobs, one per job, in any order."""
        ...


class LocalLimbs:
    """Solves limbs in this process, one after the other."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._jobs: list[LimbJob] = []

    def start(self, jobs: list[LimbJob]) -> None:
        """See LimbPool.start."""
        self._jobs = jobs

    def finish(self) -> Iterator[Solution]:
        """See LimbPool.finish."""
        for job in self._jobs:
            yield solve_limb(self._model, job.limb, job.window, job.pose, job.settings)


@dataclass(eq=False)
class FrameSolution:
    """A frame's pose and what finding it took."""

    pose: Floats
    """(35,)"""
    energy_px: float
    """Differing pixels of the whole body's full mesh in the whole pictures, over all cameras, whatever was
    minimised."""
    passes: int = 0
    evaluations: int = 0
    seconds: dict[str, float] = field(default_factory=lambda: {"torso": 0.0, "head": 0.0, "limbs": 0.0})
    """Wall time per stage; limbs: from after the head until the last limb was there."""


def solve_frame(
    model: Model,
    whole: Picture,
    starts: Floats,
    settings: SearchSettings,
    limbs: LimbPool,
    first_pass: int = 0,
) -> FrameSolution:
    """Find the pose of one frame, beginning at the best of the start poses (N, 35).

    The paper, section 3: torso, then every limb with its hand or foot and the head, repeated until converged.
    The result is the best pose seen at the end of a pass, by the cost and the level of detail of the search;
    starts, moved within the joint limits, count as seen. first_pass: the number of the first pass, where a
    frame is solved more than once.
    """
    starts, whole = clip_to_limits(starts), settings.cost.priced(whole)
    energy = whole_body_energy(model, whole, starts[0], settings.cost, settings.detail_px)
    energies = energy(starts)
    best = FrameSolution(
        starts[int(energies.argmin())].copy(), float(energies.min()), evaluations=len(starts)
    )
    halved, pose = settings.cost.priced(whole.halved()), best.pose
    for pass_index in range(first_pass, first_pass + settings.max_passes):
        before = best.energy_px
        pose = _one_pass(model, whole, halved, pose, settings, limbs, pass_index, best)
        energy_px = float(energy(pose[None])[0])
        best.passes, best.evaluations = best.passes + 1, best.evaluations + 1
        if energy_px < best.energy_px:
            best.pose, best.energy_px = pose, energy_px
        if before - energy_px <= settings.pass_tolerance * before:
            break
    _report_plainly(model, whole, settings, best)
    return best


def _report_plainly(model: Model, whole: Picture, settings: SearchSettings, found: FrameSolution) -> None:
    """Where another energy was minimised, report plain XOR of the full mesh all the same."""
    if (settings.cost, settings.detail_px) != (Cost(), 0.0):
        energy = whole_body_energy(model, whole, found.pose, Cost(), 0.0)
        found.energy_px = float(energy(found.pose[None])[0])
        found.evaluations += 1


def _one_pass(
    model: Model,
    whole: Picture,
    halved: Picture,
    pose: Floats,
    settings: SearchSettings,
    limbs: LimbPool,
    pass_index: int,
    account: FrameSolution,
) -> Floats:
    """Torso, then limbs and head at the same time; returns the new pose and books times and evaluations."""
    clock = _Clock(account.seconds)
    torso = solve_torso(model, halved, pose, settings)
    pose = torso.applied_to(pose)
    clock.book("torso")
    limbs.start(limb_jobs(model, whole, pose, settings, pass_index))
    head = solve_head(model, whole, pose, settings)
    pose = head.applied_to(pose)
    clock.book("head")
    solutions = [torso, head]
    for limb in limbs.finish():
        pose = limb.applied_to(pose)
        solutions.append(limb)
    clock.book("limbs")
    account.evaluations += sum(solution.evaluations for solution in solutions)
    return pose


def limb_jobs(
    model: Model, whole: Picture, pose: Floats, settings: SearchSettings, pass_index: int
) -> list[LimbJob]:
    """The four limbs of a pass, each with its window of the input and the cost's margin around it."""
    margin_px = settings.cost.margin_px
    return [
        LimbJob(pass_index, name, stage_window(model, limb.main, whole, pose, margin_px), pose, settings)
        for name, limb in LIMBS.items()
    ]


def extrapolated(poses: list[Floats]) -> Floats:
    """Start poses (N, 35) for a frame from those of the frames before it, the latest last.

    The last pose, and where it would go on to at its present speed.
    """
    last = poses[-1]
    if len(poses) < 2:
        return last[None]
    return np.stack([last, 2.0 * last - poses[-2]])


class _Clock:
    """Books the time since the last booking to a stage."""

    def __init__(self, seconds: dict[str, float]) -> None:
        self._seconds, self._last = seconds, time.perf_counter()

    def book(self, stage: str) -> None:
        now = time.perf_counter()
        self._seconds[stage] += now - self._last
        self._last = now
