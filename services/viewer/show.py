"""What there is to see: a take's body, cameras and frames, as all browsers share it."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import segment_transforms
from services.mocap.camera.rig import Rig
from services.mocap.types import Floats
from services.viewer.reel import Reel
from services.viewer.tiles import TileArtist


@dataclass(frozen=True, eq=False)
class Show:
    """One take, while it is tracked or afterwards."""

    take: str
    fps: float
    """Frames per second of the recording."""
    reel: Reel
    body: Body
    rig: Rig | None
    """None where nobody knows the cameras; then there is only the body."""
    camera_names: tuple[str, ...]
    artist: TileArtist | None
    """Draws the camera grid; None without a rig."""
    is_live: bool
    """Whether frames may still come."""
    remark: str = ""
    """What somebody should know who misses something here; a sentence, or nothing."""


@dataclass(frozen=True, eq=False)
class Placed:
    """Where things stand in the z-up world, as the page's scene takes them."""

    wxyz: Floats
    """(N, 4) rotations as quaternions."""
    position_m: Floats
    """(N, 3)"""


def placed_segments(body: Body, pose: Floats) -> Placed:
    """The 16 segments of a body in a pose (35,)."""
    T_world_segment = segment_transforms(pose[None], body.offsets_m)[0]
    return Placed(_wxyz(T_world_segment[:, :3, :3]), T_world_segment[:, :3, 3])


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
