"""Two limbs at once: what is promising, and that exchanged legs find their way back."""

from collections.abc import Callable

import numpy as np

from services.mocap.body.kinematics import joint_positions
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import LIMBS
from services.mocap.search.frame import solve_frame
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.limb import promising_of_pair
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.take.marks import LIMB_PAIRS
from services.mocap.types import Floats

LEGS = LIMB_PAIRS[1]
LEFT, RIGHT = (list(LIMBS[name].dofs) for name in LEGS)


def exchanged(pose: Floats) -> Floats:
    """The pose (D,) with the left leg as the right one, and the right as the left."""
    other = pose.copy()
    other[LEFT + RIGHT] = pose[RIGHT + LEFT]
    return other


def test_the_exchanged_legs_come_first_and_all_are_apart(
    model: Model, standing: Callable[..., Floats], picture_of: Callable[[Floats], Picture]
) -> None:
    pose = standing(left_hip_flexion=35, right_hip_flexion=-20, right_knee_flexion=30)
    others = promising_of_pair(model, LEGS, picture_of(pose), pose, SearchSettings())
    np.testing.assert_array_equal(others[0], exchanged(pose))
    joints_m = joint_positions(np.vstack([pose[None], others]), model.body.offsets_m)
    off_m = np.linalg.norm(joints_m[:, None] - joints_m, axis=-1).max(axis=-1)
    assert off_m[~np.eye(len(off_m), dtype=bool)].min() > 0.15
    still = [d for d in range(len(pose)) if d not in LEFT + RIGHT]
    np.testing.assert_array_equal(others[:, still], np.tile(pose[still], (len(others), 1)))


def test_exchanged_legs_find_their_way_back(
    model: Model,
    standing: Callable[..., Floats],
    picture_of: Callable[[Floats], Picture],
    joint_errors_mm: Callable[[Floats, Floats], Floats],
) -> None:
    truth = standing(
        shoulder_elevation=-60, left_hip_flexion=40, right_hip_flexion=-25, right_knee_flexion=50
    )
    start = exchanged(truth)
    assert joint_errors_mm(start, truth).max() > 400
    found = solve_frame(model, picture_of(truth), start[None], SearchSettings(), LocalLimbs(model))
    assert joint_errors_mm(found.pose, truth).max() < 40
