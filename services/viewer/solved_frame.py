"""A solved frame as pages show it."""

from dataclasses import dataclass, field

import numpy as np

from proto.messages import Pose
from services.mocap.take.marks import DISTRUSTED
from services.mocap.take.quantities import QUANTITIES, numbers_of
from services.mocap.types import Floats, Ints, Mask

ON_PAGE = tuple(row for row in QUANTITIES if row.labels and not row.is_live)
"""Quantities that a page may show; those of cameras are not among them."""
COLUMNS = [(row.name, label) for row in ON_PAGE for label in row.labels]
_COLUMNS_OF = {row.name: [k for k, (name, _) in enumerate(COLUMNS) if name == row.name] for row in ON_PAGE}


@dataclass(frozen=True, eq=False)
class SolvedFrame:
    """One solved frame."""

    frame: int
    time_s: float
    pose: Floats
    """(D,) in metres and radians, z-up world."""
    numbers: Floats
    """(K,) of each label of each quantity ON_PAGE, in their order; NaN where it is not known."""
    arrived_s: float = np.nan
    """When the viewer received it (time.monotonic); NaN for finished takes."""
    settled: bool = False
    """Whether it is final, found with the frames after it, and replaces an earlier solution."""
    iou: Floats = field(default_factory=lambda: np.zeros(0))
    """(C,) intersection over union of body and silhouette by camera; empty where it is not known."""

    def of(self, quantity: str) -> Floats:
        """A quantity's numbers (k,), one for each of its labels."""
        return self.numbers[_COLUMNS_OF[quantity]]

    @property
    def energy_px(self) -> float:
        """Differing pixels, over all cameras."""
        return float(self.of("energy_px")[0])

    @property
    def distrusted(self) -> Mask:
        """(6,) unreliable parts."""
        return self.of(DISTRUSTED) > 0


def solved_frame_of(message: Pose, arrived_s: float) -> SolvedFrame:
    """A frame as it was published."""
    return SolvedFrame(
        frame=message.frame,
        time_s=message.time_s,
        pose=message.pose,
        numbers=np.array([number for row in ON_PAGE for number in numbers_of(message, row, row.labels)]),
        arrived_s=arrived_s,
        settled=message.settled,
        iou=np.array(message.measured.get("iou", ()), np.float64),
    )


@dataclass(frozen=True, eq=False)
class Stretch:
    """Consecutive known frames (N), in increasing order, as arrays, for curves."""

    frames: Ints
    numbers: Floats
    """(N, K) as SolvedFrame has them."""
    poses: Floats
    """(N, D) as SolvedFrame has them."""

    def of(self, quantity: str) -> Floats:
        """A quantity (N, k), a column for each of its labels."""
        return self.numbers[:, _COLUMNS_OF[quantity]]
