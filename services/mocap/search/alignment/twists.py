"""The twist of every parameter in the world: how points of the body move when it changes."""

import numba
import numpy as np

from services.mocap.body.kinematics import (
    DOF_AXIS,
    DOF_RANGE,
    DOF_ROLE,
    N_JOINTS,
    PARENT,
    SHIFT,
    SWING,
    copy_rotation,
    multiply,
    rotation_of,
    swing_of,
)
from services.mocap.body.skeleton import DOFS, JOINT_INDEX
from services.mocap.types import Floats, Mask

TWIST_SIZE = 6
"""Angular velocity, then the velocity of the point at the world's origin."""


@numba.njit(cache=True, nogil=True)
def place_twists(pose: Floats, T_world_joint: Floats, twists: Floats) -> None:
    """Write every parameter's twist into twists (D, 6).

    pose (D,) and the transforms (J, 4, 4) that place_frames made of it. A point X of a segment that the
    parameter d moves has the velocity a x X + b for twists[d] = (a, b), in metres (per metre or radian).
    """
    R, turn, product = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    swing, axis = np.empty(3), np.empty(3)
    for j in range(N_JOINTS):
        first, last = DOF_RANGE[j]
        if first == last:
            continue
        if PARENT[j] < 0:
            rotation_of(0.0, 0.0, 0.0, R)
        else:
            copy_rotation(T_world_joint[PARENT[j]], R)
        origin = T_world_joint[j, :3, 3]
        swing_of(pose, j, swing)
        for d in range(first, last):
            if DOF_ROLE[d] == SHIFT:
                twists[d, :3] = 0.0
                twists[d, 3], twists[d, 4], twists[d, 5] = DOF_AXIS[d]
            elif DOF_ROLE[d] == SWING:
                _swing_axis(swing, DOF_AXIS[d], axis)
                _write(R, axis, origin, twists[d])
        rotation_of(swing[0], swing[1], swing[2], turn)
        multiply(R, turn, product)
        for d in range(first, last):
            if DOF_ROLE[d] != SHIFT and DOF_ROLE[d] != SWING:
                _write(product, DOF_AXIS[d], origin, twists[d])
                x, y, z = DOF_AXIS[d]
                rotation_of(pose[d] * x, pose[d] * y, pose[d] * z, turn)
                copy_rotation(product, R)
                multiply(R, turn, product)


@numba.njit(cache=True, nogil=True)
def _swing_axis(swing: Floats, axis: Floats, out: Floats) -> None:
    """The axis of rotation when a swing's component along `axis` grows: J(swing) axis.

    J is the left Jacobian of the rotations (Barfoot, State Estimation for Robotics, 2017, section 7.1.5).
    """
    angle = np.sqrt(swing[0] ** 2 + swing[1] ** 2 + swing[2] ** 2)
    if angle < 1e-6:
        a, b = 0.5, 1.0 / 6.0
    else:
        a, b = (1.0 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    once, twice = np.empty(3), np.empty(3)
    cross(swing, axis, once)
    cross(swing, once, twice)
    for i in range(3):
        out[i] = axis[i] + a * once[i] + b * twice[i]


@numba.njit(cache=True, nogil=True)
def _write(R: Floats, axis: Floats, origin_world_m: Floats, twist: Floats) -> None:
    for i in range(3):
        twist[i] = R[i, 0] * axis[0] + R[i, 1] * axis[1] + R[i, 2] * axis[2]
    cross(origin_world_m, twist[:3], twist[3:])


@numba.njit(cache=True, nogil=True)
def cross(a: Floats, b: Floats, out: Floats) -> None:
    """Write the vector product of a and b (3,) into out, which is neither of them."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = a[j] * b[k] - a[k] * b[j]


def _moved_by() -> Mask:
    moved = np.eye(N_JOINTS, dtype=np.bool_)
    for j in range(N_JOINTS):  # parents precede children
        if PARENT[j] >= 0:
            moved[:, j] |= moved[:, PARENT[j]]
    return moved


MOVED_BY = _moved_by()
"""(J, J): whether a rotation of the first joint moves the second (or is itself)."""
DOF_JOINT = np.array([JOINT_INDEX[dof.joint] for dof in DOFS], np.int32)
"""(D,) the joint that each parameter turns or shifts."""
