"""Rigid transforms of boards and cameras, and the board's pose from a single sighting."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.calibration.board import Board
from services.mocap.calibration.lens import Intrinsics
from services.mocap.calibration.sightings import Sighting
from services.mocap.camera.camera import Camera
from services.mocap.types import Floats


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """A rigid transform: x_to = R @ x_from + t_m."""

    R: Floats
    """(3, 3)"""
    t_m: Floats
    """(3,)"""

    def __matmul__(self, other: "RigidTransform") -> "RigidTransform":
        return RigidTransform(self.R @ other.R, self.R @ other.t_m + self.t_m)

    @property
    def inverse(self) -> "RigidTransform":
        """The way back."""
        return RigidTransform(self.R.T, -self.R.T @ self.t_m)

    @property
    def matrix(self) -> Floats:
        """(4, 4) the same for homogeneous points."""
        matrix: Floats = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.R, self.t_m
        return matrix

    def apply(self, points_m: Floats) -> Floats:
        """(…, 3) points, moved."""
        return points_m @ self.R.T + self.t_m


IDENTITY = RigidTransform(np.eye(3), np.zeros(3))


def in_world(camera: Camera, T_old_new: RigidTransform) -> Camera:
    """A camera in a new world, whose points are T_old_new @ x in the camera's present one."""
    T_camera_new = RigidTransform(camera.R_camera_world, camera.t_camera_world_m) @ T_old_new
    return replace(camera, R_camera_world=T_camera_new.R, t_camera_world_m=T_camera_new.t_m)


def board_in_camera(sighting: Sighting, board: Board, intrinsics: Intrinsics) -> list[RigidTransform]:
    """T_camera_board from one sighting, the better one first.

    A small flat board can look nearly the same from two directions: then both are returned.
    """
    corners_m = board.corners_m[sighting.corners]
    points = intrinsics.normalised(sighting.points_px)
    count, turns, shifts, _ = cv2.solvePnPGeneric(
        corners_m, points, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE
    )
    poses = [
        RigidTransform(Rotation.from_rotvec(np.ravel(turn)).as_matrix(), np.ravel(shift).astype(np.float64))
        for turn, shift in zip(turns[:count], shifts[:count], strict=True)
    ]
    return [pose for pose in poses if np.isfinite(pose.R).all() and pose.apply(corners_m)[:, 2].min() > 0]
