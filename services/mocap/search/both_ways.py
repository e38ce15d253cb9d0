"""Solves a recorded take a second time, with what a track from its last frame back adds to the first one.

A tracker loses a limb where it disappears, before the trunk say, and finds it again where it shows: a limb
that one way has lost the other way often has. Each frame is solved again from the best path through both
tracks.
"""

from collections.abc import Iterator
from concurrent.futures import wait
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, Self, TypeAlias

import numpy as np

from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.picture import Picture
from services.mocap.search.best_path import Chosen, PathSearch
from services.mocap.search.first_pose import find_first_pose
from services.mocap.search.found import FrameSolution
from services.mocap.search.frame import solve_frame
from services.mocap.search.jobs import LimbPool, LocalLimbs
from services.mocap.search.model import Model
from services.mocap.search.part_confidence import PartConfidence, doubt_rivals
from services.mocap.search.settings import SearchSettings
from services.mocap.search.silhouette_spool import SilhouetteSpool
from services.mocap.search.tracker import Tracker, unless_far, whole_person
from services.mocap.types import Floats

_THOROUGH_EVERY_S = 1 / 3
"""How often limbs that are not sure are searched far on the way back."""
_BLOCK_S, _OVERLAP_S = 10.0, 1.5
"""Takes longer than one and a half blocks are tracked back in several; each begins this much after its
end."""
_SAY_EVERY_S = 0.1

Sweep: TypeAlias = Literal["tracking back", "settling"]
"""What is done to all frames in turn: track them back; solve each again from the best path."""


@dataclass(frozen=True, eq=False)
class Step:
    """One step: the frame that is solved next, or its solution."""

    sweep: Sweep
    frame: int
    """From 0, or of live input its number."""
    solution: FrameSolution | None = None
    """None: it is about to be solved; of the way back there is none."""


def solve_both_ways(
    model: Model,
    settings: SearchSettings,
    limbs: LimbPool,
    seen: SilhouetteSpool,
    forward: Floats,
    fps: float,
) -> Iterator[Step]:
    """Solve all frames of a take again, given the poses (N, D) of a track from its first frame on.

    fps: frames per second.
    Yields a step before a frame is solved, so that the caller can do other work or end it, and one with the
    frame's final solution: from the last frame to the first one tracking back, then from the first to the
    last. A long take is tracked back in blocks at the same time, without the given limbs; then a step says
    every moment how many frames are left.
    """
    path, way_back = PathSearch(model, settings), _WayBack(settings, seen, forward, fps)
    blocks = _blocks(len(forward), fps)
    if len(blocks) == 1:
        poses = way_back.poses(model, limbs, blocks[0])
        for frame in reversed(blocks[0]):
            yield Step("tracking back", frame)
            path.add(seen[frame], forward[frame], next(poses))
    else:
        with way_back:
            found = [model.copies.start(way_back.of_block, block) for block in reversed(blocks)]
            for block, poses_of_block in zip(reversed(blocks), found, strict=True):
                while not wait((poses_of_block,), _SAY_EVERY_S).done:
                    yield Step("tracking back", len(forward) - 1 - way_back.n_solved)
                for frame, pose in zip(reversed(block), poses_of_block.result(), strict=True):
                    path.add(seen[frame], forward[frame], pose)
    # Both tracks have searched limbs and the actor: a third search finds nothing more, and takes half as long
    # as they do.
    aligned_only, best = settings.aligned_only(), path.best()[::-1]

    def aligned(copy: Model, of_frame: tuple[TriPlanes, Chosen]) -> FrameSolution:
        planes, chosen = of_frame
        whole = Picture.of_frame(model.rig, planes)
        return solve_frame(copy, whole, chosen.pose[None], aligned_only, limbs)

    solutions = model.copies.each(aligned, zip(map(seen.__getitem__, range(len(best))), best, strict=True))
    trust = PartConfidence(model.rig, settings.doubt_px)
    for frame, chosen in enumerate(best):
        yield Step("settling", frame)
        solution = next(solutions)
        trust.judge(solution)
        if "torso" in solution.distrusted:
            solution = unless_far(solution, chosen.pose, seen[frame])
        doubt_rivals(solution, chosen)
        yield Step("settling", frame, solution)


def _blocks(n_frames: int, fps: float) -> list[range]:
    """The blocks in which a take is tracked back, from the first one on."""
    n_blocks = max(1, round(n_frames / (_BLOCK_S * fps)))
    ends = np.linspace(0, n_frames, n_blocks + 1).round().astype(int).tolist()
    return [range(*block) for block in pairwise(ends)]


class _WayBack:
    """Tracks a take from its last frame back, given the poses (N, D) of the track forwards."""

    def __init__(self, settings: SearchSettings, seen: SilhouetteSpool, forward: Floats, fps: float) -> None:
        self._settings, self._seen, self._forward = settings, seen, forward
        self._thorough_every = max(1, round(_THOROUGH_EVERY_S * fps))
        self._overlap = round(_OVERLAP_S * fps)
        self._has_ended = False
        self.n_solved = 0
        """Frames that are solved, about: threads count them without a lock."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._has_ended = True

    def poses(self, model: Model, limbs: LimbPool, frames: range) -> Iterator[Floats]:
        """The poses (D,) of frames, from the last one back, each solved when it is needed."""
        settings, seen, forward, last = self._settings, self._seen, self._forward, frames[-1]
        start = forward[last]
        if last == len(forward) - 1:
            start = found_anew(model, settings, limbs, seen[last], start)
        tracker = Tracker(model, settings, limbs, start[None])
        for frame in reversed(frames):
            # What differs in the first frame of a track, or for long, becomes usual, and is then no reason to
            # search a limb: some frames are searched thoroughly.
            is_thorough = frame == last or frame % self._thorough_every == 0
            yield tracker.solve(seen[frame], other=forward[frame], thorough=is_thorough).pose

    def of_block(self, model: Model, block: range) -> list[Floats]:
        """The poses of a block, from its last frame back; the track begins some frames later, so that it has
        found what the track forwards has lost. Nothing once the with statement has ended."""
        found = list[Floats]()
        stop = min(block.stop + self._overlap, len(self._forward))
        for pose in self.poses(model, LocalLimbs(model), range(block.start, stop)):
            if self._has_ended:
                break
            found.append(pose)
            self.n_solved += len(found) > stop - block.stop
        return found[stop - block.stop :]


def found_anew(
    model: Model, settings: SearchSettings, limbs: LimbPool, seen: TriPlanes, pose: Floats
) -> Floats:
    """Search the pose (D,) of a frame with silhouettes `seen` (P, H, W) like a first pose, with the heading
    of a known pose; returns the known pose if no whole person is visible."""
    hull, picture = whole_person(model, seen), Picture.of_frame(model.rig, seen)
    if hull is None:
        return pose
    facing_rad = float(pose[DOF_INDEX["root_heading"]])
    return find_first_pose(model, picture, hull, limbs, settings, facing_rad).solution.pose
