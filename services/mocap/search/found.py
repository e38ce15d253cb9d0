"""The solution of a frame, and the times of its stages."""

import time
from dataclasses import dataclass, field
from operator import attrgetter

import numpy as np

from services.mocap.search.descent import Solution
from services.mocap.search.error_by_part import ErrorByPart
from services.mocap.take.marks import PARTS, WHOLE_BODY, LimbName, Part
from services.mocap.types import Floats


@dataclass(frozen=True)
class Differences:
    """Pixels in which a pose differs from the input by more than the rim."""

    px: dict[Part, int]
    """Number of pixels over all cameras within each part's windows; for the torso, in whole pictures."""
    nearest_px: dict[Part, int]
    """Number of pixels nearest to each part."""
    share: float
    """All these pixels over the number of input pixels, including unsure ones that the model covers."""


@dataclass(eq=False)
class FrameSolution:
    """A frame's pose and the effort of finding it."""

    pose: Floats
    """(D,)"""
    energy_px: float
    """Differing pixels of the whole body's full mesh in the whole pictures, over all cameras, whatever was
    minimised."""
    passes: int = 0
    evaluations: int = 0
    """Evaluations of the energy; steps of an alignment count too, as each draws the whole body once. What
    limbs cost elsewhere does not count."""
    seconds: dict[str, float] = field(default_factory=lambda: {"torso": 0.0, "head": 0.0, "limbs": 0.0})
    """Wall time per stage; limbs: from the end of the head until the last limb's result. With contours, torso
    is the alignment of the whole body. Where frames are settled side by side, these are processor times, and
    limbs is that of trying them elsewhere."""
    limb_seconds: dict[str, float] = field(default_factory=dict)
    """Time to solve each limb, in the process that solved it, over all passes."""
    confidence: dict[Part, float] = field(default_factory=dict)
    """The probability that no joint of a part is more than 15 cm off, if it was computed."""
    evidence: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """(6, n) what it was computed from (lost_probability)."""
    differences: Differences | None = None
    """None for the paper's search."""
    distrusted: list[Part] = field(default_factory=list)
    """Parts whose pose is probably wrong; the torso stands for the whole body."""
    measured: dict[str, list[float]] = field(default_factory=lambda: {"prior": [0.0]})
    """What is only reported, by the name of its row in services.mocap.take.quantities: part_px and iou (see
    ErrorByPart), prior: the cost of the distance from the predicted pose and the rest pose."""

    @property
    def is_lost(self) -> bool:
        """Whether the whole body is doubtful."""
        return WHOLE_BODY in self.distrusted

    def note_limb(self, name: LimbName, solution: Solution) -> None:
        """Note a limb's effort."""
        self.evaluations += solution.evaluations
        self.limb_seconds[name] = self.limb_seconds.get(name, 0.0) + solution.seconds

    def note_shares(self, shares: ErrorByPart) -> None:
        """Note the differences between the pose and the input: plain XOR, whatever was minimised."""
        self.energy_px = float(shares.energy_px)
        self.measured["part_px"] = [float(shares.part_px[part]) for part in PARTS]
        self.measured["iou"] = shares.iou


BY_ENERGY = attrgetter("energy_px")
"""The key that orders solutions, the best one first."""


class Clock:
    """Adds the time since the last call to a stage."""

    def __init__(self, seconds: dict[str, float]) -> None:
        self._seconds, self._last = seconds, time.perf_counter()

    def book(self, stage: str) -> None:
        """Add the time since the last call to a stage."""
        now = time.perf_counter()
        self._seconds[stage] = self._seconds.get(stage, 0.0) + now - self._last
        self._last = now
