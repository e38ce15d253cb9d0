"""Forward kinematics of a batch, from values to the drawn segments' transforms, in one compiled call."""

import numba
import numpy as np

from services.mocap.body.kinematics import (
    N_DOF,
    SEGMENT_JOINTS,
    joint_transforms,
    moving_joints,
    place_joints,
)
from services.mocap.types import Floats, Ints

ALL_DOFS = tuple(range(N_DOF))


class Posing:
    """How the drawn segments follow from the parameters that vary; the other joints stay where they are."""

    def __init__(
        self, base_pose: Floats, dofs: tuple[int, ...], segments: tuple[int, ...], offsets_m: Floats
    ) -> None:
        self._dofs = np.array(dofs, np.int32)
        self._moving = moving_joints(dofs, segments)
        self._carriers = SEGMENT_JOINTS[list(segments)]
        self._offsets_m = offsets_m
        self._pose = np.array(base_pose, np.float64)
        self._T_world_joint = joint_transforms(self._pose[None], offsets_m)[0]

    def transforms(self, values: Floats) -> Floats:
        """T_world_segment (N, S, 3, 4), the rows that are not constant, of values (N, d)."""
        T_world_segment = np.empty((len(values), len(self._carriers), 3, 4))
        _pose_all(
            np.array(values, np.float64, order="C"), self._dofs, self._moving, self._carriers,
            self._offsets_m, self._pose, self._T_world_joint, T_world_segment,
        )  # fmt: skip
        return T_world_segment


@numba.njit(cache=True, nogil=True)
def _pose_all(
    values: Floats,
    dofs: Ints,
    moving: Ints,
    carriers: Ints,
    offsets_m: Floats,
    pose: Floats,
    T_world_joint: Floats,
    T_world_segment: Floats,
) -> None:
    for n in range(len(values)):
        for k in range(len(dofs)):
            pose[dofs[k]] = values[n, k]
        place_joints(pose, offsets_m, moving, T_world_joint)
        for s in range(len(carriers)):
            T_world_segment[n, s] = T_world_joint[carriers[s], :3]
