"""Extrinsics from a person who was tracked: which cameras are not where their calibration says, and where
they are."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import repeat

import numpy as np

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import joint_positions
from services.mocap.calibration.body_adjustment import BodyAdjustment, motion_of
from services.mocap.calibration.rigid_transform import IDENTITY, RigidTransform
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.fit.contours import working_scales
from services.mocap.fit.quality import FitQuality, quality_of
from services.mocap.types import Floats, Mask

HARDLY_PX = 0.7
"""A camera hardly moves if it sees the body's joints move by less, in working pixels: 1 cm in most rooms."""
_LEAST_GAIN = 0.01
"""Share of the energy in frames that were kept out by which they must get better."""


@dataclass(frozen=True, eq=False)
class Refined:
    """Cameras with new extrinsics, judged in frames that were not used for them."""

    cameras: tuple[Camera, ...]
    held: Mask
    """(C,) the cameras that hardly moved in the first estimate. If there is none, their mean was held."""
    before: FitQuality
    after: FitQuality

    @property
    def is_better(self) -> bool:
        """Whether the body fits the frames that were kept out better than before."""
        return bool(self.after.energy_px.sum() < (1.0 - _LEAST_GAIN) * self.before.energy_px.sum())


def refine_cameras(
    cameras: tuple[Camera, ...],
    seen: TriPlanes,
    actor: Actor,
    poses: Floats,
    progress: Callable[[float], None] = lambda _: None,
) -> Refined:
    """Move cameras so that an actor fits undistorted silhouettes (F, P, H, W), from poses (F, D) nearby.

    Lenses and body are held, and so is the world: by the cameras that a first estimate hardly moves against
    the median, else by the mean. Every second frame is kept out; in these, poses alone are fitted before and
    after. progress is called with 0 to 1.
    """
    used, kept_out = (np.arange(first, len(seen), 2, dtype=np.int32) for first in (0, 1))

    def quarter(n: int) -> Callable[[float], None]:
        return lambda share: progress((n + share) / 4)

    def quality(of: tuple[Camera, ...], n: int) -> FitQuality:
        rig, none = Rig.of(of), np.zeros(len(of), bool)
        _, fitted = BodyAdjustment(rig, seen[kept_out], actor, poses[kept_out]).solve(none, quarter(n))
        return quality_of(build_body(actor), fitted, rig, seen[kept_out])

    before = quality(cameras, 0)
    adjustment = BodyAdjustment(Rig.of(cameras), seen[used], actor, poses[used])
    motions, _ = adjustment.solve(np.ones(len(cameras), bool), quarter(1))
    joints_m = joint_positions(poses[used], build_body(actor).offsets_m).reshape(-1, 3)
    held: Mask = ~(moves_px(cameras, motions, joints_m) >= HARDLY_PX)
    if held.all():
        return Refined(cameras, held, before, before)
    if held.any():
        motions, _ = adjustment.solve(~held, quarter(2))
    found = tuple(map(_moved, cameras, motions, held, repeat(_gauge(motions, held))))
    return Refined(found, held, before, quality(found, 3))


def _gauge(motions: Floats, held: Mask) -> RigidTransform:
    """What moves all cameras together: nothing if some are held, else their mean motion (C, 6) back."""
    return IDENTITY if held.any() else motion_of(motions.mean(axis=0)).inverse


def _moved(camera: Camera, motion: Floats, is_held: bool, gauge: RigidTransform) -> Camera:
    if is_held:
        return camera
    T_camera_world = RigidTransform(camera.R_camera_world, camera.t_camera_world_m)
    T_camera_world = T_camera_world @ motion_of(motion) @ gauge
    return replace(camera, R_camera_world=T_camera_world.R, t_camera_world_m=T_camera_world.t_m)


def moves_px(cameras: tuple[Camera, ...], motions: Floats, points_m: Floats) -> Floats:
    """(C,) how far the motions (C, 6) of the world before the cameras move points (N, 3) in their pictures.

    Median over the points, in working pixels, without what the median of the cameras does to a point: poses
    that all cameras follow.
    """
    moved_m = np.array([motion_of(motion).apply(points_m) for motion in motions])
    off_m = moved_m - np.median(moved_m, axis=0)
    off_px = [
        np.linalg.norm(camera.project_px(points_m + by_m) - camera.project_px(points_m), axis=1)
        for camera, by_m in zip(cameras, off_m, strict=True)
    ]
    found: Floats = np.nanmedian(off_px, axis=1) / working_scales(Rig.of(cameras))
    return found
