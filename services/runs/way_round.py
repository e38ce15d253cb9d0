"""Which way round the actor is, where silhouettes of the first frame do not tell front from back.

A fit tries both ways by the first frames. After a first run, frames of the whole take tell it once more.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.picture import Picture
from services.mocap.fit.fitting import Fit
from services.mocap.sampling import evenly
from services.mocap.search.first_frame import tell_facing
from services.mocap.search.first_pose import FirstPose, turned_round
from services.mocap.search.found import BY_ENERGY, FrameSolution
from services.mocap.search.frame import solve_frame
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import Model, model_on_cpu
from services.mocap.search.settings import SearchSettings
from services.mocap.search.tracker import Tracker
from services.mocap.types import Floats

MOTION_FRAMES = 60
"""Frames after those of a fit that are tracked both ways round if the fits are about as good."""
_RIVAL = 1.2
"""A body is fitted to the opposite first pose too if that has at most this many times the energy."""
_UNTOLD = 1.1
"""Fits are about as good if their energies differ by less than this factor."""
_TRIED = 5
"""Frames of a run in which the body is turned round."""
_PERHAPS = 1.8
"""Poses that are only aligned once they are turned round have at least 2.2 times the energy where the run
faced the right way (eleven takes), and 1.3 times where it did not."""


@dataclass(frozen=True, eq=False)
class Way:
    """A first pose (D,), and the fit that began with it."""

    pose: Floats
    fit: Fit

    @property
    def energy_px(self) -> float:
        """Of the fit's frames together."""
        return float(self.fit.after.energy_px.sum())


def fit_best_way_round(
    first: FirstPose,
    fit: Callable[[Floats, Callable[[float], None]], Fit],
    motion_px: Callable[[Fit], float],
    progress: Callable[[float], None],
) -> Way:
    """Fit from a first pose, and from the opposite one if that fits about as well; return the better one.

    A fitted body and several frames tell front from back better than a generic body does in one frame, and
    motion tells it better than standing. fit takes a pose (D,) and a function for its progress, 0 to 1;
    motion_px gives the energy of tracking on from a fit.
    """
    pose, opposite = first.solution.pose, first.opposite
    if opposite is None or opposite.energy_px > _RIVAL * first.solution.energy_px:
        tell_facing(first)
        return Way(pose, fit(pose, progress))
    ways = [
        Way(pose, fit(pose, lambda share: progress(0.5 * share))),
        Way(opposite.pose, fit(opposite.pose, lambda share: progress(0.5 + 0.5 * share))),
    ]
    ways.sort(key=BY_ENERGY)
    px = [way.energy_px for way in ways]
    if px[1] < _UNTOLD * px[0]:
        px = [motion_px(way.fit) for way in ways]
        if px[1] < px[0]:
            px, ways = px[::-1], ways[::-1]
    tell_facing(FirstPose(*(FrameSolution(way.pose, energy) for way, energy in zip(ways, px, strict=True))))
    return ways[0]


def tracked_px(rig: Rig, seen: Sequence[TriPlanes], fit: Fit, search: SearchSettings) -> float:
    """The energy of frames `seen`, each (P, H, W), tracked in this process from the last poses of a fit."""
    with model_on_cpu(fit.actor, rig) as model:
        tracker = Tracker(model, search, LocalLimbs(model), fit.poses[-2:])
        return sum((tracker.solve(planes).energy_px for planes in seen), fit.after.energy_px.sum())


def turned_poses(model: Model, seen: TriPlanes, poses: Floats, search: SearchSettings) -> Floats:
    """Poses (F, D) of a body that faces the other way, searched in frames `seen` (F, P, H, W)."""
    found = (solved(model, seen[k], turned_round(pose), search) for k, pose in enumerate(poses))
    return np.array([solution.pose for solution in found])


def faces_other_way(model: Model, seen: TriPlanes, poses: Floats, search: SearchSettings) -> bool:
    """Whether a body that faces the other way fits frames `seen` (F, P, H, W) better than the poses (F, D) of
    a run do: some of them, evenly spread, taken together.

    In eleven right runs, the turned body had at least 1.5 times the energy; in a wrong one, 0.8 times.
    """
    some, aligned = evenly(len(poses), _TRIED), search.aligned_only()

    def sum_px(starts: Iterable[Floats], settings: SearchSettings) -> float:
        return sum(
            solved(model, seen[k], start, settings).energy_px for k, start in zip(some, starts, strict=True)
        )

    given, turned = poses[some], [turned_round(pose) for pose in poses[some]]
    given_px = sum_px(given, aligned)
    return sum_px(turned, aligned) < _PERHAPS * given_px and sum_px(turned, search) < given_px


def solved(model: Model, seen: TriPlanes, start: Floats, settings: SearchSettings) -> FrameSolution:
    """What a frame's search in this process finds from a pose (D,); seen (P, H, W)."""
    picture = Picture.of_frame(model.rig, seen)
    return solve_frame(model, picture, start[None], settings, LocalLimbs(model))
