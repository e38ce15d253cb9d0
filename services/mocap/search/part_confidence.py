"""The confidence in limbs and head: by evidence, by the track nearly chosen, by the frames around."""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from services.mocap.search.alignment.aligner import SeenRim
from services.mocap.search.alignment.matching import KNOWN, UNSURE
from services.mocap.search.best_path import Chosen
from services.mocap.search.error_by_part import PART_STAGES
from services.mocap.search.found import FrameSolution
from services.mocap.search.lost_probability import (
    JUDGED_SEGMENTS,
    frames_around,
    lost_in_time,
    lost_probabilities,
    rival_probabilities,
)
from services.mocap.take.marks import LIMB_NAMES, PARTS, Part
from services.mocap.types import Floats

LEAST_CONFIDENCE = 0.95
"""A limb or the head with a lower confidence is marked."""


def confidences(evidence: Floats, rim: SeenRim) -> dict[Part, float]:
    """Per part the probability that it is not lost; evidence (6, len(EVIDENCE)).

    A part is left out if unsure pixels hide most of the outline that it is judged by.
    """
    shown = {part: rim.lengths_px[segments].sum(axis=0) for part, segments in JUDGED_SEGMENTS.items()}
    return {
        part: 1.0 - float(lost)
        for part, lost in zip(PARTS, lost_probabilities(evidence), strict=True)
        if shown[part][KNOWN] >= shown[part][UNSURE]
    }


def doubtful(parts: Iterable[Part], confidence: Mapping[Part, float]) -> list[Part]:
    """Those of some parts whose confidence is too low."""
    return [part for part in parts if confidence.get(part, 1.0) < LEAST_CONFIDENCE]


def doubt_rivals(solution: FrameSolution, chosen: Chosen) -> None:
    """Lower the confidence in limbs and head by the probability that each is where the other track has it,
    and mark what is then too low."""
    lost = rival_probabilities(chosen.apart_m, chosen.margin_px)
    for part, probability in zip(PARTS, lost, strict=True):
        if part in PART_STAGES and part in solution.confidence:
            solution.confidence[part] *= 1.0 - float(probability)
            if solution.confidence[part] < LEAST_CONFIDENCE and part not in solution.distrusted:
                solution.distrusted.append(part)


class SteadyConfidence:
    """Confidence in limbs in view of the frames before and after, for solutions in their order."""

    def __init__(self, fps: float) -> None:
        self._fps, self._lost, self._waiting = fps, list[Floats](), deque[FrameSolution]()

    def add(self, solution: FrameSolution) -> Iterator[tuple[int, FrameSolution]]:
        """Add the next solution; yields the one that is then finished, if any, with its number from 0."""
        self._lost.append(1.0 - np.array([solution.confidence.get(limb, np.nan) for limb in LIMB_NAMES]))
        self._waiting.append(solution)
        if len(self._waiting) > frames_around(self._fps):
            yield self._finished()

    def rest(self) -> Iterator[tuple[int, FrameSolution]]:
        """The same of those that have waited for further frames."""
        while self._waiting:
            yield self._finished()

    def _finished(self) -> tuple[int, FrameSolution]:
        number = len(self._lost) - len(self._waiting)
        solution, first = self._waiting.popleft(), max(number - frames_around(self._fps), 0)
        lost = lost_in_time(np.array(self._lost[first:]), number - first, self._fps)
        if not solution.is_lost:
            for limb, probability in zip(LIMB_NAMES, lost.tolist(), strict=True):
                if limb in solution.confidence:
                    solution.confidence[limb] = 1.0 - probability
            others = [part for part in solution.distrusted if part not in LIMB_NAMES]
            solution.distrusted = [*others, *doubtful(LIMB_NAMES, solution.confidence)]
        return number, solution
