"""Solves a frame by its contours: aligns the whole body, then searches limbs near remaining differences."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from services.mocap.body.kinematics import N_DOF
from services.mocap.energy.backend import Energy
from services.mocap.energy.bitplanes import count_bits, count_by_camera
from services.mocap.energy.picture import Picture
from services.mocap.search.alignment.aligner import Aligned, SeenRim
from services.mocap.search.best_path import SAME_M, apart_m
from services.mocap.search.chains import ALL_SURFACES, HEAD, LIMBS
from services.mocap.search.descent import Solution
from services.mocap.search.error_by_part import error_by_part
from services.mocap.search.found import Clock, Differences, FrameSolution
from services.mocap.search.jobs import LimbPool, limb_jobs
from services.mocap.search.limb import promising_of_pair
from services.mocap.search.lost_probability import evidence_of
from services.mocap.search.model import Model
from services.mocap.search.part_confidence import confidences
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import descend_stage, whole_body_problem
from services.mocap.search.usual_differences import UsualDifferences, differences, inner, within_windows
from services.mocap.take.marks import LIMB_NAMES, LIMB_PAIRS, PARTS, Part
from services.mocap.types import Bytes, Floats

_SLACK = 0.05
"""Accept an alignment with up to this share more differing pixels than its start: contours locate edges to
sub-pixel precision, pixel counts cannot."""
_CLEARLY = 0.95
"""Pairs of limbs move only if less than this share of the energy is left: exchanged legs look much alike."""


_SURE = 0.99
"""A thorough search leaves out pairs of limbs with this confidence that do not differ: of 10,000 limbs with
more than 0.95, in 24 takes of people who are not the body model, none was lost."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """A pose with the pixels that the model covers, and its cost."""

    aligned: Aligned
    covered: Bytes
    prices_px: float
    """What limbs inside others and unusual poses cost, within the energy."""
    energy: float

    @property
    def pose(self) -> Floats:
        return self.aligned.pose


class _Search:
    """One frame's search; books what it takes in `found`."""

    def __init__(
        self, model: Model, whole: Picture, settings: SearchSettings, limbs: LimbPool, other: Floats | None
    ) -> None:
        self.model, self.whole, self.settings, self.limbs = model, whole, settings, limbs
        self._other = other
        self.found = FrameSolution(np.zeros(N_DOF), 0.0)
        self.clock = Clock(self.found.seconds)

    def see(self, aligned: Aligned) -> _Seen:
        """Draw a pose and compute its cost."""
        self.found.evaluations += 1
        covered = self.model.backend.coverage(
            aligned.pose[None], ALL_SURFACES, self.whole.region, self.settings.detail_px
        )[0]
        differing = (covered ^ self.whole.silhouettes) & ~self.whole.ignored
        if self.settings.camera_weights:
            n_cameras = self.model.rig.n_cameras
            energy_px = float(count_by_camera(differing, n_cameras) @ self.settings.cost.weights(n_cameras))
        else:
            energy_px = float(count_bits(differing))
        if self._wrong_px is not None:
            energy_px += self.settings.colour * float(self._wrong_px(aligned.pose[None])[0])
        aligner = self.model.aligner(self.settings)
        prices_px = float(aligner.prices_px(aligned.pose[None], self.settings)[0])
        return _Seen(aligned, covered, prices_px, energy_px + prices_px)

    @cached_property
    def _wrong_px(self) -> Energy | None:
        """How many pixels have a wrong colour class; None where colours do not count."""
        if not self.model.counts_colours(self.whole, self.settings.colour):
            return None
        return self.model.colours.wrong_px(whole_body_problem(self.whole, self.settings))

    def best_of(self, poses: Floats) -> _Seen:
        """The first of the cheapest poses (N, D)."""
        starts = (Aligned(pose.copy(), 0.0, SeenRim.nothing()) for pose in poses)
        return min(map(self.see, starts), key=lambda s: s.energy)

    def align(self, start: _Seen) -> _Seen:
        """Align from a pose; returns the pose itself, with the rim that was found, if alignment makes
        it worse."""
        aligner = self.model.aligner(self.settings)
        aligned = self.see(aligner.align(self.whole, start.pose, self.settings))
        self.found.evaluations += self.settings.contour_steps
        self.clock.book("torso")
        if aligned.energy <= start.energy + _SLACK * (start.energy - start.prices_px):
            return aligned
        return replace(start, aligned=replace(start.aligned, rim=aligned.aligned.rim))

    def differences(self, seen: _Seen) -> Differences:
        """The differences between a pose and the input; what limbs inside others cost is among them."""
        found = differences(self.model, self.whole, seen.pose, seen.covered)
        if self._wrong_px is not None:
            wrong = inner(self.model.colours.wrong(self.whole, seen.pose))
            for part, px in within_windows(wrong, self.model, seen.pose).items():
                found.px[part] += round(self.settings.colour * px)
        contact_px = self.model.aligner(self.settings).contact_px(seen.pose[None], self.settings)[0]
        for limb, px in zip(LIMB_NAMES, contact_px, strict=True):
            found.px[limb] += round(px)
            found.nearest_px[limb] += round(px)
        return found

    def without_agreed(self, parts: list[Part], best: _Seen) -> list[Part]:
        """Some parts without the limbs whose joints the other track has in the same place: it, or the run
        before it, has searched what differs there, or a thorough search will."""
        if self._other is None:
            return parts
        off_m = apart_m(best.pose, self._other, self.model.body.offsets_m)
        return [part for part in parts if part not in LIMBS or off_m[PARTS.index(part)] > SAME_M]

    def first_parts(
        self, best: _Seen, left: Differences, differing: list[Part], *, thorough: bool
    ) -> list[Part]:
        """The parts that the first round searches, by the settings; left: how the best pose differs."""
        if self.settings.search_limbs == "never":
            return []
        if self.settings.search_limbs == "always":
            return list[Part](LIMBS)
        if not thorough:
            return differing
        confidence = confidences(evidence_of(best.aligned.rim, left.nearest_px, best.pose), best.aligned.rim)
        unsure = {limb for limb in LIMBS if limb in differing or confidence.get(limb, 0.0) < _SURE}
        return [limb for pair in LIMB_PAIRS if unsure.intersection(pair) for limb in pair]

    def expecting(self, best: _Seen, expected: _Seen, parts: list[Part]) -> _Seen:
        """The best pose, with limbs in doubt where they were expected: alignments may lead them astray."""
        pose = best.pose.copy()
        dofs = [d for name, limb in LIMBS.items() if name in parts for d in limb.dofs]
        pose[dofs] = expected.pose[dofs]
        return self.best_of(pose[None])

    def round(self, start: _Seen, parts: list[Part], settings: SearchSettings) -> _Seen:
        """Search parts by XOR around a start, then align the whole body again.

        Where limbs are tried in typical poses, pairs of limbs are too: neither of two exchanged legs fits
        without the other, nor before the trunk turns.
        """
        self.found.passes += 1
        names = [name for name in LIMBS if name in parts]
        self.limbs.start(limb_jobs(self.model, self.whole, start.pose, settings, names))
        solutions = list[Solution]()
        if "head" in parts:
            head = HEAD.of(settings.body)
            solutions.append(descend_stage(self.model, head, self.whole, start.pose, settings))
            self.found.evaluations += solutions[0].evaluations
            self.clock.book("head")
        of_limbs = dict(self.limbs.finish())
        for name in names:
            solutions.append(of_limbs[name])
            self.found.note_limb(name, of_limbs[name])
        self.clock.book("limbs")
        best = self.align(self._one_by_one(start, solutions))
        if not settings.typical_limbs:
            return best
        rival = best
        for pair in LIMB_PAIRS:
            if set(pair) <= set(names):
                for pose in promising_of_pair(self.model, pair, self.whole, best.pose, settings):
                    rival = _better(rival, self.align(self.best_of(pose[None])))
        self.clock.book("limbs")
        return self.align(rival) if rival.energy < _CLEARLY * best.energy else best

    def _one_by_one(self, start: _Seen, solutions: list[Solution]) -> _Seen:
        """The start with the solutions that lower its energy, the best first, or with all of them.

        Each was found with everything else at the start, so two limbs may have found the same pixels.
        """
        alone = [self.best_of(one.applied_to(start.pose)[None]).energy for one in solutions]
        best, together = start, start.pose
        for k in np.argsort(alone, kind="stable"):
            best = _better(best, self.best_of(solutions[k].applied_to(best.pose)[None]))
            together = solutions[k].applied_to(together)
        return _better(best, self.best_of(together[None]))


def solve_by_contours(
    model: Model,
    whole: Picture,
    starts: Floats,
    settings: SearchSettings,
    limbs: LimbPool,
    trust: UsualDifferences,
    other: Floats | None = None,
    *,
    thorough: bool = False,
) -> FrameSolution:
    """Find the pose of one frame, beginning at the best of the start poses (N, D) within the limits.

    The whole body is aligned with the contours. Then limbs (and the head) that something differs near by more
    than the rim are searched by XOR, as in the paper's passes, and all is aligned again: what an alignment
    cannot do is to jump. A first round searches about the alignment; further rounds, as long as they help,
    farther about where the limbs were expected. other: the pose (D,) that another track has found for this
    frame; that limbs differ which are where it has them is no reason to search them. thorough: limbs are
    searched far, differing or not, and wherever the other track has them, unless both of a pair are sure.
    """
    search = _Search(model, whole, settings, limbs, other)
    expected = search.best_of(starts)
    best = search.align(expected)
    left, gained = search.differences(best), False
    farther = settings.widened().model_copy(update={"windows": False})
    differing = trust.to_search(left)
    if not thorough:
        differing = search.without_agreed(differing, best)
    parts = search.first_parts(best, left, differing, thorough=thorough)
    searched = set(parts) & set(differing)  # others that were searched in vain need no rest
    if parts:
        found = _better(best, search.round(best, parts, farther if thorough else settings))
        gained = _gains(found, best, settings)
        if gained:
            searched.update(parts)
        best, left = found, search.differences(found)
        for _ in range(1, settings.max_passes):
            parts = search.without_agreed(trust.to_search(left), best)
            if not parts:
                break
            searched.update(parts)
            begun = search.expecting(best, expected, parts)
            found = _better(best, search.round(begun, parts, farther))
            is_last = not _gains(found, best, settings)
            best, left, gained = found, search.differences(found), gained or not is_last
            if is_last:
                break
    trust.note_search(searched, gained=gained)
    solution = search.found
    solution.pose = best.pose
    solution.note_shares(error_by_part(model, whole, best.pose))
    solution.measured["prior"] = [float(best.aligned.anchor_cost)]
    solution.evaluations += 1
    solution.evidence = evidence_of(best.aligned.rim, left.nearest_px, best.pose)
    solution.confidence = confidences(solution.evidence, best.aligned.rim)
    solution.differences = left
    trust.judge(solution)
    search.clock.book("torso")
    return solution


def _better(one: _Seen, other: _Seen) -> _Seen:
    return min(one, other, key=lambda seen: seen.energy)


def _gains(found: _Seen, before: _Seen, settings: SearchSettings) -> bool:
    """Whether a round lowered the energy by enough to be worth another one."""
    return found.energy < (1.0 - settings.pass_tolerance) * before.energy
