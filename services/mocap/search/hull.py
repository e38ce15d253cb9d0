"""A coarse visual hull: where in space the actor can be, from one frame's silhouettes."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from services.mocap.camera.rig import Rig
from services.mocap.errors import TakeError
from services.mocap.types import Floats, Mask

_VOXEL_M = 0.03
_FEET_M = 0.15
"""How far up from the hull's lowest point the feet are looked for."""
_REACH_M = 1.6
"""Half the side of the cube that is carved, about the point where the silhouettes' centres meet."""
_MIN_CAMERAS = 2
"""One camera alone does not say how far away anything is."""
_SLACK_PX = 1
"""Silhouettes are widened by this much per 320 pixels of width, against ragged edges and the voxels' size."""


@dataclass(frozen=True, eq=False)
class Hull:
    """Voxel centres of the largest connected piece of the visual hull."""

    points_world_m: Floats
    """(N, 3)"""

    @property
    def bottom_m(self) -> float:
        """Height of the soles: the lowest layer that is at least half as wide as the feet's widest.

        Cameras look down at the feet and so do not see the floor under them: there the hull ends in a tip.
        """
        z_m = self.points_world_m[:, 2]
        layers = np.rint((z_m - z_m.min()) / _VOXEL_M).astype(np.int64)
        feet = np.bincount(layers)[: round(_FEET_M / _VOXEL_M)]
        return float(z_m.min() + int(np.argmax(2 * feet >= feet.max())) * _VOXEL_M)

    @property
    def height_m(self) -> float:
        """From the soles to the highest point.

        Between centres: the slack of the silhouettes makes up for the halves of the outermost voxels.
        """
        return float(self.points_world_m[:, 2].max()) - self.bottom_m

    @property
    def axis_world_m(self) -> Floats:
        """(2,) x and y of the middle."""
        return np.median(self.points_world_m[:, :2], axis=0)


def carve(rig: Rig, silhouettes: Mask) -> Hull:
    """Carve the hull from silhouettes (C, H, W).

    Raises TakeError where there is nobody, or where the silhouettes do not meet in space.
    """
    seen = [c for c in range(rig.n_cameras) if silhouettes[c].any()]
    if len(seen) < _MIN_CAMERAS:
        raise TakeError(
            f"silhouettes: only {len(seen)} of {rig.n_cameras} cameras show anybody in the first frame: "
            "choose a first frame in which the actor is in view"
        )
    points_world_m = _cube_about(_meeting_point(rig, silhouettes, seen))
    inside, n_pictures = np.ones(len(points_world_m), bool), np.zeros(len(points_world_m), np.int32)
    for c in seen:
        left = np.flatnonzero(inside)  # most is carved away by the first cameras
        in_picture, on_actor = _look_up(rig, silhouettes[c], c, points_world_m[left])
        n_pictures[left] += in_picture
        inside[left] = on_actor | ~in_picture
    # Where few cameras look, little is carved away: half of them must have a point in their picture.
    inside &= 2 * n_pictures >= max(len(seen), 2 * _MIN_CAMERAS)
    side = round(len(points_world_m) ** (1 / 3))
    pieces, n_pieces = ndimage.label(inside.reshape(side, side, side))
    if n_pieces == 0:
        raise TakeError(
            "calibration.toml: the cameras' silhouettes do not meet anywhere in space: check that the "
            "calibration belongs to this take and that the videos are synchronised"
        )
    largest = 1 + int(np.argmax(np.bincount(pieces.ravel())[1:]))
    return Hull(points_world_m[pieces.ravel() == largest])


def _meeting_point(rig: Rig, silhouettes: Mask, seen: list[int]) -> Floats:
    """The point nearest to the rays through the silhouettes' centres, by least squares."""
    A, b = np.zeros((3, 3)), np.zeros(3)
    for c in seen:
        y, x = np.nonzero(silhouettes[c])
        M, p = rig.P_px_world[c, :, :3], rig.P_px_world[c, :, 3]
        centre_world_m = -np.linalg.solve(M, p)
        ray = np.linalg.solve(M, np.array([x.mean(), y.mean(), 1.0]))
        ray /= np.linalg.norm(ray)
        across = np.eye(3) - np.outer(ray, ray)
        A, b = A + across, b + across @ centre_world_m
    return np.linalg.solve(A, b).astype(np.float64)


def _cube_about(centre_world_m: Floats) -> Floats:
    steps = np.arange(-_REACH_M, _REACH_M + _VOXEL_M / 2, _VOXEL_M)
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
    points_world_m: Floats = grid.reshape(-1, 3) + centre_world_m
    return points_world_m


def _look_up(rig: Rig, silhouette: Mask, camera: int, points_world_m: Floats) -> tuple[Mask, Mask]:
    """Which points project into a camera's picture, and which of them onto its silhouette."""
    width, height = rig.sizes_px[camera]
    size = 1 + 2 * max(1, round(_SLACK_PX * width / 320))
    wide = cv2.dilate(silhouette[:height, :width].astype(np.uint8), np.ones((size, size), np.uint8))
    homogeneous = points_world_m @ rig.P_px_world[camera, :, :3].T + rig.P_px_world[camera, :, 3]
    ahead = homogeneous[:, 2] > 0
    pixel = np.rint(homogeneous[:, :2] / np.where(ahead, homogeneous[:, 2], 1.0)[:, None]).astype(np.int64)
    in_picture: Mask = ahead & np.all((pixel >= 0) & (pixel < (width, height)), axis=1)
    on_actor = in_picture.copy()
    on_actor[in_picture] = wide[pixel[in_picture, 1], pixel[in_picture, 0]] > 0
    return in_picture, on_actor
