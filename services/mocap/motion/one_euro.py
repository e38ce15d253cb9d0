"""The one-euro filter for poses (Casiez, Roussel, Vogel 2012): smooth at rest, with little delay for fast
motion.

It needs only past poses, so it is suitable for live output. It is an exponential average whose cutoff
frequency rises with speed: jitter at rest is averaged over a long time, fast motion hardly at all.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.body.kinematics import clip_to_limits
from services.mocap.body.skeleton import DOFS
from services.mocap.motion.root import ROOT_TURN, root_angles, root_rotations
from services.mocap.motion.settings import CUTOFFS_HZ
from services.mocap.types import Floats

SPEED_CUTOFF_HZ = 10.0
"""By how much the cutoff rises per radian a second; chosen on tracked takes by their joint errors."""
_DERIVATIVE_CUTOFF_HZ = 1.0
_METRES_PER_RADIAN = 0.5
"""Distance that converts a shift of the root to an equivalent rotation, about an arm's length."""
_SPEED_UNIT: Floats = np.array([_METRES_PER_RADIAN if dof.unit == "m" else 1.0 for dof in DOFS])


class OneEuro:
    """Filters one pose after the other."""

    def __init__(
        self, rest_cutoff_hz: float = CUTOFFS_HZ["one-euro"], speed_cutoff_hz: float = SPEED_CUTOFF_HZ
    ) -> None:
        self._rest_hz, self._per_speed_hz = rest_cutoff_hz, speed_cutoff_hz
        self._before: tuple[float, Floats, Floats] | None = None
        """Time, the filtered pose (D,) and its filtered velocity (D,), with the root's turn as a vector."""

    def __call__(self, pose: Floats, at_s: float) -> Floats:
        """The next pose (D,), filtered; raises ValueError unless it is later than the one before."""
        if self._before is None:
            self._before = at_s, pose.copy(), np.zeros(len(pose))
            return pose.copy()
        then_s, last, velocity = self._before
        if at_s <= then_s:
            raise ValueError(f"a pose at {at_s} s after one at {then_s} s")
        step_s = at_s - then_s
        change = pose - last
        turn_last = root_rotations(last[None])
        change[ROOT_TURN] = (turn_last.inv() * root_rotations(pose[None])).as_rotvec()[0]
        velocity = velocity + _weight(_DERIVATIVE_CUTOFF_HZ, step_s) * (change / step_s - velocity)
        speed = np.abs(velocity) / _SPEED_UNIT
        speed[ROOT_TURN] = np.linalg.norm(velocity[ROOT_TURN])
        step = _weight(self._rest_hz + self._per_speed_hz * speed, step_s) * change
        result = last + step
        turned = turn_last * Rotation.from_rotvec(step[ROOT_TURN][None])
        result[ROOT_TURN] = root_angles(turned, near=pose[ROOT_TURN][None])[0]
        result = clip_to_limits(result)
        self._before = at_s, result, velocity
        return result.copy()


def _weight(cutoff_hz: float | Floats, step_s: float) -> float | Floats:
    """The weight of the new value in an exponential average with that cutoff frequency."""
    return 1.0 / (1.0 + 1.0 / (2.0 * np.pi * cutoff_hz * step_s))
