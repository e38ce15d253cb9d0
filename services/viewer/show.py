"""The content of a page: a take's body, cameras and frames, shared by all browsers."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import SEGMENT_JOINTS, joint_transforms
from services.mocap.camera.rig import Rig
from services.mocap.motion.motion import rest_rotations, turns_from_rest
from services.mocap.types import Floats
from services.mocap.verdict.verdict import Verdict
from services.viewer.frame_history import FrameHistory
from services.viewer.tiles import TileArtist


@dataclass(frozen=True, eq=False)
class Show:
    """One take, during tracking or afterwards."""

    take: str
    fps: float
    """Frames per second of the recording."""
    history: FrameHistory
    body: Body
    rig: Rig | None
    """None if the cameras are not known; then only the body is shown."""
    camera_names: tuple[str, ...]
    artist: TileArtist | None
    """Draws the camera grid; None without a rig."""
    is_live: bool
    """Whether frames may still come."""
    has_pictures: bool = True
    """Whether there are pictures; otherwise silhouettes are shown."""
    remark: str = ""
    """A sentence that explains what is missing, or nothing."""
    verdict: Verdict | None = None
    """On finished results; None while there are none."""


_R_T_POSE = rest_rotations("T")


def placed_segments(body: Body, pose: Floats) -> tuple[Floats, Floats]:
    """Rotations (S, 4) of a body's segments, and where the pelvis is in the world (3,), in a pose (D,).

    Rotations are quaternions wxyz against the segment that carries each, where it stands as far off as ever;
    the pelvis's is in the z-up world.
    """
    T_world_joint = joint_transforms(pose[None], body.offsets_m)
    turns = turns_from_rest(T_world_joint, _R_T_POSE)[0, SEGMENT_JOINTS]
    return Rotation.from_matrix(turns).as_quat(scalar_first=True), T_world_joint[0, 0, :3, 3]


@dataclass(frozen=True, eq=False)
class Frustum:
    """What a camera sees."""

    wxyz: Floats
    """(4,) its axes in the world: x right, y down, z forward."""
    position_m: Floats
    """(3,)"""
    fov_rad: float
    """Vertical opening."""
    aspect: float
    """Width over height."""


def frusta_of(rig: Rig | None) -> list[Frustum]:
    """Those of the cameras of a rig; none without one."""
    frusta = list[Frustum]()
    if rig is None:
        return frusta
    for P_px_world, (width_px, height_px) in zip(rig.P_px_world, rig.sizes_px.tolist(), strict=True):
        sign = np.sign(np.linalg.det(P_px_world[:, :3]))  # P is known up to its factor only
        K, R_camera_world, centre, *_ = cv2.decomposeProjectionMatrix(sign * P_px_world)
        fov_rad = 2 * np.arctan(0.5 * height_px * K[2, 2] / K[1, 1])
        centre_m = (centre[:3] / centre[3]).ravel()
        wxyz = Rotation.from_matrix(R_camera_world.T).as_quat(scalar_first=True)
        frusta.append(Frustum(wxyz, centre_m, fov_rad, width_px / height_px))
    return frusta
