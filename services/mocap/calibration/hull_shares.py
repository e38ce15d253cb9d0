"""How much of each camera's silhouette the visual hull of all others fills: all of it, if they agree."""

import cv2
import numpy as np

from services.mocap.camera.rig import Rig
from services.mocap.search.hull import MIN_CAMERAS, cube_about, look_up, meeting_point
from services.mocap.types import Bytes, Floats, Mask

_VOXEL_M = 0.05
_REACH_M = 1.6


def filled_by_others(rig: Rig, silhouettes: Mask, possible: Mask | None = None) -> Floats:
    """(C,) of silhouettes (C, H, W) of one moment; NaN for a camera that shows nobody.

    possible (C, H, W): what may be actor, by default the silhouettes; it leaves the hull room. Raises
    TakeError where the cameras' rays do not even come near to each other.
    """
    seen = [c for c in range(rig.n_cameras) if silhouettes[c].any()]
    points_m = cube_about(meeting_point(rig, silhouettes, seen), _REACH_M, _VOXEL_M)
    possible = silhouettes if possible is None else possible
    carves, holds = np.zeros((2, rig.n_cameras, len(points_m)), bool)
    for c in seen:
        in_picture, on_actor = look_up(rig, possible[c], c, points_m)
        carves[c], holds[c] = in_picture & ~on_actor, in_picture
    shares: Floats = np.full(rig.n_cameras, np.nan)
    for c in seen:
        others = [o for o in seen if o != c]
        held = 2 * holds[others].sum(axis=0) >= max(len(others), MIN_CAMERAS)
        hull_m = points_m[held & ~carves[others].any(axis=0)]
        shares[c] = (_drawn(rig, c, hull_m) & silhouettes[c]).sum() / silhouettes[c].sum()
    return shares


def _drawn(rig: Rig, camera: int, points_m: Floats) -> Mask:
    """The picture (H, W) of voxels about points (N, 3)."""
    P = rig.P_px_world[camera]
    height, width = rig.shape_px
    homogeneous = points_m @ P[:, :3].T + P[:, 3]
    homogeneous = homogeneous[homogeneous[:, 2] > _VOXEL_M]
    drawn: Bytes = np.zeros((height, width), np.uint8)
    if not len(homogeneous):
        return drawn > 0
    pixel = np.rint(homogeneous[:, :2] / homogeneous[:, 2:]).astype(np.int64)
    pixel = pixel[np.all((pixel >= 0) & (pixel < (width, height)), axis=1)]
    drawn[pixel[:, 1], pixel[:, 0]] = 1
    size_px = float(np.linalg.norm(P[0, :3])) * _VOXEL_M / float(np.median(homogeneous[:, 2]))
    reach = 1 + 2 * int(np.ceil(size_px / 2))
    wide: Mask = cv2.dilate(drawn, np.ones((reach, reach), np.uint8)) > 0
    return wide
