"""What a recorder keeps of the coordinator's judgement of its own poses."""

from collections.abc import Sequence

import numpy as np

from proto.messages import Pose
from services.mocap.body.kinematics import N_DOF
from services.mocap.result.energies import Energies
from services.mocap.search.chains import HEAD, LIMBS
from services.mocap.take.marks import PARTS, Marks
from services.mocap.types import Mask

_DOFS: dict[str, tuple[int, ...]] = {"head": HEAD.dofs, **{name: limb.dofs for name, limb in LIMBS.items()}}
"""The parameters of each part but the torso, which carries all others."""


def marks_of(recorded: Sequence[Pose]) -> Marks:
    """The marks of some frames; parts that were not judged are neither sure nor distrusted."""
    confidence = [[message.confidence.get(part, np.nan) for part in PARTS] for message in recorded]
    distrusted: Mask = np.array(
        [[part in message.distrusted for part in PARTS] for message in recorded], bool
    )
    return Marks(np.array(confidence, np.float64), distrusted)


def energies_of(recorded: Sequence[Pose], cameras: Sequence[str]) -> Energies | None:
    """Where some frames differ from what the cameras saw; None where a coordinator has not counted all."""
    if any(len(message.part_px) < len(PARTS) or len(message.iou) != len(cameras) for message in recorded):
        return None
    return Energies(
        np.array([message.frame for message in recorded], np.int32),
        np.array([[message.part_px[part] for part in PARTS] for message in recorded], np.float64),
        cameras,
        np.array([message.iou for message in recorded]),
    )


def distrusted_values(marks: Marks) -> Mask:
    """Which values of the poses (N, 35) should not be trusted; where the torso is wrong, none should be."""
    values: Mask = np.zeros((len(marks.distrusted), N_DOF), bool)
    for part, frames in zip(PARTS, marks.distrusted.T, strict=True):
        dofs = list(_DOFS.get(part, range(N_DOF)))
        values[np.ix_(frames, dofs)] = True
    return values
