"""Forward kinematics for batches of poses."""

import numba
import numpy as np

from services.mocap.body.skeleton import (
    DOFS,
    JOINT_INDEX,
    JOINTS,
    LOWER,
    SEGMENT_JOINT,
    UPPER,
)
from services.mocap.types import Floats, Ints

N_DOF = len(DOFS)
_N_JOINTS = len(JOINTS)
_ROLES = {"translation": 0, "heading": 1, "lean": 1, "pitch": 1, "swing": 2, "twist": 3}

_PARENT: Ints = np.array([-1 if j.parent is None else JOINT_INDEX[j.parent] for j in JOINTS], np.int32)
_DOF_JOINT: Ints = np.array([JOINT_INDEX[dof.joint] for dof in DOFS], np.int32)
_DOF_ROLE: Ints = np.array([_ROLES[dof.role] for dof in DOFS], np.int32)
_DOF_AXIS: Floats = np.array([dof.axis for dof in DOFS])
_SEGMENT_JOINT: Ints = np.array([JOINT_INDEX[j] for j in SEGMENT_JOINT.values()], np.int32)


def clip_to_limits(poses: Floats) -> Floats:
    """(…, 35) poses moved to the nearest ones within the joint limits."""
    return np.clip(poses, LOWER, UPPER)


def joint_transforms(poses: Floats, offsets_m: Floats) -> Floats:
    """World transforms of all joints.

    poses: (N, 35) in metres and radians. offsets_m: (17, 3), each joint relative to its parent in the rest
    pose. Returns T_world_joint (N, 17, 4, 4).
    """
    # A copy: to Numba an array that cannot be written to, as in a message, is another type to compile for.
    poses = np.array(poses, np.float64, order="C")
    if poses.ndim != 2 or poses.shape[1] != N_DOF:
        raise ValueError(f"poses: expected shape (N, {N_DOF}), got {poses.shape}")
    T_world_joint = np.empty((len(poses), _N_JOINTS, 4, 4))
    _joint_transforms(poses, offsets_m, _PARENT, _DOF_JOINT, _DOF_ROLE, _DOF_AXIS, T_world_joint)
    return T_world_joint


def segment_transforms(poses: Floats, offsets_m: Floats) -> Floats:
    """World transforms of all segments: T_world_segment (N, 16, 4, 4); arguments as joint_transforms."""
    return joint_transforms(poses, offsets_m)[:, _SEGMENT_JOINT]


def joint_positions(poses: Floats, offsets_m: Floats) -> Floats:
    """Joint centres joints_world_m (N, 17, 3); arguments as joint_transforms."""
    return joint_transforms(poses, offsets_m)[:, :, :3, 3]


@numba.njit(cache=True, nogil=True)
def _rotation(vector: Floats, R: Floats) -> None:
    """Rodrigues' formula: R (3, 3) of a rotation vector."""
    x, y, z = vector
    angle = np.sqrt(x * x + y * y + z * z)
    if angle < 1e-9:
        a, b = 1.0, 0.5
    else:
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / (angle * angle)
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
    R[1, 0], R[1, 1], R[1, 2] = b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x
    R[2, 0], R[2, 1], R[2, 2] = b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)


@numba.njit(cache=True, nogil=True)
def _multiply(A: Floats, B: Floats, out: Floats) -> None:
    """Write A @ B into out, all (3, 3), none the same."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@numba.njit(cache=True, nogil=True)
def _local_rotations(
    pose: Floats, dof_joint: Ints, dof_role: Ints, dof_axis: Floats, swing: Floats, R_local: Floats
) -> None:
    """Each joint's rotation against its parent, R_local (17, 3, 3); swing (17, 3) is scratch."""
    turn, product = np.empty((3, 3)), np.empty((3, 3))
    swing[:] = 0.0
    for d in range(pose.size):
        if dof_role[d] == 2:
            swing[dof_joint[d]] += pose[d] * dof_axis[d]
    for j in range(len(swing)):
        _rotation(swing[j], R_local[j])
    for d in range(pose.size):
        if dof_role[d] == 1 or dof_role[d] == 3:
            _rotation(pose[d] * dof_axis[d], turn)
            _multiply(R_local[dof_joint[d]], turn, product)
            R_local[dof_joint[d]] = product


@numba.njit(cache=True, nogil=True)
def _joint_transforms(
    poses: Floats,
    offsets_m: Floats,
    parent: Ints,
    dof_joint: Ints,
    dof_role: Ints,
    dof_axis: Floats,
    T_world_joint: Floats,
) -> None:
    n_joints = len(offsets_m)
    R_local, swing = np.empty((n_joints, 3, 3)), np.empty((n_joints, 3))
    for n in range(len(poses)):
        _local_rotations(poses[n], dof_joint, dof_role, dof_axis, swing, R_local)
        for j in range(n_joints):
            T = T_world_joint[n, j]
            T[3, 0], T[3, 1], T[3, 2], T[3, 3] = 0.0, 0.0, 0.0, 1.0
            if parent[j] < 0:
                T[:3, :3] = R_local[j]
                for i in range(3):
                    T[i, 3] = offsets_m[j, i] + poses[n, i]
                continue
            T_parent = T_world_joint[n, parent[j]]
            _multiply(T_parent[:3, :3], R_local[j], T[:3, :3])
            for i in range(3):
                T[i, 3] = (
                    T_parent[i, 0] * offsets_m[j, 0]
                    + T_parent[i, 1] * offsets_m[j, 1]
                    + T_parent[i, 2] * offsets_m[j, 2]
                    + T_parent[i, 3]
                )
