"""What only one camera sees is not the actor: blobs that the silhouettes of all others leave no room for."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import in_common_size
from services.mocap.errors import TakeError
from services.mocap.search.hull import cube_about, look_up, meeting_point
from services.mocap.types import ACTOR, BACKGROUND, Floats, Ints, Mask, Trimap

_VOXEL_M = 0.08
_REACH_M = 1.3
"""Half the side of the cube in which the actor is looked for, about the middle of the largest blobs."""
_LEAST_OTHERS = 3
"""One of the others may miss what is there, and two have to agree on where it is."""
_SUPPORTED = 0.25
"""Of a blob's area, that the others leave room for; the actor's parts have most of theirs."""


@dataclass(frozen=True, eq=False)
class _Blobs:
    """The connected blobs of a silhouette."""

    labels: Ints
    """(h, w) the number of each pixel's blob, 0 outside."""
    areas_px: Ints
    """(1 + N,) by number."""

    @classmethod
    def of(cls, mask: Mask) -> "_Blobs":
        _, labels, table, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8))
        return cls(np.asarray(labels, np.int32), np.asarray(table[:, cv2.CC_STAT_AREA], np.int32))


def drop_unsupported(rig: Rig, trimaps: Sequence[Trimap]) -> list[Trimap]:
    """Undistorted trimaps (h, w) of all of a rig's cameras without blobs that no other camera supports.

    Blobs are of what is surely actor; unsure pixels of the others leave room, and stay what they are. A
    camera whose picture has one blob or none stays as it is, and so does one in which nothing is supported:
    it may be the calibration that is wrong. Frames in which all cameras are such cost next to nothing.
    """
    actors = [trimap == ACTOR for trimap in trimaps]
    blobs = [_Blobs.of(mask) for mask in actors]
    doubtful = [c for c, of_camera in enumerate(blobs) if of_camera.areas_px.size > 2]
    kept = list(trimaps)
    if not doubtful or rig.n_cameras <= _LEAST_OTHERS:
        return kept
    points_world_m = _room(rig, blobs)
    if points_world_m is None:
        return kept
    possible = [trimap != BACKGROUND for trimap in trimaps]
    for c in doubtful:
        room_m = _left_by_others(rig, actors[c], possible, c, points_world_m)
        drawn = _drawn(rig, c, room_m, trimaps[c].shape)
        labels, areas_px = blobs[c].labels, blobs[c].areas_px
        supported = np.bincount(labels[drawn], minlength=areas_px.size) >= _SUPPORTED * areas_px
        if supported[1:].any():
            kept[c] = np.where(actors[c] & ~supported[labels], np.uint8(BACKGROUND), trimaps[c])
    return kept


def _room(rig: Rig, blobs: Sequence[_Blobs]) -> Floats | None:
    """Points (N, 3) in the world about the actor; None where the cameras do not meet anywhere."""
    height, width = rig.shape_px
    largest: Mask = np.zeros((len(blobs), height, width), bool)
    for c, of_camera in enumerate(blobs):
        if of_camera.areas_px.size > 1:
            biggest = 1 + int(of_camera.areas_px[1:].argmax())
            largest[c] = in_common_size(of_camera.labels == biggest, width, height)
    seen = [c for c in range(len(blobs)) if largest[c].any()]
    if len(seen) <= _LEAST_OTHERS:
        return None
    try:
        return cube_about(meeting_point(rig, largest, seen), _REACH_M, _VOXEL_M)
    except TakeError:
        return None


def _left_by_others(
    rig: Rig, own: Mask, possible: Sequence[Mask], camera: int, points_world_m: Floats
) -> Floats:
    """Those of some points (N, 3) on a camera's own silhouette (h, w) that the others leave room for: (M, 3).

    possible: (h, w) what may be actor, of each camera.
    """
    _, on_own = look_up(rig, own, camera, points_world_m)
    points_world_m = points_world_m[on_own]
    seeing, holding = np.zeros((2, len(points_world_m)), np.int32)
    for c in range(rig.n_cameras):
        if c != camera:
            in_picture, on_actor = look_up(
                rig, _widened(rig, possible[c], c, points_world_m), c, points_world_m
            )
            seeing += in_picture
            holding += on_actor
    return points_world_m[(seeing >= _LEAST_OTHERS) & (holding >= seeing - 1)]


def _voxel_px(rig: Rig, camera: int, points_world_m: Floats) -> int:
    """About how wide a voxel is in a camera's picture, an odd number of pixels."""
    P = rig.P_px_world[camera]
    if len(points_world_m) == 0:
        return 1
    depth_m = max(float(P[2] @ np.append(points_world_m.mean(axis=0), 1.0)), _VOXEL_M)
    return 1 + 2 * round(_VOXEL_M * float(np.linalg.norm(P[0, :3])) / depth_m / 2)


def _widened(rig: Rig, mask: Mask, camera: int, points_world_m: Floats) -> Mask:
    """A mask (h, w) grown by half a voxel, so that no limb slips through between the points."""
    size = _voxel_px(rig, camera, points_world_m)
    return np.asarray(cv2.dilate(mask.view(np.uint8), np.ones((size, size), np.uint8)) > 0)


def _drawn(rig: Rig, camera: int, points_world_m: Floats, shape: tuple[int, ...]) -> Mask:
    """The picture (h, w) of voxels about points (N, 3)."""
    drawn = np.zeros(shape, np.uint8)
    if len(points_world_m) == 0:
        return drawn.view(np.bool_)
    size = _voxel_px(rig, camera, points_world_m)
    homogeneous = points_world_m @ rig.P_px_world[camera, :, :3].T + rig.P_px_world[camera, :, 3]
    homogeneous = homogeneous[homogeneous[:, 2] > _VOXEL_M]
    pixel = np.rint(homogeneous[:, :2] / homogeneous[:, 2:]).astype(np.int64)
    pixel = pixel[np.all((pixel >= 0) & (pixel < shape[::-1]), axis=1)]
    drawn[pixel[:, 1], pixel[:, 0]] = 1
    return np.asarray(cv2.dilate(drawn, np.ones((size, size), np.uint8)) > 0)
