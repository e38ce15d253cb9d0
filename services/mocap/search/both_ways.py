"""Solves a recorded take a second time, with what a track from its last frame back adds to the first one.

A tracker loses a limb where it disappears, before the trunk say, and finds it again where it shows: a limb
that one way has lost the other way often has. Each frame is solved again from the best path through both
tracks.
"""

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.search.best_path import Chosen, PathSearch
from services.mocap.search.elsewhere import look_elsewhere
from services.mocap.search.first_pose import find_first_pose
from services.mocap.search.found import FrameSolution
from services.mocap.search.frame import align_alone
from services.mocap.search.jobs import LimbPool
from services.mocap.search.model import Model
from services.mocap.search.other_people import without_others
from services.mocap.search.part_confidence import SteadyConfidence, doubt_rivals
from services.mocap.search.settings import SearchSettings
from services.mocap.search.silhouette_spool import SilhouetteSpool
from services.mocap.search.tracker import ELSEWHERE_M, FLOOR_PLACE, Tracker, is_far, unless_far, whole_person
from services.mocap.search.two_people import Places
from services.mocap.search.usual_differences import UsualDifferences
from services.mocap.types import Floats

_THOROUGH_EVERY_S = 1 / 3
"""How often limbs that are not sure are searched far on the way back."""

Sweep: TypeAlias = Literal["tracking back", "settling"]
"""What is done to all frames in turn: track them back; solve each again from the best path."""


@dataclass(frozen=True, eq=False)
class Step:
    """One step: the frame that is solved next, or its solution."""

    sweep: Sweep
    frame: int
    """From 0, or of live input its number."""
    solution: FrameSolution | None = None
    """None on the way back, and in the step before a frame's solution."""


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
    First yields a step before each frame is tracked back, from the last to the first. Then yields two steps
    for each frame, from the first to the last: one before its solution is waited for, and, once some more
    frames are solved, one with it. So the caller can do other work, or end it. Frames are settled a few
    ahead, on several threads.
    """
    best = yield from _track_back(model, settings, limbs, seen, forward, fps)

    def aligned(copy: Model, of_frame: tuple[TriPlanes, Chosen]) -> FrameSolution:
        as_seen, chosen = of_frame
        picture = model.picture_of(without_others(copy, as_seen, chosen.pose))
        solution = align_alone(copy, picture, chosen.pose, settings)
        if settings.search_limbs != "never" and not is_far(solution, picture):
            look_elsewhere(copy, picture, solution, settings)
        return solution

    # Both tracks have searched limbs and the actor: a third search finds nothing more, and takes half as long
    # as they do.
    solutions = model.copies.each(aligned, zip(map(seen.__getitem__, range(len(best))), best, strict=True))
    trust, steady = UsualDifferences(model.rig, settings.doubt_px), SteadyConfidence(fps)
    for frame, chosen in enumerate(best):
        yield Step("settling", frame)
        solution = next(solutions)
        trust.judge(solution)
        if solution.is_lost:
            picture = model.picture_of(without_others(model, seen[frame], chosen.pose))
            solution = unless_far(solution, chosen.pose, picture)
        doubt_rivals(solution, chosen)
        for final in steady.add(solution):
            yield Step("settling", *final)
    for final in steady.rest():
        yield Step("settling", *final)


def _track_back(
    model: Model,
    settings: SearchSettings,
    limbs: LimbPool,
    seen: SilhouetteSpool,
    forward: Floats,
    fps: float,
) -> Generator[Step, None, list[Chosen]]:
    """Track from the last frame to the first; yields before each frame, and returns the best path of both
    ways, from the first frame on."""
    last, path = len(forward) - 1, PathSearch(model, settings)
    thorough_every = max(1, round(_THOROUGH_EVERY_S * fps))
    yield Step("tracking back", last)
    start = found_anew(model, settings, limbs, seen[last], forward[last])
    tracker = Tracker(model, settings, limbs, start[None])
    for frame in range(last, -1, -1):
        if frame != last:
            yield Step("tracking back", frame)
        # What differs in the first frame of a track, or for long, becomes usual, and is then no reason to
        # search a limb: some frames are searched thoroughly.
        is_thorough = frame == last or frame % thorough_every == 0
        planes, back = seen[frame], forward[frame]
        if not is_thorough and tracker.expects(back):
            tracker.follow(back)
        else:
            back = tracker.solve(planes, other=back, thorough=is_thorough).pose
            if _is_somebody_else(model, planes, back, forward[frame]):
                back = forward[frame]
                tracker = Tracker(model, settings, limbs, back[None])
        path.add(_without_others(model, planes, forward[frame], back), forward[frame], back)
    return path.best()[::-1]


def _is_somebody_else(model: Model, seen: TriPlanes, back: Floats, forward: Floats) -> bool:
    """Whether a frame (P, H, W) shows others besides who has the pose (D,) of the way forward, and that of
    the way back is far from it: who the actor is, the first frame tells."""
    away_m = np.linalg.norm(back[FLOOR_PLACE] - forward[FLOOR_PLACE])
    return bool(away_m > ELSEWHERE_M) and without_others(model, seen, forward) is not seen


def _without_others(model: Model, seen: TriPlanes, one: Floats, other: Floats) -> TriPlanes:
    """A frame (P, H, W) in which what shows other people is unsure, by both of two poses (D,)."""
    by_one = without_others(model, seen, one)
    if by_one is seen or np.array_equal(one, other):
        return by_one
    return seen.doubting(by_one.unsure & without_others(model, seen, other).unsure)


def found_anew(
    model: Model, settings: SearchSettings, limbs: LimbPool, seen: TriPlanes, pose: Floats
) -> Floats:
    """Search the pose (D,) of a frame with silhouettes `seen` (P, H, W) like a first pose, with the heading
    of a known pose; returns the known pose if no whole person is visible."""
    found = whole_person(model, seen, Places(pose[FLOOR_PLACE]))
    if found is None:
        return pose
    hull, alone = found
    facing_rad = float(pose[DOF_INDEX["root_heading"]])
    picture = model.picture_of(alone)
    return find_first_pose(model, picture, hull, limbs, settings, facing_rad).solution.pose
