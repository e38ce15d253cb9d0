"""The differences between a pose and the input, by body part and by camera."""

from dataclasses import dataclass

import numba
import numpy as np

from services.mocap.body.kinematics import N_JOINTS, PARENT, SEGMENT_JOINTS, joint_transforms
from services.mocap.body.skeleton import SEGMENTS
from services.mocap.energy.bitplanes import CAMERAS_PER_PLANE, count_by_camera
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import ALL_SURFACES, HEAD, LIMBS, Stage
from services.mocap.search.model import Model
from services.mocap.take.marks import PARTS, Part
from services.mocap.types import Bytes, Floats, Ints

PART_STAGES: dict[Part, Stage] = {"head": HEAD, **{name: limb.main for name, limb in LIMBS.items()}}
"""Parts with their own window."""
_NEAREST_M = 1e-3
"""Points nearer to a camera, or behind it, are moved to this depth."""


SEGMENT_PARTS = [PARTS.index(segment.part) for segment in SEGMENTS]
"""The part of each segment, as its place among PARTS."""
PART_SEGMENTS: dict[Part, tuple[int, ...]] = {
    part: tuple(s for s, segment in enumerate(SEGMENTS) if segment.part == part) for part in PARTS
}
"""The segments of each part, in the order of PARTS."""
_JOINT_PARTS = dict(zip(SEGMENT_JOINTS.tolist(), SEGMENT_PARTS, strict=True))
_POINT_PARTS: Ints = np.array(
    [_JOINT_PARTS[j] if j in _JOINT_PARTS else _JOINT_PARTS[int(PARENT[j])] for j in range(N_JOINTS)]
    + SEGMENT_PARTS,
    np.int32,
)
"""(J + S,) the part of every joint, then of every segment; a tip is of the segment that it ends."""


@dataclass(frozen=True)
class ErrorByPart:
    """The differences of a pose, with the full mesh in whole pictures."""

    energy_px: int
    """Differing pixels, over all cameras."""
    part_px: dict[Part, int]
    """The same by the part that each pixel is nearest to; the sum is the total."""
    iou: list[float]
    """Intersection over union of model and input in each camera; 1 if both are empty, 0 if the model is
    in a picture that is all unsure (TriPlanes.doubting_failed)."""


def error_by_part(model: Model, whole: Picture, pose: Floats) -> ErrorByPart:
    """Draw a pose (D,) and count."""
    covered = model.backend.coverage(pose[None], ALL_SURFACES, whole.region)[0]
    counted = ~whole.ignored
    differing = (covered ^ whole.silhouettes) & counted
    part_px = pixels_by_part(differing, model, pose)
    common = count_by_camera(covered & whole.silhouettes & counted, model.rig.n_cameras)
    either = common + count_by_camera(differing, model.rig.n_cameras)
    iou = np.where(either > 0, common / np.maximum(either, 1), 1.0)
    if whole.unsure is not None:
        is_all_unsure = count_by_camera(whole.unsure, model.rig.n_cameras) == whole.unsure[0].size
        drawn = count_by_camera(covered & ~whole.region.outside(model.rig), model.rig.n_cameras)
        iou[is_all_unsure & (drawn > 0)] = 0.0
    return ErrorByPart(sum(part_px.values()), part_px, iou.tolist())


def pixels_by_part(planes: Bytes, model: Model, pose: Floats) -> dict[Part, int]:
    """Count the set bits of planes (P, H, W) by the nearest part, using joints and segment centres.

    That is told in the pictures, of a pose (D,).
    """
    counts: Ints = np.zeros(len(PARTS), np.int32)
    _count_nearest(planes, _points_px(model, pose), _POINT_PARTS, counts)
    return dict(zip(PARTS, counts.tolist(), strict=True))


def _points_px(model: Model, pose: Floats) -> Floats:
    """Projections (C, J + S, 2) of the joints and of the middles of segments."""
    T_world_joint = joint_transforms(pose[None], model.body.offsets_m)[0]
    T_world_segment = T_world_joint[SEGMENT_JOINTS]
    middles_m = (T_world_segment[:, :3, :3] @ model.body.centres_m[:, :, None])[:, :, 0]
    points_m = np.vstack([T_world_joint[:, :3, 3], middles_m + T_world_segment[:, :3, 3]])
    P_px_world = model.rig.P_px_world
    homogeneous = P_px_world[:, None, :, :3] @ points_m[:, :, None] + P_px_world[:, None, :, 3:]
    points_px: Floats = homogeneous[:, :, :2, 0] / np.maximum(homogeneous[:, :, 2:, 0], _NEAREST_M)
    return points_px


@numba.njit(cache=True, nogil=True)
def _count_nearest(planes: Bytes, points_px: Floats, point_parts: Ints, counts: Ints) -> None:
    """Add to counts (6,) the set bits of planes (P, H, W), each to the part of its nearest point."""
    for p in range(planes.shape[0]):
        for y in range(planes.shape[1]):
            for x in range(planes.shape[2]):
                bits = planes[p, y, x]
                if bits == 0:
                    continue
                for k in range(CAMERAS_PER_PLANE):
                    if bits >> k & 1:
                        points = points_px[p * CAMERAS_PER_PLANE + k]
                        best, best_px2 = 0, np.inf
                        for n in range(len(points)):
                            off_px2 = (points[n, 0] - x) ** 2 + (points[n, 1] - y) ** 2
                            if off_px2 < best_px2:
                                best, best_px2 = n, off_px2
                        counts[point_parts[best]] += 1
