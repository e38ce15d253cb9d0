"""Tells the actor from other people in view: what stands apart from where the actor can be is unsure.

It is never background, because another person may hide the actor.
"""

from collections.abc import Collection

import numpy as np
from scipy.spatial import cKDTree

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import joint_positions
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, camera_bit, pack, unpack
from services.mocap.energy.snapping import SUBPIXEL, project_snapped
from services.mocap.search.hull import MIN_CAMERAS, cube_about, in_hull, looked_at, most_missed
from services.mocap.search.occlusion import points_drawn
from services.mocap.types import Floats, Mask

_NEAR_M = 0.45
"""The actor is this near to the joints of the expected pose: hands reach 0.2 m beyond wrists, and move up to
0.3 m between frames."""
_AROUND_M = 1.8
"""Half the side of the cube in which others are looked for."""
_VOXEL_M = 0.06
_ON_PX, _AROUND_PX = 3, 6
"""In pictures 320 wide: around points of a hull, to fill what is between them; and to keep its rim, too."""
_MUCH = 0.1
"""Share of the silhouette near the expected pose: where two cameras see more elsewhere, there is somebody
else."""
_THERE_M, _MOSTLY = 0.2, 0.8
"""What is so near to a joint, and what is not nearer to others than to what is so near, is the actor's; so
near to it must be this share of the joints: otherwise the actor has moved on, and is what is seen
elsewhere."""


def without_others(
    body: Body, rig: Rig, seen: TriPlanes, pose: Floats, absent: Collection[int] = ()
) -> TriPlanes:
    """A frame (P, H, W) in which pixels that show other people are unsure.

    pose (D,): about the actor's. absent: cameras that are not used. The frame is returned as it is unless two
    cameras see much that cannot be the actor, who is where the pose says.
    """
    joints_world_m = joint_positions(pose[None], body.offsets_m)[0]
    return near_to(joints_world_m, rig, seen, absent)[0]


def near_to(
    actor_world_m: Floats, rig: Rig, seen: TriPlanes, absent: Collection[int] = ()
) -> tuple[TriPlanes, Floats]:
    """As without_others, for an actor who is about points (N, 3); also returns points (M, 3) of the actor's
    hull, or the same points if the frame shows nobody else."""
    unchanged = seen, actor_world_m
    cameras = [c for c in range(rig.n_cameras) if c not in absent]
    boxes = [_box(rig, c, actor_world_m) for c in cameras]
    pairs = zip(cameras, boxes, strict=True)
    if sum(_shows_much_else(camera_bit(seen.silhouettes, c), box) for c, box in pairs) < MIN_CAMERAS:
        return unchanged
    possible = unpack(seen.possible, rig.n_cameras)
    looking = [c for c in cameras if possible[c].any()]
    points_world_m = cube_about(
        (actor_world_m.min(axis=0) + actor_world_m.max(axis=0)) / 2, _AROUND_M, _VOXEL_M
    )
    is_inside = in_hull(*looked_at(rig, possible, looking, points_world_m), most_missed(len(looking)))
    points_world_m = points_world_m[is_inside]
    away_m, _ = cKDTree(actor_world_m).query(points_world_m)
    is_near = away_m < _NEAR_M
    if not is_near.any():
        return unchanged
    of_actor = is_near.copy()
    if not is_near.all():  # the nearer somebody else comes, the less of what is between is the actor's
        apart_m, _ = cKDTree(points_world_m[~is_near]).query(points_world_m[is_near])
        of_actor[is_near] = away_m[is_near] < apart_m + _THERE_M
    hull_m = points_world_m[of_actor]
    if np.mean(cKDTree(hull_m).query(actor_world_m)[0] < _THERE_M) < _MOSTLY:
        return unchanged
    actor = drawn_hull(rig, hull_m) & ~drawn_hull(rig, points_world_m[~of_actor], _ON_PX)
    return seen.doubting(seen.silhouettes & ~pack(actor)), hull_m


def drawn_hull(rig: Rig, hull_m: Floats, radius_px: float = _AROUND_PX) -> Mask:
    """(C, H, W) pixels on and around points (N, 3) of a hull; the radius is given for pictures 320 wide."""
    return points_drawn(rig, hull_m, np.ones((rig.n_cameras, len(hull_m)), bool), radius_px)


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
