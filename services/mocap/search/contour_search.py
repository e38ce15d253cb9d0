"""A frame by its contours: the whole body aligned at once, limbs searched where something is left over."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from services.mocap.body.kinematics import N_DOF
from services.mocap.energy.bitplanes import count_bits
from services.mocap.energy.cost import Cost
from services.mocap.energy.picture import Picture
from services.mocap.search.alignment.aligner import Aligned
from services.mocap.search.alignment.pulls import SHARES
from services.mocap.search.chains import ALL_SEGMENTS, LIMBS
from services.mocap.search.error_by_part import error_by_part
from services.mocap.search.found import Clock, FrameSolution
from services.mocap.search.jobs import LimbPool, limb_jobs
from services.mocap.search.model import Model
from services.mocap.search.part_confidence import Differences, PartConfidence, confidences, differences
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import solve_head, whole_body_energy
from services.mocap.take.marks import Part
from services.mocap.types import Bytes, Floats

_SLACK = 1.05
"""An alignment may end at more XOR by this factor: contours tell places between pixels, counts do not."""


_LIMBS: list[Part] = list(LIMBS)


@dataclass(frozen=True, eq=False)
class _Seen:
    """A pose, what the model covers in it, and what that costs."""

    aligned: Aligned
    covered: Bytes
    energy: float

    @property
    def pose(self) -> Floats:
        return self.aligned.pose


class _Search:
    """One frame's search; counts its evaluations."""

    def __init__(self, model: Model, whole: Picture, settings: SearchSettings) -> None:
        self.model, self.whole, self.settings = model, whole, settings
        self.evaluations = 0

    def see(self, aligned: Aligned) -> _Seen:
        """Draw a pose and count what differs."""
        self.evaluations += 1
        covered = self.model.backend.coverage(
            aligned.pose[None], ALL_SEGMENTS, self.whole.region, self.settings.detail_px
        )[0]
        return _Seen(aligned, covered, self._cost(aligned.pose, covered))

    def _cost(self, pose: Floats, covered: Bytes) -> float:
        if self.settings.cost == Cost():
            return float(count_bits((covered ^ self.whole.silhouettes) & ~self.whole.ignored))
        return float(self._priced(pose[None])[0])

    @cached_property
    def _priced(self) -> Callable[[Floats], Floats]:
        s = self.settings
        return whole_body_energy(self.model, self.whole, np.zeros(N_DOF), s.cost, s.detail_px)

    def best_of(self, poses: Floats) -> _Seen:
        """The first of the cheapest poses (N, D)."""
        nothing = np.zeros((len(ALL_SEGMENTS), SHARES))
        return min((self.see(Aligned(pose.copy(), 0.0, nothing)) for pose in poses), key=lambda s: s.energy)

    def align(self, start: _Seen) -> _Seen:
        """Align from a pose; where that leads astray, the pose itself."""
        aligner = self.model.aligner(self.settings)
        found = self.see(aligner.align(self.whole, start.pose, self.settings))
        self.evaluations += self.settings.contour_steps
        return found if found.energy <= _SLACK * start.energy else start

    def differences(self, seen: _Seen) -> Differences:
        """What a pose leaves unexplained."""
        return differences(self.model, self.whole, seen.pose, seen.covered)


def solve_by_contours(
    model: Model,
    whole: Picture,
    starts: Floats,
    settings: SearchSettings,
    limbs: LimbPool,
    trust: PartConfidence,
) -> FrameSolution:
    """Find the pose of one frame, beginning at the best of the start poses (N, D) within the limits.

    The whole body is aligned with the contours. Then, as long as it helps, limbs (and the head) that
    something differs near by more than the rim are searched by XOR, as in the paper's passes, and all is
    aligned again: what an alignment cannot do is to jump.
    """
    search = _Search(model, settings.cost.priced(whole), settings)
    found = FrameSolution(starts[0], 0.0)
    clock = Clock(found.seconds)
    expected = search.best_of(starts)
    best = search.align(expected)
    clock.book("torso")
    left, searched, gained = search.differences(best), set[Part](), False
    for k in range(settings.max_passes):
        doubtful = trust.to_search(left) if k or settings.search_limbs == "in doubt" else _LIMBS
        if not doubtful:
            break
        found.passes, before = found.passes + 1, best
        begun = _as_expected(search, best, expected, doubtful) if k else best
        wider = settings.widened() if k else settings
        other = _search_parts(search, begun, doubtful, wider, limbs, found, clock)
        best = min(before, other, key=lambda seen: seen.energy)
        left = search.differences(best)
        searched.update(doubtful)
        gained |= (better := best.energy < (1.0 - settings.pass_tolerance) * before.energy)
        if k and not better:
            break
    trust.note_search(searched, gained=gained)
    shares = error_by_part(model, whole, best.pose)
    found.pose, found.energy_px = best.pose, float(shares.energy_px)
    found.note_shares(shares)
    found.measured["prior"] = [float(best.aligned.prior_cost)]
    found.evaluations += search.evaluations + 1
    found.confidence, found.distrusted = confidences(best.aligned.rim_px), trust.distrusted(left)
    trust.remember(left)
    clock.book("torso")
    return found


def _as_expected(search: _Search, best: _Seen, expected: _Seen, parts: list[Part]) -> _Seen:
    """The best pose with limbs in doubt where they were expected: an alignment may have led them astray."""
    pose = best.pose.copy()
    for name in LIMBS:
        if name in parts:
            pose[list(LIMBS[name].dofs)] = expected.pose[list(LIMBS[name].dofs)]
    return search.best_of(pose[None])


def _search_parts(
    search: _Search,
    start: _Seen,
    parts: list[Part],
    settings: SearchSettings,
    limbs: LimbPool,
    found: FrameSolution,
    clock: Clock,
) -> _Seen:
    """Search parts by XOR about a start, then align the whole body again."""
    names = [name for name in LIMBS if name in parts]
    limbs.start(limb_jobs(search.model, search.whole, start.pose, settings, names))
    pose = start.pose
    if "head" in parts:
        head = solve_head(search.model, search.whole, pose, settings)
        pose, found.evaluations = head.applied_to(pose), found.evaluations + head.evaluations
        clock.book("head")
    for name, limb in limbs.finish():
        pose = limb.applied_to(pose)
        found.note_limb(name, limb)
    clock.book("limbs")
    searched = search.best_of(np.stack([start.pose, pose]))
    aligned = search.align(searched)
    clock.book("torso")
    return aligned
