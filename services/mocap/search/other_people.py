"""Tells the actor from other people in view: what shows them, or may show either, is unsure.

It is never background, because others may hide the actor. Space is shared out between the actor and others by
the visual hull, and by where the actor is expected.
"""

from collections.abc import Collection

import numpy as np
from scipy.spatial import cKDTree

from services.mocap.body.kinematics import joint_positions
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, camera_bit, pack, unpack
from services.mocap.energy.snapping import SUBPIXEL, project_snapped
from services.mocap.search.hull import MIN_CAMERAS, cube_about, in_hull, looked_at, most_missed
from services.mocap.search.model import Model
from services.mocap.search.occlusion import points_drawn
from services.mocap.types import Floats, Mask

_NEAR_M = 0.45
"""The actor is this near to the joints of the expected pose: hands reach 0.2 m beyond wrists, and move up to
0.3 m between frames."""
_SURELY_M = 0.2
"""A part of the body is this near to a joint; what is so near to an expected joint is the actor's, whoever
else is near."""
_MOSTLY = 0.8
"""Share of the expected joints that must be near to the hull: otherwise the actor has moved on, and is what
is seen elsewhere."""
_MUCH = 0.1
"""Share of the silhouette near the expected pose: where two cameras see more elsewhere, there is somebody
else."""
_AROUND_M, _VOXEL_M = 1.8, 0.06
"""Half the side of the cube in which others are told apart, and the distance of its points."""
_FAR_M, _FAR_VOXEL_M = 4.0, 0.25
"""The same of the cube in which others are found who are farther away."""
_MANY_CAMERAS = 5
"""With so many, one more may miss a point that is surely the actor's: furniture may hide it there."""
_ON_PX, _AROUND_PX = 3, 6
"""In pictures 320 wide: around points of a hull, to fill what is between them; and to keep its rim, too."""


def without_others(model: Model, seen: TriPlanes, pose: Floats, absent: Collection[int] = ()) -> TriPlanes:
    """A frame (P, H, W) in which pixels that show other people are unsure; see find_others."""
    return find_others(model, seen, pose, absent)[0]


def find_others(
    model: Model, seen: TriPlanes, pose: Floats, absent: Collection[int] = ()
) -> tuple[TriPlanes, Floats | None]:
    """A frame (P, H, W) in which pixels that show other people are unsure, and where on the floor they are
    (2,), as x and y in the world.

    pose (D,): about the actor's. absent: cameras that are not used. The frame is returned as it is, and None,
    unless two cameras see much that cannot be the actor, who is where the pose says.
    """
    rig, joints_world_m = model.rig, joint_positions(pose[None], model.body.offsets_m)[0]
    cameras = [c for c in range(rig.n_cameras) if c not in absent]
    if sum(_shows_much_else(rig, c, seen, joints_world_m) for c in cameras) < MIN_CAMERAS:
        return seen, None
    points_world_m, in_picture, is_missed = _hull(rig, seen, joints_world_m, absent)
    joints = cKDTree(joints_world_m)
    away_m, _ = joints.query(points_world_m)
    is_near, kept = away_m < _NEAR_M, (away_m < _SURELY_M) | ~is_missed
    others_m = points_world_m[~is_near & kept]
    of_actor = is_near & kept
    if len(others_m):
        apart_m, _ = cKDTree(others_m).query(points_world_m)
        of_actor &= away_m < apart_m + _SURELY_M
    is_there = cKDTree(points_world_m[of_actor]).query(joints_world_m)[0] < _SURELY_M
    if is_there.mean() < _MOSTLY:
        return seen, None
    alone = _doubting_others(rig, seen, points_world_m, in_picture & kept, of_actor)
    if not len(others_m):
        far_m, _, is_missed = _hull(rig, seen, joints_world_m, absent, _FAR_M, _FAR_VOXEL_M)
        others_m = far_m[~is_missed & (joints.query(far_m)[0] > _NEAR_M)]
    return alone, np.median(others_m[:, :2], axis=0) if len(others_m) else None


def told_apart(
    rig: Rig, seen: TriPlanes, actor_world_m: Floats, others_world_m: Floats, absent: Collection[int] = ()
) -> tuple[TriPlanes, Floats, Floats]:
    """A frame as by without_others, by points of the hulls of the actor (N, 3) and of others (M, 3) a moment
    before; also returns such points of this frame.

    It is returned as it is, with the same points, if the actor is not near to where he or she was.
    """
    points_world_m, in_picture, is_missed = _hull(rig, seen, actor_world_m, absent)
    to_actor_m, to_others_m = (cKDTree(m).query(points_world_m)[0] for m in (actor_world_m, others_world_m))
    of_actor = ~is_missed & (to_actor_m < to_others_m)
    of_others = ~is_missed & ~of_actor
    if not of_actor.any():
        return seen, actor_world_m, others_world_m
    alone = _doubting_others(rig, seen, points_world_m, in_picture & ~is_missed, of_actor)
    return alone, points_world_m[of_actor], points_world_m[of_others] if of_others.any() else others_world_m


def _shows_much_else(rig: Rig, camera: int, seen: TriPlanes, joints_world_m: Floats) -> bool:
    """Whether a camera shows much outside the rectangle around all that is near to joints (J, 3)."""
    steps, depths_m = project_snapped(joints_world_m, rig.P_px_world[camera])
    reach_px = _NEAR_M * np.linalg.norm(rig.P_px_world[camera, 0, :3]) / np.maximum(depths_m, _NEAR_M)
    left, top = np.floor((steps / SUBPIXEL - reach_px[:, None]).min(axis=0)).clip(0).astype(int)
    right, bottom = np.ceil((steps / SUBPIXEL + reach_px[:, None]).max(axis=0)).clip(0).astype(int)
    silhouette = camera_bit(seen.silhouettes, camera)
    near_px = np.count_nonzero(silhouette[top : bottom + 1, left : right + 1])
    return bool(near_px > 0 and np.count_nonzero(silhouette) > (1 + _MUCH) * near_px)


def _hull(
    rig: Rig,
    seen: TriPlanes,
    about_world_m: Floats,
    absent: Collection[int],
    around_m: float = _AROUND_M,
    voxel_m: float = _VOXEL_M,
) -> tuple[Floats, Mask, Mask]:
    """Points (N, 3) of the visual hull in a cube about points (M, 3), in which cameras' pictures they are
    (C, N), and which of them (N,) one camera more misses than may miss a point."""
    possible = unpack(seen.possible, rig.n_cameras)
    looking = [c for c in range(rig.n_cameras) if c not in absent and possible[c].any()]
    middle_m = (about_world_m.min(axis=0) + about_world_m.max(axis=0)) / 2
    points_world_m = cube_about(middle_m, around_m, voxel_m)
    in_picture, on_people = looked_at(rig, possible, range(rig.n_cameras), points_world_m)
    n_missed = most_missed(len(looking))
    inside = in_hull(in_picture[looking], on_people[looking], n_missed)
    almost = inside
    if len(looking) >= _MANY_CAMERAS:
        almost = in_hull(in_picture[looking], on_people[looking], n_missed + 1)
    return points_world_m[almost], in_picture[:, almost], ~inside[almost]


def _doubting_others(
    rig: Rig, seen: TriPlanes, points_world_m: Floats, in_picture: Mask, of_actor: Mask
) -> TriPlanes:
    """A frame (P, H, W) in which only what the actor's points of a hull (N, 3) alone explain is sure.

    in_picture: (C, N) the points that count.
    """
    actor = points_drawn(rig, points_world_m, in_picture & of_actor, _AROUND_PX)
    actor &= ~points_drawn(rig, points_world_m, in_picture & ~of_actor, _ON_PX)
    return seen.doubting(seen.silhouettes & ~pack(actor))
