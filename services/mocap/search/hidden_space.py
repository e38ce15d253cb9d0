"""Where something may hide the actor from a camera, told by what a body leaves unexplained in other cameras.

Where furniture cuts the same leg out of several silhouettes, a leg that is bent out of them differs in fewer
pixels than a straight one. But then other cameras show a leg that nothing explains, where it would be hidden.
"""

import cv2
import numpy as np

from services.mocap.body.kinematics import joint_positions
from services.mocap.body.skeleton import JOINT_INDEX
from services.mocap.energy.bitplanes import TriPlanes, unpack
from services.mocap.energy.picture import Region
from services.mocap.energy.snapping import SUBPIXEL, project_snapped
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.hull import MIN_CAMERAS, cube_about, look_up
from services.mocap.search.model import Model
from services.mocap.search.occlusion import disc, large_pieces
from services.mocap.types import Floats, Mask

_REACH_M, _VOXEL_M = 1.2, 0.03
"""Half the side of the cube about the pelvis in which limbs are looked for."""
_LEAST_PIECE = 0.04
"""Share of a silhouette; less is a hand, a shoe, or a body of another shape."""
_RIM_PX, _AROUND_PX = 2, 2
"""In pictures 320 wide: what is no wider than twice the one is the rim of a body of another shape; so far
about voxels others are."""


def hidden_space(model: Model, seen: TriPlanes, poses: Floats) -> Mask:
    """(C, H, W) background pixels in which something may hide what a body in poses (F, D) leaves unexplained
    of silhouettes (F, P, H, W).

    A limb may be where at least half of the cameras that look there see the actor, and one of them a large
    piece that the body does not cover.
    """
    rig = model.rig
    hidden, ever_seen = np.zeros((2, rig.n_cameras, *rig.shape_px), bool)
    pelvis_world_m = joint_positions(poses, model.body.offsets_m)[:, JOINT_INDEX["pelvis"]]
    drawn = model.backend.coverage(poses, ALL_SURFACES, Region.whole(rig))
    for f, planes in enumerate(drawn):
        possible = unpack(seen.possible[f], rig.n_cameras)
        ever_seen |= possible
        uncovered = unpack(seen.silhouettes[f] & ~planes, rig.n_cameras)
        pieces = np.array([
            large_pieces(_without_rims(left, model), _LEAST_PIECE * of_camera.sum()) > 0
            for left, of_camera in zip(uncovered, possible, strict=True)
        ])  # fmt: skip
        if pieces.any():
            hidden |= _missed_by(model, possible, pieces, pelvis_world_m[f])
    grown = np.array([cv2.dilate(mask.view(np.uint8), disc(_AROUND_PX, rig)) > 0 for mask in hidden])
    return np.asarray(grown & ~ever_seen)


def _without_rims(mask: Mask, model: Model) -> Mask:
    opened = cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_OPEN, disc(_RIM_PX, model.rig))
    return np.asarray(opened > 0)


def _missed_by(model: Model, possible: Mask, pieces: Mask, centre_world_m: Floats) -> Mask:
    """(C, H, W) where each camera does not see points, near a centre (3,), that others see in some pieces
    (C, H, W) of what may be the actor (C, H, W)."""
    rig = model.rig
    points_world_m = cube_about(centre_world_m, _REACH_M, _VOXEL_M)
    n_pictures, n_seen = np.zeros((2, len(points_world_m)), np.int32)
    in_piece, missed = np.zeros(len(points_world_m), bool), list[Mask]()
    for c in range(rig.n_cameras):
        in_picture, on_actor = look_up(rig, possible[c], c, points_world_m)
        n_pictures += in_picture
        n_seen += on_actor
        missed.append(in_picture & ~on_actor)
        if pieces[c].any():
            in_piece |= look_up(rig, pieces[c], c, points_world_m)[1]
    may_be_actor = in_piece & (n_seen >= MIN_CAMERAS) & (2 * n_seen >= n_pictures)
    hidden: Mask = np.zeros_like(possible)
    for c in range(rig.n_cameras):
        steps, _ = project_snapped(points_world_m[may_be_actor & missed[c]], rig.P_px_world[c])
        columns, rows = np.rint(steps.T / SUBPIXEL).astype(np.int32)
        hidden[c, rows, columns] = True
    return hidden
