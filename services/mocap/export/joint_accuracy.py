"""The figures of a comparison with a reference: joint errors and lost limbs."""

from dataclasses import dataclass

import numpy as np

from services.mocap.take.tables import REFERENCE_JOINTS
from services.mocap.types import Floats

LOST_LIMB_MM = 200.0
"""A joint farther than this from the reference counts as lost: the search fitted something else."""


@dataclass(frozen=True)
class JointErrors:
    """Distances between estimated and reference joint centres, in millimetres."""

    mean_by_joint_mm: dict[str, float]
    """Over all frames, by joint name, in the order of REFERENCE_JOINTS."""
    mean_mm: float
    """Over all frames and joints, as the median and the 95th percentile."""
    median_mm: float
    p95_mm: float
    lost_limbs: list[tuple[int, str]]
    """(row of the arrays, joint name) of every error above LOST_LIMB_MM, by row."""


def joint_errors(estimated_m: Floats, reference_m: Floats) -> JointErrors:
    """Compare two motions, both (N, 15, 3) in metres in one world, joints as REFERENCE_JOINTS, N >= 1.

    Raises ValueError on other shapes and on numbers that are not finite: a hole must not pass as an error
    of zero, nor vanish from a mean.
    """
    for name, joints_m in (("estimated_m", estimated_m), ("reference_m", reference_m)):
        if joints_m.ndim != 3 or len(joints_m) == 0 or joints_m.shape[1:] != (len(REFERENCE_JOINTS), 3):
            raise ValueError(f"{name}: expected shape (N, {len(REFERENCE_JOINTS)}, 3), got {joints_m.shape}")
        if not np.isfinite(joints_m).all():
            raise ValueError(f"{name}: expected finite numbers")
    if len(estimated_m) != len(reference_m):
        raise ValueError(f"estimated_m has {len(estimated_m)} frames, reference_m {len(reference_m)}")
    errors_mm = 1000.0 * np.linalg.norm(estimated_m - reference_m, axis=-1)
    return JointErrors(
        mean_by_joint_mm=dict(zip(REFERENCE_JOINTS, errors_mm.mean(axis=0).tolist(), strict=True)),
        mean_mm=float(errors_mm.mean()),
        median_mm=float(np.median(errors_mm)),
        p95_mm=float(np.percentile(errors_mm, 95)),
        lost_limbs=[(int(n), REFERENCE_JOINTS[j]) for n, j in np.argwhere(errors_mm > LOST_LIMB_MM)],
    )
