"""Solves frames of live input again a moment later, with the frames after them: a fixed-lag smoother.

It does for a block of frames what both_ways does for a take, but searches limbs in which both ways agree,
too: a limb that was lost, and that shows again within this moment, is found on the way back. Blocks without a
doubtful part stay as they are.
"""

from collections.abc import Collection, Generator, Iterator, Mapping
from dataclasses import dataclass, replace

from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.search.best_path import PathSearch
from services.mocap.search.both_ways import Step
from services.mocap.search.found import FrameSolution
from services.mocap.search.frame import extrapolated, solve_frame
from services.mocap.search.jobs import LimbPool
from services.mocap.search.model import Model
from services.mocap.search.other_people import without_others
from services.mocap.search.part_confidence import doubt_rivals
from services.mocap.search.settings import SearchSettings
from services.mocap.search.usual_differences import UsualDifferences
from services.mocap.types import Floats

_BLOCK_S = 0.3
"""Length of a block; it is settled once the next block is there as well. Longer ones find more, later."""
_MOST_WAITING_S = 4 * _BLOCK_S
"""When more than this waits, there is no time to solve all of it again."""


@dataclass(frozen=True, eq=False)
class Tracked:
    """A frame that was tracked as it came."""

    seen: TriPlanes
    """(P, H, W)"""
    absent: Collection[int]
    """Cameras that are not used."""
    time_s: float
    solution: FrameSolution
    memory: Mapping[str, list[int]]
    """The tracker's, after this frame."""


class FixedLag:
    """Settles the frames of a live take, in order."""

    def __init__(self, model: Model, settings: SearchSettings, limbs: LimbPool, first_frame: int) -> None:
        """first_frame: number of the frame that is noted first."""
        self._model, self._settings, self._limbs = model, settings, limbs
        self._first_frame = first_frame
        """Number of the first frame of those that wait."""
        self._waiting: list[Tracked] = []
        self._before: Tracked | None = None
        """The frame that was settled last."""

    def note(self, frame: Tracked) -> None:
        """Add the next frame."""
        self._waiting.append(frame)

    @property
    def _waiting_s(self) -> float:
        return self._waiting[-1].time_s - self._waiting[0].time_s if self._waiting else 0.0

    @property
    def is_late(self) -> bool:
        """Whether so much waits that frames must be settled unchanged."""
        return self._waiting_s > _MOST_WAITING_S

    def settle(self) -> Iterator[Step]:
        """Settle the next block, if there is one.

        Yields as solve_both_ways does: between two steps, the caller may note further frames.
        """
        frames = list(self._waiting)
        if self._waiting_s < 2 * _BLOCK_S:
            return
        n_settled = sum(frame.time_s < frames[0].time_s + _BLOCK_S for frame in frames)
        if not self._is_worth_it(frames, n_settled):
            yield from self.unchanged(n_settled)
            return
        trust = UsualDifferences(self._model.rig, self._settings.doubt_px)
        path = PathSearch(self._model, self._settings)
        trust.recall(frames[0].memory)
        frames = yield from self._track_back(frames, path)
        for frame, chosen in zip(frames[:n_settled], path.best()[::-1][-len(frames) :], strict=False):
            yield Step("settling", self._first_frame)
            solution = self._solve(frame, chosen.pose[None], trust)
            doubt_rivals(solution, chosen)
            first = frame.solution
            yield self._settled(replace(solution, seconds=first.seconds, limb_seconds=first.limb_seconds))

    def unchanged(self, n_settled: int | None = None) -> Iterator[Step]:
        """Settle the next frames as they were solved first: so many, or all."""
        for frame in self._waiting[:n_settled]:
            yield self._settled(frame.solution)

    def catch_up(self) -> Iterator[Step]:
        """Settle frames as they were solved first, until only two blocks wait. A block that is being settled
        must be abandoned before."""
        while self._waiting_s > 2 * _BLOCK_S:
            yield from self.unchanged(1)

    def _is_worth_it(self, frames: list[Tracked], n_settled: int) -> bool:
        """Whether a limb or the head was doubtful in the block, and the actor was not lost."""
        parts = [part for frame in frames[:n_settled] for part in frame.solution.distrusted]
        return bool(parts) and not any(frame.solution.is_lost for frame in frames)

    def _track_back(self, frames: list[Tracked], path: PathSearch) -> Generator[Step, None, list[Tracked]]:
        """Track from the last of some frames to the first, and add both ways to a path, which leads to the
        frame that was settled last; returns the frames, in which other people are unsure."""
        trust = UsualDifferences(self._model.rig, self._settings.doubt_px)
        last = self._alone(frames[-1])
        poses, alone = [last.solution.pose], [last]
        path.add(last.seen, poses[0], poses[0], last.absent)
        for k in reversed(range(len(frames) - 1)):
            yield Step("tracking back", self._first_frame + k)
            frame = self._alone(frames[k])
            alone.append(frame)
            poses.append(self._solve(frame, extrapolated(poses[-2:]), trust).pose)
            path.add(frame.seen, frame.solution.pose, poses[-1], frame.absent)
        if self._before is not None:
            pose = self._before.solution.pose
            path.add(self._alone(self._before).seen, pose, pose, self._before.absent)
        return alone[::-1]

    def _solve(self, frame: Tracked, starts: Floats, trust: UsualDifferences) -> FrameSolution:
        picture, settings = self._model.without_cameras(frame.seen, frame.absent, self._settings)
        return solve_frame(self._model, picture, starts, settings, self._limbs, trust)

    def _alone(self, frame: Tracked) -> Tracked:
        """A frame in which other people are unsure, by its first solution."""
        return replace(frame, seen=without_others(self._model, frame.seen, frame.solution.pose, frame.absent))

    def _settled(self, solution: FrameSolution) -> Step:
        """The first of the waiting frames has this solution, and waits no longer."""
        self._before = replace(self._waiting.pop(0), solution=solution)
        self._first_frame += 1
        return Step("settling", self._first_frame - 1, solution)
