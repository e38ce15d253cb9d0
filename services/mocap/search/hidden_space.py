"""Where something may hide the actor from a camera, told by what a body leaves unexplained in other cameras.

Where furniture cuts the same leg out of several silhouettes, a leg that is bent out of them differs in fewer
pixels than a straight one. But then other cameras show a leg that nothing explains, where it would be hidden.
"""

import cv2
import numpy as np

from services.mocap.body.kinematics import joint_positions
from services.mocap.body.skeleton import JOINT_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, unpack
from services.mocap.energy.picture import Region
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.hull import MIN_CAMERAS, cube_about, looked_at
from services.mocap.search.model import Model
from services.mocap.search.occlusion import disc, large_pieces, points_drawn
from services.mocap.types import Floats, Mask

_REACH_M = 1.2
"""Half the side of the cube about the pelvis in which limbs are looked for."""
_VOXEL_M = 0.03
"""Distance of the points that are looked at in it."""
_LEAST_PIECE = 0.04
"""Share of a silhouette; less is a hand, a shoe, or a body of another shape."""
_RIM_PX = 2
"""In pictures 320 wide; an unexplained piece that is at most twice as wide is the rim of a wider body."""
_AROUND_PX = 2
"""In pictures 320 wide; each point stands for the pixels this near to it."""
_EXPLAINED = 0.8
"""Share of the unexplained pieces that limbs behind furniture must explain."""


def hidden_space(model: Model, seen: TriPlanes, poses: Floats) -> Mask:
    """(C, H, W) background pixels in which something may hide what a body in poses (F, D) leaves unexplained
    of silhouettes (F, P, H, W).

    Limbs may be where one camera sees a large piece that the body does not cover, and as few others as
    possible, at most half of those that look there, see background. There, something hides them.
    """
    rig = model.rig
    hidden, ever_seen = np.zeros((2, rig.n_cameras, *rig.shape_px), bool)
    pelvis_world_m = joint_positions(poses, model.body.offsets_m)[:, JOINT_INDEX["pelvis"]]
    drawn = model.backend.coverage(poses, ALL_SURFACES, Region.whole(rig))
    for f, planes in enumerate(drawn):
        possible = unpack(seen.possible[f], rig.n_cameras)
        ever_seen |= possible
        silhouettes, covered = unpack(seen.silhouettes[f], rig.n_cameras), unpack(planes, rig.n_cameras)
        pieces = np.array([
            large_pieces(_without_rims(of_camera & ~covered[c], rig, c), _LEAST_PIECE * of_camera.sum()) > 0
            for c, of_camera in enumerate(silhouettes)
        ])  # fmt: skip
        if pieces.any():
            hidden |= _missed_by(rig, possible, pieces, pelvis_world_m[f])
    return np.asarray(hidden & ~ever_seen)


def _without_rims(mask: Mask, rig: Rig, camera: int) -> Mask:
    return np.asarray(cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_OPEN, disc(_RIM_PX, rig, camera)) > 0)


def _missed_by(rig: Rig, possible: Mask, pieces: Mask, centre_world_m: Floats) -> Mask:
    """(C, H, W) where limbs near a centre (3,) that explain some pieces (C, H, W) of what may be the actor
    (C, H, W) are hidden from each camera."""
    points_world_m = cube_about(centre_world_m, _REACH_M, _VOXEL_M)
    in_picture, on_actor = looked_at(rig, possible, range(rig.n_cameras), points_world_m)
    _, on_piece = looked_at(rig, pieces, np.flatnonzero(pieces.any(axis=(1, 2))).tolist(), points_world_m)
    missed = in_picture & ~on_actor
    n_seen, n_missed = on_actor.sum(axis=0), missed.sum(axis=0)
    may_be_actor = on_piece.any(axis=0) & (n_seen >= MIN_CAMERAS) & (n_missed <= n_seen)
    for allowed in range(rig.n_cameras // 2 + 1):
        limbs = may_be_actor & (n_missed <= allowed)
        drawn = points_drawn(rig, points_world_m, limbs & in_picture, _AROUND_PX)
        if np.count_nonzero(pieces & drawn) >= _EXPLAINED * np.count_nonzero(pieces):
            return points_drawn(rig, points_world_m, limbs & missed, _AROUND_PX)
    return np.zeros_like(possible)
