"""One calibrated camera: a pinhole with the lens distortion of its raw pictures."""

import unicodedata
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.types import Floats

# Turns a y-up world (x to the left of someone looking along z) into the z-up world used inside: the axes
# (x, y, z) of the z-up world are the axes (z, x, y) of the y-up one.
R_ZUP_YUP: Floats = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def nfc(name: str) -> str:
    """A name for comparing: macOS and some archives write ü as u and dots, which looks the same."""
    return unicodedata.normalize("NFC", name)


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera in the world frame; `x_camera = R_camera_world @ x_world + t_camera_world_m`."""

    name: str
    width_px: int
    height_px: int
    K: Floats
    """(3, 3) pinhole matrix in pixels; pixel centres lie at whole coordinates."""
    distortion: Floats
    """(4,), (5,) or (8,) OpenCV lens coefficients of the raw pictures; all zero once undistorted."""
    R_camera_world: Floats
    """(3, 3) rotation."""
    t_camera_world_m: Floats
    """(3,) translation."""
    fisheye: bool = False

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.width_px, self.height_px

    @property
    def shape_px(self) -> tuple[int, int]:
        """Height and width, as of an array."""
        return self.height_px, self.width_px

    @property
    def P_px_world(self) -> Floats:
        """(3, 4) projection of homogeneous world points in metres to homogeneous pixels, no distortion."""
        return self.K @ np.column_stack([self.R_camera_world, self.t_camera_world_m])

    @property
    def centre_world_m(self) -> Floats:
        """(3,) the optical centre."""
        return -self.R_camera_world.T @ self.t_camera_world_m

    def project_px(self, points_world_m: Floats) -> Floats:
        """Pinhole projection of (…, 3) world points to (…, 2) pixels; behind the camera gives NaN."""
        homogeneous = points_world_m @ self.P_px_world[:, :3].T + self.P_px_world[:, 3]
        depth = homogeneous[..., 2:]
        return np.where(depth > 0, homogeneous[..., :2] / np.where(depth > 0, depth, 1.0), np.nan)

    def rays_world(self, points_px: Floats) -> Floats:
        """(N, 3) unit vectors from its centre through pixels (N, 2) of its undistorted picture."""
        homogeneous = np.column_stack([points_px, np.ones(len(points_px))])
        rays: Floats = homogeneous @ np.linalg.inv(self.K).T @ self.R_camera_world
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        return rays

    def with_world_turned(self, R_new_old: Floats) -> "Camera":
        """The same camera in a world with rotated axes: x_new = R_new_old @ x_old."""
        return replace(self, R_camera_world=self.R_camera_world @ R_new_old.T)

    def undistorted(self) -> "Camera":
        """The pinhole of this camera's undistorted pictures."""
        return replace(self, distortion=np.zeros(4), fisheye=False)

    def resized(self, width_px: int, height_px: int) -> "Camera":
        """The camera of the same pictures, resized to this width and height."""
        across, down = width_px / self.width_px, height_px / self.height_px
        # the picture's border, half a pixel before the first pixel's centre, stays where it is
        to_new = np.array([[across, 0.0, (across - 1) / 2], [0.0, down, (down - 1) / 2], [0.0, 0.0, 1.0]])
        return replace(self, width_px=width_px, height_px=height_px, K=to_new @ self.K)

    def reduced(self, longest_side_px: int) -> "Camera":
        """The camera of pictures reduced until their longer side has that many pixels; itself if it has no
        more."""
        share = longest_side_px / max(self.width_px, self.height_px)
        if share >= 1:
            return self
        return self.resized(max(1, round(share * self.width_px)), max(1, round(share * self.height_px)))


def moved_by(old: Camera, new: Camera) -> tuple[float, float]:
    """How far a camera turned, in degrees, and moved, in millimetres."""
    turn = Rotation.from_matrix(new.R_camera_world @ old.R_camera_world.T)
    away_m = np.linalg.norm(new.centre_world_m - old.centre_world_m)
    return float(np.degrees(turn.magnitude())), 1e3 * float(away_m)


def nearest_to_rays_m(starts_m: Floats, rays: Floats) -> Floats:
    """(3,) the point nearest to the straight lines from starts (N, 3) along unit vectors (N, 3)."""
    off_ray = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    pulls_m = np.einsum("nij,nj->i", off_ray, starts_m)
    return np.asarray(np.linalg.lstsq(off_ray.sum(axis=0), pulls_m, rcond=None)[0], np.float64)
