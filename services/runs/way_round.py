"""Which way round the actor is, where silhouettes of the first frame do not tell front from back."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.fit.fitting import Fit
from services.mocap.search.first_frame import tell_facing
from services.mocap.search.first_pose import FirstPose
from services.mocap.search.found import FrameSolution
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import model_on_cpu
from services.mocap.search.settings import SearchSettings
from services.mocap.search.tracker import Tracker
from services.mocap.types import Floats

MOTION_FRAMES = 60
"""Frames after those of a fit that are tracked both ways round if the fits are about as good."""
_RIVAL = 1.2
"""A body is fitted to the opposite first pose too if that has at most this many times the energy."""
_UNTOLD = 1.1
"""Fits are about as good if their energies differ by less than this factor."""


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
    ways.sort(key=lambda way: way.energy_px)
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
