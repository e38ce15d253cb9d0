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
    dofs_of,
)
from services.mocap.types import Floats, Ints

N_DOF = len(DOFS)
N_JOINTS = len(JOINTS)
SHIFT, SWING, TURN = range(3)
_ROLES = {
    "translation": SHIFT, "swing": SWING, "heading": TURN, "lean": TURN, "pitch": TURN, "twist": TURN,
}  # fmt: skip

# In compiled code these tables are constants.
PARENT: Ints = np.array([-1 if j.parent is None else JOINT_INDEX[j.parent] for j in JOINTS], np.int32)
DOF_ROLE: Ints = np.array([_ROLES[dof.role] for dof in DOFS], np.int32)
DOF_AXIS: Floats = np.array([dof.axis for dof in DOFS])
DOF_RANGE: Ints = np.array(
    [(dofs[0], dofs[-1] + 1) if (dofs := dofs_of(joint.name)) else (0, 0) for joint in JOINTS], np.int32
)
"""(J, 2) the first of each joint's parameters, which stand in a row, and the one after the last."""
_ALL_JOINTS: Ints = np.arange(N_JOINTS, dtype=np.int32)
SEGMENT_JOINTS: Ints = np.array([JOINT_INDEX[j] for j in SEGMENT_JOINT.values()], np.int32)
"""(S,) the joint that carries each segment."""


def moving_joints(dofs: tuple[int, ...], segments: tuple[int, ...]) -> Ints:
    """The joints with parameters, parents first, that carry segments or lead to joints that do."""
    moved, leading = set[int](), set[int]()
    for j in range(N_JOINTS):
        first, last = DOF_RANGE[j]
        if PARENT[j] in moved or any(first <= d < last for d in dofs):
            moved.add(j)
    for j in reversed(range(N_JOINTS)):
        if j in SEGMENT_JOINTS[list(segments)] or j in {PARENT[k] for k in leading}:
            leading.add(j)
    return np.array(sorted(moved & leading), np.int32)


def clip_to_limits(poses: Floats) -> Floats:
    """(…, D) poses moved to the nearest ones within the joint limits."""
    return np.clip(poses, LOWER, UPPER)


def joint_transforms(poses: Floats, offsets_m: Floats) -> Floats:
    """World transforms of all joints.

    poses: (N, D) in metres and radians. offsets_m: (J, 3), each joint relative to its parent in the rest
    pose. Returns T_world_joint (N, J, 4, 4).
    """
    # A copy: for Numba a read-only array, as in a message, is another type.
    poses = np.array(poses, np.float64, order="C")
    if poses.ndim != 2 or poses.shape[1] != N_DOF:
        raise ValueError(f"poses: expected shape (N, {N_DOF}), got {poses.shape}")
    T_world_joint = np.empty((len(poses), N_JOINTS, 4, 4))
    _joint_transforms(poses, offsets_m, _ALL_JOINTS, T_world_joint)
    return T_world_joint


def segment_transforms(poses: Floats, offsets_m: Floats) -> Floats:
    """World transforms of all segments: T_world_segment (N, S, 4, 4); arguments as joint_transforms."""
    return joint_transforms(poses, offsets_m)[:, SEGMENT_JOINTS]


def joint_positions(poses: Floats, offsets_m: Floats) -> Floats:
    """Joint centres joints_world_m (N, J, 3); arguments as joint_transforms."""
    return joint_transforms(poses, offsets_m)[:, :, :3, 3]


@numba.njit(cache=True, nogil=True)
def rotation_of(x: float, y: float, z: float, R: Floats) -> None:
    """Rodrigues' formula: R (3, 3) of a rotation vector."""
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
    """Write the product of the upper left (3, 3) of A and B into that of out, none the same."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@numba.njit(cache=True, nogil=True)
def _local_rotation(pose: Floats, joint: int, R: Floats, turn: Floats, product: Floats) -> None:
    """A joint's rotation R (3, 3) against its parent; turn and product (3, 3) are scratch."""
    first, last = DOF_RANGE[joint]
    swing = np.zeros(3)
    for d in range(first, last):
        if DOF_ROLE[d] == SWING:
            for i in range(3):
                swing[i] += pose[d] * DOF_AXIS[d, i]
    rotation_of(swing[0], swing[1], swing[2], R)
    for d in range(first, last):
        if DOF_ROLE[d] == TURN:
            x, y, z = DOF_AXIS[d]
            rotation_of(pose[d] * x, pose[d] * y, pose[d] * z, turn)
            _multiply(R, turn, product)
            R[:] = product


@numba.njit(cache=True, nogil=True)
def place_joints(pose: Floats, offsets_m: Floats, joints: Ints, T_world_joint: Floats) -> None:
    """Write the world transforms of some joints, parents before children, into T_world_joint (J, 4, 4).

    The transforms of their other parents must be set. pose (D,); offsets_m as for joint_transforms.
    """
    R_parent_joint, turn, product = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for j in joints:
        T = T_world_joint[j]
        T[3, 0], T[3, 1], T[3, 2], T[3, 3] = 0.0, 0.0, 0.0, 1.0
        _local_rotation(pose, j, R_parent_joint, turn, product)
        if PARENT[j] < 0:
            T[:3, :3] = R_parent_joint
            for i in range(3):
                T[i, 3] = offsets_m[j, i] + pose[i]
            continue
        T_parent = T_world_joint[PARENT[j]]
        _multiply(T_parent, R_parent_joint, T)
        for i in range(3):
            T[i, 3] = (
                T_parent[i, 0] * offsets_m[j, 0]
                + T_parent[i, 1] * offsets_m[j, 1]
                + T_parent[i, 2] * offsets_m[j, 2]
                + T_parent[i, 3]
            )


@numba.njit(cache=True, nogil=True)
def _joint_transforms(poses: Floats, offsets_m: Floats, joints: Ints, T_world_joint: Floats) -> None:
    for n in range(len(poses)):
        place_joints(poses[n], offsets_m, joints, T_world_joint[n])
