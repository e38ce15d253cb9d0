"""What there is to see: a take's body, cameras and frames, as all browsers share it."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import SEGMENT_JOINTS, joint_transforms
from services.mocap.body.skeleton import JOINTS, SEGMENT_JOINT
from services.mocap.camera.rig import Rig
from services.mocap.motion.rest import rest_rotations, turns_from_rest
from services.mocap.types import Floats
from services.viewer.frame_history import FrameHistory
from services.viewer.tiles import TileArtist


@dataclass(frozen=True, eq=False)
class Show:
    """One take, while it is tracked or afterwards."""

    take: str
    fps: float
    """Frames per second of the recording."""
    history: FrameHistory
    body: Body
    rig: Rig | None
    """None where nobody knows the cameras; then there is only the body."""
    camera_names: tuple[str, ...]
    artist: TileArtist | None
    """Draws the camera grid; None without a rig."""
    is_live: bool
    """Whether frames may still come."""
    has_pictures: bool = True
    """Whether there are pictures; else silhouettes stand for them."""
    remark: str = ""
    """What somebody should know who misses something here; a sentence, or nothing."""


SEGMENT_PARENTS: tuple[str | None, ...] = tuple(
    next((name for name, carrier in SEGMENT_JOINT.items() if carrier == JOINTS[joint].parent), None)
    for joint in SEGMENT_JOINTS.tolist()
)
"""(S,) the segment that carries each segment; None for the pelvis."""
_R_T_POSE = rest_rotations("T")


@dataclass(frozen=True, eq=False)
class Placed:
    """How segments are turned, each in the one that carries it, where it stands as far off as ever."""

    wxyz: Floats
    """(S, 4) rotations as quaternions; the pelvis's in the z-up world."""
    root_m: Floats
    """(3,) where the pelvis is in the world."""


def placed_segments(body: Body, pose: Floats) -> Placed:
    """The segments of a body in a pose (D,)."""
    T_world_joint = joint_transforms(pose[None], body.offsets_m)
    turns = turns_from_rest(T_world_joint, _R_T_POSE)[0, SEGMENT_JOINTS]
    return Placed(_wxyz(turns), T_world_joint[0, 0, :3, 3])


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera as a frustum shows it."""

    wxyz: Floats
    """(4,) its axes in the world: x right, y down, z ahead."""
    position_m: Floats
    """(3,)"""
    fov_rad: float
    """Vertical opening."""
    aspect: float
    """Width over height."""


def lenses_of(rig: Rig) -> list[Lens]:
    """The cameras of a rig."""
    return [_lens(P, *size) for P, size in zip(rig.P_px_world, rig.sizes_px.tolist(), strict=True)]


def _lens(P_px_world: Floats, width_px: int, height_px: int) -> Lens:
    """P = K [R t]: K is the upper triangle of an RQ decomposition, in which depth is positive ahead."""
    flip = np.eye(3)[::-1]
    Q, U = np.linalg.qr((flip @ P_px_world[:, :3]).T)
    K, R = flip @ U.T @ flip, flip @ Q.T
    signs = np.sign(np.diag(K))
    K, R = K * signs, signs[:, None] * R
    if np.linalg.det(R) < 0:  # P is known up to its sign only
        R = -R
    centre_m = np.asarray(-np.linalg.solve(P_px_world[:, :3], P_px_world[:, 3]), np.float64)
    fov_rad = 2 * np.arctan(0.5 * height_px * K[2, 2] / K[1, 1])
    return Lens(_wxyz(R.T[None])[0], centre_m, float(fov_rad), width_px / height_px)


def _wxyz(rotations: Floats) -> Floats:
    """(N, 4) quaternions of rotation matrices (N, 3, 3)."""
    return np.roll(Rotation.from_matrix(rotations).as_quat(), 1, axis=1)
