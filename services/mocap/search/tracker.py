"""Tracks one actor from frame to frame, and finds a lost actor again."""

import logging
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.energy.bitplanes import TriPlanes, count_bits, unpack
from services.mocap.energy.picture import Picture
from services.mocap.errors import TakeError
from services.mocap.search.best_path import apart_m
from services.mocap.search.chains import HEAD
from services.mocap.search.first_pose import find_first_pose
from services.mocap.search.found import BY_ENERGY, FrameSolution
from services.mocap.search.frame import align_alone, extrapolated, solve_frame
from services.mocap.search.hull import Hull, carve
from services.mocap.search.jobs import LimbPool
from services.mocap.search.model import Model
from services.mocap.search.other_people import find_others, without_others
from services.mocap.search.plausibility import look_first
from services.mocap.search.settings import SearchSettings
from services.mocap.search.two_people import Places
from services.mocap.search.usual_differences import UsualDifferences
from services.mocap.take.marks import PARTS
from services.mocap.types import Floats

_Frame = TypeVar("_Frame")

log = logging.getLogger(__name__)

_TRACKER, _OTHERS = "tracker", "others"
"""Names of its own numbers in a memory."""
ELSEWHERE_M = 0.5
"""Somebody so far from the actor is somebody else."""
FLOOR_PLACE = [DOF_INDEX["root_x"], DOF_INDEX["root_y"]]
_LOST = "the actor is lost: poses are doubtful until the body fits again or a whole person is in view"
_LONGEST_WAIT = 16
"""Most frames between two attempts to find a lost actor."""
_PAUSE = 3
"""Frames after one in which no whole person was found: to look takes as long as tracking many frames."""
_REMEMBERED = 60
"""Frames for which it is known where others were: they walk."""
_EXPECTED_M, _EXPECTED_RAD = 0.04, 0.2
"""A pose is expected if no joint is farther from where the last poses lead to, and the head is turned by
less: no joint moves with it, and alignment alone does not turn it back, as it does hands and feet. In five
takes, four of them hard, a track that expected another one within 4 cm was never more than 6 cm from it after
the frame was solved."""
_MOST_FOLLOWED = 0.5
"""A doubtful body is followed while fewer pixels differ than this share of the silhouettes': then part of the
actor is hidden, or spreads more cloth than usual, but the body is still about there."""


class Tracker:
    """Solves frame after frame, each from the previous ones; finds the actor again after a loss."""

    def __init__(self, model: Model, settings: SearchSettings, limbs: LimbPool, poses: Floats) -> None:
        """poses: (N, D) the first one, or else the last two of a tracker that this one goes on from."""
        self._model, self._settings, self._limbs = model, settings, limbs
        self._trust = UsualDifferences(model.rig, settings.doubt_px)
        self._poses: list[Floats] = list(poses)
        self._lost_frames = self._tries = self._wait = 0
        self._others: list[int] = []
        """Where on the floor other people were last, x and y in mm, and how many frames ago, without those in
        which the actor was lost; empty if there was nobody else, or long ago."""

    @property
    def is_lost(self) -> bool:
        """Whether the actor was not found in the last frame."""
        return self._lost_frames > 0

    def memory(self) -> dict[str, list[int]]:
        """Its state, besides the last two poses."""
        known = [len(self._poses), self._lost_frames, self._tries, self._wait]
        return {_TRACKER: known, _OTHERS: self._others, **self._trust.as_lists()}

    def recall(self, memory: Mapping[str, list[int]]) -> None:
        """Continue from another coordinator's state; raises ValueError if it is invalid."""
        n_poses, self._lost_frames, self._tries, self._wait = memory.get(_TRACKER, [])
        if not 0 < n_poses <= len(self._poses):
            raise ValueError(f"{n_poses} poses to remember, {len(self._poses)} given")
        self._poses = self._poses[-n_poses:]
        self._others = memory.get(_OTHERS, [])
        self._trust.recall(memory)

    def solve(
        self,
        seen: TriPlanes,
        absent: Collection[int] = (),
        known: Floats | None = None,
        other: Floats | None = None,
        *,
        aligned: FrameSolution | None = None,
        thorough: bool = False,
        hurried: bool = False,
    ) -> FrameSolution:
        """Find the pose in the next frame with silhouettes `seen` (P, H, W).

        absent: cameras that are not used. known: a pose (D,) to begin with, too, as an earlier run found it
        for this frame. other, thorough: as in solve_by_contours. hurried: limbs are not searched, which takes
        several times as long as the rest. While the actor is lost, the torso is unreliable, which stands for
        the whole body; where the body is not even near the silhouettes, the pose is the last one found.

        If a way back follows, a known pose is only aligned, unless a part is doubtful then: limbs are left to
        the way back. aligned: this alignment, if it was made before (aligned_ahead).
        """
        starts = extrapolated(self._poses[-2:])
        alone, others_m = find_others(self._model, seen, starts[-1] if known is None else known, absent)
        picture, settings = self._model.without_cameras(alone, absent, self._settings)
        if known is not None:
            starts = np.vstack([starts, known])

        def solved(by: SearchSettings) -> FrameSolution:
            return solve_frame(
                self._model, picture, starts, by, self._limbs, self._trust, other, thorough=thorough
            )

        usual = self._trust.as_lists()
        if known is not None and settings.goes_both_ways:
            solution = aligned or align_alone(self._model, picture, known, settings)
            self._trust.judge(solution)
            is_enough = not solution.distrusted
        else:
            solution = solved(settings.aligned_only() if hurried else settings)
            is_enough = not (hurried and solution.is_lost)
        if not is_enough:  # perhaps because limbs were not searched
            self._trust.recall(usual)  # what differs without them is not usual
            solution = solved(settings)
        is_other = self._has_jumped_to_others(solution.pose)
        is_lost = solution.is_lost or is_other
        if is_lost or self._lost_frames:
            self._lost_frames += 1
            if self._lost_frames == 1:
                log.warning(_LOST)
            # An actor who returns may have turned round, which continuing the old pose would not detect.
            again = self._find_again(seen, absent, settings, at_once=not is_lost)
            if again is None and is_lost:
                return self._kept(solution, picture, is_other=is_other)
            log.info("the actor was found again after %d frames", self._lost_frames)
            found = [one for one in (again, None if is_lost else solution) if one is not None]
            solution, self._poses = min(found, key=BY_ENERGY), []
        self.follow(solution.pose)
        self._note_others(others_m)
        self._lost_frames = self._tries = self._wait = 0
        return solution

    def expects(self, pose: Floats) -> bool:
        """Whether the next frame's pose is likely to be this one (D,), by the last ones."""

        def is_near(expected: Floats) -> bool:
            turned_rad = np.abs(pose - expected)[list(HEAD.dofs)].max()
            apart = apart_m(pose, expected, self._model.body.offsets_m)
            return bool(turned_rad < _EXPECTED_RAD and apart.max() < _EXPECTED_M)

        return not self.is_lost and any(map(is_near, extrapolated(self._poses[-2:])))

    def follow(self, pose: Floats) -> None:
        """Take a pose (D,) as the next frame's, without looking at the frame."""
        self._poses = [*self._poses[-1:], pose]

    def _note_others(self, others_m: Floats | None) -> None:
        """Remember where on the floor (2,) others are in a frame, or else that it is one frame longer ago."""
        if others_m is not None:
            self._others = [*np.rint(1000 * others_m).astype(int).tolist(), 0]
        elif self._others:
            *place_mm, age = self._others
            self._others = [*place_mm, age + 1] if age < _REMEMBERED else []

    @property
    def _places(self) -> Places:
        """Where the actor and others were last."""
        others_m = np.array(self._others[:2]) / 1000 if self._others else None
        return Places(self._poses[-1][FLOOR_PLACE], others_m, self._lost_frames <= _REMEMBERED)

    def _has_jumped_to_others(self, pose: Floats) -> bool:
        """Whether a pose (D,) is that of somebody else, who is the only one left in view."""
        jump_m = np.linalg.norm((pose - self._poses[-1])[FLOOR_PLACE])
        return bool(jump_m > ELSEWHERE_M) and self._places.is_nearer_to_others(pose[FLOOR_PLACE])

    def _kept(self, solution: FrameSolution, picture: Picture, *, is_other: bool) -> FrameSolution:
        """What is known of a lost actor: the doubtful solution while it is near, else the last pose."""
        last = self._poses[-1]
        kept = nothing_sure(solution, last) if is_other else unless_far(solution, last, picture)
        self._poses = [*self._poses[-1:], kept.pose] if kept is solution else self._poses[-1:]
        return kept

    def _find_again(
        self, seen: TriPlanes, absent: Collection[int], settings: SearchSettings, *, at_once: bool
    ) -> FrameSolution | None:
        """A first pose of this frame if a whole person is visible; at_once: without the growing pauses."""
        if self._wait and not at_once:
            self._wait -= 1
            return None
        found = whole_person(self._model, seen, self._places)
        if found is None:
            self._wait = _PAUSE
            return None
        hull, alone = found
        picture, _ = self._model.without_cameras(alone, absent, settings)
        self._tries += 1
        self._wait = min(2**self._tries, _LONGEST_WAIT)
        first = find_first_pose(self._model, picture, hull, self._limbs, settings)
        return None if first.solution.is_lost else first.solution


def aligned_ahead(
    model: Model, settings: SearchSettings, frames: Iterable[tuple[_Frame, TriPlanes, Floats | None]]
) -> Iterator[tuple[_Frame, FrameSolution | None]]:
    """Frames, each with what `Tracker.solve` can be told as `aligned`; None without a known pose.

    frames: each with its silhouettes (P, H, W) and its known pose (D,). Some are aligned ahead, at the same
    time.
    """

    def aligned(
        copy: Model, one: tuple[_Frame, TriPlanes, Floats | None]
    ) -> tuple[_Frame, FrameSolution | None]:
        frame, seen, known = one
        if known is None:
            return frame, None
        alone = copy.picture_of(without_others(copy, seen, known))
        return frame, align_alone(copy, alone, known, settings)

    return model.copies.each(aligned, frames)


def is_far(solution: FrameSolution, picture: Picture) -> bool:
    """Whether a solution is not even near the silhouettes of a whole picture."""
    return solution.energy_px > _MOST_FOLLOWED * count_bits(picture.silhouettes & ~picture.ignored)


def unless_far(solution: FrameSolution, pose: Floats, picture: Picture) -> FrameSolution:
    """A doubtful solution, unless it is far from the silhouettes of a whole picture: then one with a known
    pose (D,), of which nothing is sure."""
    return nothing_sure(solution, pose) if is_far(solution, picture) else solution


def nothing_sure(solution: FrameSolution, pose: Floats) -> FrameSolution:
    """A solution with a known pose (D,) of which nothing is sure."""
    nothing = dict.fromkeys(PARTS, 0.0)
    return replace(solution, pose=pose.copy(), distrusted=list(PARTS), confidence=nothing)


def whole_person(model: Model, seen: TriPlanes, places: Places) -> tuple[Hull, TriPlanes] | None:
    """The visual hull of silhouettes (P, H, W) if one whole person of the model's height is to be seen, and
    the silhouettes of that person alone.

    Of two people, it is the actor by the last places of both, else nobody; nor is it one person who is nearer
    to where others were.
    """
    rig = model.rig
    masks, possible = unpack(seen.silhouettes, rig.n_cameras), unpack(seen.possible, rig.n_cameras)
    try:
        look = look_first(rig, masks, possible=possible, places=places)
        hull = carve(rig, look.believed(masks), look.possible)
    except TakeError:  # nobody, several people, or a person at the pictures' edges
        return None
    if look.two is not None and places.others_m is None:  # any of them may be the actor
        return None
    if look.two is None and places.is_nearer_to_others(hull.axis_world_m):
        return None
    return (hull, look.alone(seen)) if hull.suits(model.body.height_m) else None
