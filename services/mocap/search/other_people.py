"""Tells the actor from other people in view: what stands apart from where the actor can be is unsure.

It is never background, because another person may hide the actor.
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import joint_positions
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, camera_bit, pack, unpack
from services.mocap.energy.snapping import SUBPIXEL, project_snapped
from services.mocap.search.hull import MIN_CAMERAS, in_hull, looked_at, most_missed
from services.mocap.search.occlusion import points_drawn
from services.mocap.types import Floats, Mask

_NEAR_M = 0.45
"""The actor is this near to the joints of the expected pose: hands reach 0.2 m beyond wrists, and move up to
0.3 m between frames."""
_VOXEL_M = 0.05
_AROUND_PX = 6
"""In pictures 320 wide, around points of the hull: more than their distance, to keep the actor's rim."""
_MUCH = 0.1
"""Share of the silhouette near the expected pose: where two cameras see more elsewhere, there is somebody
else."""
_THERE_M, _MOSTLY = 0.2, 0.8
"""A piece of the hull is the actor's if a joint is so near; and so near to these must be this share of the
joints: otherwise the actor has moved on, and is what is seen elsewhere."""


def without_others(
    body: Body, rig: Rig, seen: TriPlanes, pose: Floats, absent: Collection[int] = ()
) -> TriPlanes:
    """A frame (P, H, W) in which pixels that show other people are unsure; pose (D,): about the actor's.

    absent: cameras that are not used. The frame is returned as it is unless two cameras see much that cannot
    be the actor, who is where the pose says.
    """
    joints_world_m = joint_positions(pose[None], body.offsets_m)[0]
    boxes = [_box(rig, c, joints_world_m) for c in range(rig.n_cameras)]
    cameras = [c for c in range(rig.n_cameras) if c not in absent]
    if sum(_shows_much_else(camera_bit(seen.silhouettes, c), boxes[c]) for c in cameras) < MIN_CAMERAS:
        return seen
    possible = unpack(seen.possible, rig.n_cameras)
    looking = [c for c in cameras if possible[c].any()]
    points_world_m, away_m = _grid_about(joints_world_m)
    is_inside = away_m < _NEAR_M
    looks = looked_at(rig, possible, looking, points_world_m[is_inside])
    is_inside[is_inside] = in_hull(*looks, most_missed(len(looking)))
    pieces, _ = ndimage.label(is_inside)
    of_actor = np.isin(pieces, np.unique(pieces[is_inside & (away_m < _THERE_M)]))
    hull_m = points_world_m[of_actor & is_inside]
    if not len(hull_m) or np.mean(cKDTree(hull_m).query(joints_world_m)[0] < _THERE_M) < _MOSTLY:
        return seen
    actor = points_drawn(rig, hull_m, np.ones((rig.n_cameras, len(hull_m)), bool), _AROUND_PX)
    others = seen.silhouettes & ~pack(actor)
    return replace(seen, silhouettes=seen.silhouettes & ~others, unsure=seen.unsure | others)


def _box(rig: Rig, camera: int, points_world_m: Floats) -> tuple[slice, slice]:
    """The part of a picture, as rows and columns, in which all that is near to points (N, 3) is seen."""
    steps, depths_m = project_snapped(points_world_m, rig.P_px_world[camera])
    reach_px = _NEAR_M * np.linalg.norm(rig.P_px_world[camera, 0, :3]) / np.maximum(depths_m, _NEAR_M)
    low = np.floor((steps / SUBPIXEL - reach_px[:, None]).min(axis=0)).clip(0).astype(int)
    high = np.ceil((steps / SUBPIXEL + reach_px[:, None]).max(axis=0)).clip(0).astype(int)
    return slice(int(low[1]), int(high[1]) + 1), slice(int(low[0]), int(high[0]) + 1)


def _shows_much_else(silhouette: Mask, box: tuple[slice, slice]) -> bool:
    """Whether a silhouette (H, W) has many pixels outside a box."""
    near_px = np.count_nonzero(silhouette[box])
    return bool(np.count_nonzero(silhouette) - near_px > _MUCH * near_px > 0)


def _grid_about(joints_world_m: Floats) -> tuple[Floats, Floats]:
    """The points (X, Y, Z, 3) of a grid around joints (J, 3), and the distance (X, Y, Z) of each from the
    nearest joint."""
    low, high = joints_world_m.min(axis=0) - _NEAR_M, joints_world_m.max(axis=0) + _NEAR_M
    axes = [np.arange(a, b, _VOXEL_M) for a, b in zip(low, high, strict=True)]
    points_world_m = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distances_m, _ = cKDTree(joints_world_m).query(points_world_m)
    return points_world_m, np.asarray(distances_m)
