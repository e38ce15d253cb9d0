"""Forward kinematics for batches of poses."""

import numba
import numpy as np

from services.mocap.body.cloth_frames import ANKLES, HIPS, KNEES, PELVIS, WEBS, hang, span
from services.mocap.body.skeleton import DOFS, JOINT_INDEX, JOINTS, LOWER, SEGMENT_JOINT, UPPER, dofs_of
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
HANGING, _FIRST_WEB = N_JOINTS, N_JOINTS + 1
CLOTH_JOINTS: tuple[tuple[int, ...], ...] = ((PELVIS,), *[(*HIPS.tolist(), *KNEES.tolist())] * len(WEBS))
"""The joints whose turning moves each frame of cloth."""
N_FRAMES = N_JOINTS + len(CLOTH_JOINTS)
CLOTH_FRAMES: Ints = np.arange(N_JOINTS, N_FRAMES, dtype=np.int32)
"""(5,) frames of cloth: no joints, but they follow these in all arrays. The first one, of cloth that hangs
from the pelvis, leans half as far as this. The others are of webs between the legs, and not rigid: they take
the corners of a unit tetrahedron to two points of the left and the right leg."""
ALL_FRAMES: Ints = np.arange(N_FRAMES, dtype=np.int32)
SEGMENT_JOINTS: Ints = np.array([JOINT_INDEX[j] for j in SEGMENT_JOINT.values()], np.int32)
"""(S,) the joint that carries each segment."""
SURFACE_FRAMES: Ints = np.concatenate([SEGMENT_JOINTS, CLOTH_FRAMES])
"""(S + 5,) the frame of each surface that is drawn: of the segments, then of the cloth of a skirt."""
N_RIGID = len(SEGMENT_JOINTS) + 1
"""Surfaces from this one on are webs, with frames that stretch them."""


def moving_frames(dofs: tuple[int, ...], surfaces: tuple[int, ...]) -> Ints:
    """The frames that parameters move, parents first, of surfaces or of joints that lead to them."""
    carriers = set(SURFACE_FRAMES[list(surfaces)].tolist())
    cloth = [frame for frame in CLOTH_FRAMES.tolist() if frame in carriers]
    if cloth:
        carriers.update([PELVIS, HANGING])
    if cloth and cloth[-1] >= _FIRST_WEB:
        carriers.update(ANKLES.tolist())
    moved, leading = set[int](), set[int]()
    for j in range(N_JOINTS):
        first, last = DOF_RANGE[j]
        if PARENT[j] in moved or any(first <= d < last for d in dofs):
            moved.add(j)
    for j in reversed(range(N_JOINTS)):
        if j in carriers or j in {PARENT[k] for k in leading}:
            leading.add(j)
    moving_cloth = [
        f for f in CLOTH_FRAMES.tolist() if f in carriers and moved & {*CLOTH_JOINTS[f - N_JOINTS]}
    ]
    return np.array([*sorted(moved & leading), *moving_cloth], np.int32)


def clip_to_limits(poses: Floats) -> Floats:
    """(…, D) poses moved to the nearest ones within the joint limits."""
    return np.clip(poses, LOWER, UPPER)


def frame_transforms(poses: Floats, offsets_m: Floats) -> Floats:
    """World transforms of all joints, and of CLOTH_FRAMES after them.

    poses: (N, D) in metres and radians. offsets_m: (J, 3), each joint relative to its parent in the rest
    pose; with one more row, the hem of a skirt relative to the pelvis. Returns T_world_frame
    (N, J + 5, 4, 4).
    """
    # A copy: for Numba a read-only array, as in a message, is another type.
    poses = np.array(poses, np.float64, order="C")
    if poses.ndim != 2 or poses.shape[1] != N_DOF:
        raise ValueError(f"poses: expected shape (N, {N_DOF}), got {poses.shape}")
    T_world_frame = np.empty((len(poses), N_FRAMES, 4, 4))
    for pose, T in zip(poses, T_world_frame, strict=True):
        place_frames(pose, offsets_m, ALL_FRAMES, T)
    return T_world_frame


def joint_transforms(poses: Floats, offsets_m: Floats) -> Floats:
    """World transforms of all joints: T_world_joint (N, J, 4, 4); arguments as frame_transforms."""
    return frame_transforms(poses, offsets_m)[:, :N_JOINTS]


def segment_transforms(poses: Floats, offsets_m: Floats) -> Floats:
    """World transforms of all segments: T_world_segment (N, S, 4, 4); arguments as frame_transforms."""
    return frame_transforms(poses, offsets_m)[:, SEGMENT_JOINTS]


def surface_transforms(poses: Floats, offsets_m: Floats) -> Floats:
    """World transforms of all surfaces: T_world_surface (N, S + 5, 4, 4); arguments as frame_transforms."""
    return frame_transforms(poses, offsets_m)[:, SURFACE_FRAMES]


def joint_positions(poses: Floats, offsets_m: Floats) -> Floats:
    """Joint centres joints_world_m (N, J, 3); arguments as frame_transforms."""
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
def multiply(A: Floats, B: Floats, out: Floats) -> None:
    """Write the product of the upper left (3, 3) of A and B into that of out, none the same."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@numba.njit(cache=True, nogil=True)
def copy_rotation(R: Floats, out: Floats) -> None:
    """Write the upper left (3, 3) of R into that of out.

    Not by slices: for these Numba compiles what their errors would say, which takes it seconds.
    """
    for i in range(3):
        for j in range(3):
            out[i, j] = R[i, j]


@numba.njit(cache=True, nogil=True)
def swing_of(pose: Floats, joint: int, out: Floats) -> None:
    """Write the rotation vector (3,) of a joint's swing."""
    out[:] = 0.0
    first, last = DOF_RANGE[joint]
    for d in range(first, last):
        if DOF_ROLE[d] == SWING:
            for i in range(3):
                out[i] += pose[d] * DOF_AXIS[d, i]


@numba.njit(cache=True, nogil=True)
def _local_rotation(pose: Floats, joint: int, R: Floats, turn: Floats, product: Floats) -> None:
    """A joint's rotation R (3, 3) against its parent; turn and product (3, 3) are scratch."""
    swing = np.empty(3)
    swing_of(pose, joint, swing)
    rotation_of(swing[0], swing[1], swing[2], R)
    first, last = DOF_RANGE[joint]
    for d in range(first, last):
        if DOF_ROLE[d] == TURN:
            x, y, z = DOF_AXIS[d]
            rotation_of(pose[d] * x, pose[d] * y, pose[d] * z, turn)
            multiply(R, turn, product)
            copy_rotation(product, R)


@numba.njit(cache=True, nogil=True)
def place_frames(pose: Floats, offsets_m: Floats, frames: Ints, T_world_frame: Floats) -> None:
    """Write the world transforms of some frames, parents before children, into T_world_frame (J + 5, 4, 4).

    The transforms of their other parents must be set. pose (D,); offsets_m as for frame_transforms.
    """
    R_parent_joint, turn, product = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for j in frames:
        T = T_world_frame[j]
        T[3, 0], T[3, 1], T[3, 2], T[3, 3] = 0.0, 0.0, 0.0, 1.0
        if j == HANGING:
            hang(T_world_frame[PELVIS], T)
            continue
        if j >= _FIRST_WEB:
            hem_m = -offsets_m[N_JOINTS, 2] if len(offsets_m) > N_JOINTS else 0.0
            span(T_world_frame, T_world_frame[HANGING], hem_m, WEBS[j - _FIRST_WEB], T)
            continue
        _local_rotation(pose, j, R_parent_joint, turn, product)
        if PARENT[j] < 0:
            copy_rotation(R_parent_joint, T)
            for i in range(3):
                T[i, 3] = offsets_m[j, i] + pose[i]
            continue
        T_parent = T_world_frame[PARENT[j]]
        multiply(T_parent, R_parent_joint, T)
        for i in range(3):
            T[i, 3] = (
                T_parent[i, 0] * offsets_m[j, 0]
                + T_parent[i, 1] * offsets_m[j, 1]
                + T_parent[i, 2] * offsets_m[j, 2]
                + T_parent[i, 3]
            )
