"""Extrinsics from a person who was tracked: which cameras are not where their calibration says, and where
they are.

This is Gauss-Newton over the extrinsics of these cameras and the poses of some frames, by contours of a known
body. Camera c is moved by a rigid motion M_c of the world before it: T_camera_world M_c. What it then sees is
what it would see of a body that moves so, root and all. So the slopes of a residual by M_c follow from those
by the root's parameters:

    rows_root (N, 6) = rows_motion (N, 6) twists (6, 6)

where twists has the velocity of the world for each parameter of the root in a column.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, joint_transforms
from services.mocap.body.shape_space import vector_of
from services.mocap.calibration.rigid_transform import IDENTITY, RigidTransform, in_world
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.fit.contours import contours_of
from services.mocap.fit.jacobian import ShapeSlopes, jacobian
from services.mocap.fit.least_squares import CONTOUR_POINTS, mean_of_last
from services.mocap.fit.normal_equations import ALL_DOFS, FitStage, State, System, normal_sums
from services.mocap.fit.priors import Prior
from services.mocap.fit.quality import FitQuality, quality_of
from services.mocap.fit.rim_matching import Matches, match_frames
from services.mocap.search.alignment.twists import TWIST_SIZE, place_twists
from services.mocap.types import Floats, Mask

OFF_PX = 0.5
"""A camera that sees the body so many working pixels beside its silhouettes does not stand where its
calibration says. Of 33 right calibrations, 32 have at most .37; one with furniture
before a camera has .88. A camera that is turned by .3 degrees has 1.5."""
_OF_LARGEST = 0.5
"""Cameras that are off by less than this share of the largest offset may be so because of that one: it pulls
the poses."""
_LEAST_GAIN = 0.01
"""Share of the energy in frames that were kept out by which they must get better."""
_STAGES = (
    FitStage((), ALL_DOFS, 15.0, 6, damping=0.003),
    FitStage((), ALL_DOFS, 4.0, 6, damping=0.003),
    FitStage((), ALL_DOFS, 1.5, 6, damping=0.003),
    FitStage((), ALL_DOFS, 0.8, 8, damping=0.003, is_strict=True),
)
"""From coarse to fine; the first finds a camera that sees the body a limb's width off."""
_FEWEST_HELD = 2
"""One camera agrees with itself wherever it stands."""
_RIDGE = 1e-6
"""Holds a camera that does not see the actor at all."""


@dataclass(frozen=True, eq=False)
class Refined:
    """Cameras with new extrinsics, judged in frames that were not used for them."""

    cameras: tuple[Camera, ...]
    held: Mask
    """(C,) the cameras that did not move. If there is none, their mean was held."""
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

    Lenses and body are held, and the cameras that see the body where its silhouettes are (offsets_px), which
    hold the world; if these are one or less than half, the cameras' mean does. Those that are farthest off
    move first. Every second frame is kept out; in these, poses alone are fitted before and after. progress is
    called with 0 to 1.
    """
    used, kept_out = (np.arange(first, len(seen), 2, dtype=np.int32) for first in (0, 1))
    n_cameras = len(cameras)

    def quality(of: tuple[Camera, ...], begun: float) -> FitQuality:
        adjustment = _BodyAdjustment(Rig.of(of), seen[kept_out], actor, poses[kept_out])
        _, fitted = adjustment.solve(np.zeros(n_cameras, bool), lambda share: progress(begun + share / 4))
        return quality_of(build_body(actor), fitted, Rig.of(of), seen[kept_out])

    def progress_of_round(n_moved_before: int, share: float) -> None:
        progress((1.0 + 2.0 * (n_moved_before + share) / n_cameras) / 4)

    before = quality(cameras, 0.0)
    adjustment = _BodyAdjustment(Rig.of(cameras), seen[used], actor, poses[used])
    moves, motions, fitted = np.zeros(n_cameras, bool), np.zeros((n_cameras, TWIST_SIZE)), poses[used]
    while not moves.all():
        offsets = adjustment.offsets_px(motions, fitted)
        are_off = ~moves & (offsets >= max(OFF_PX, _OF_LARGEST * offsets.max()))
        if not are_off.any():
            break
        done, moves = int(np.count_nonzero(moves)), moves | are_off
        motions, fitted = adjustment.solve(moves, partial(progress_of_round, done))
    if not moves.any():
        return Refined(cameras, ~moves, before, before)
    if np.count_nonzero(~moves) < max(_FEWEST_HELD, n_cameras / 2):
        moves = np.ones(n_cameras, bool)
        motions, _ = adjustment.solve(moves)
    # What moves all cameras together: nothing if some are held, else their mean motion back.
    gauge = _motion_of(motions.mean(axis=0)).inverse if moves.all() else IDENTITY
    found = tuple(
        in_world(camera, _motion_of(motion) @ gauge) if is_moved else camera
        for camera, motion, is_moved in zip(cameras, motions, moves, strict=True)
    )
    return Refined(found, ~moves, before, quality(found, 0.75))


def offsets_px(cameras: tuple[Camera, ...], seen: TriPlanes, actor: Actor, poses: Floats) -> Floats:
    """(C,) how far each camera sees an actor in poses (F, D) beside the silhouettes (F, P, H, W), in working
    pixels."""
    adjustment = _BodyAdjustment(Rig.of(cameras), seen, actor, poses)
    return adjustment.offsets_px(np.zeros((len(cameras), TWIST_SIZE)), poses)


def _motion_of(x: Floats) -> RigidTransform:
    """The rigid motion of a rotation vector and a translation in metres, x (6,)."""
    return RigidTransform(Rotation.from_rotvec(x[:3]).as_matrix(), x[3:])


class _BodyAdjustment:
    """The least-squares problem of F frames before C cameras; the body and the lenses are held."""

    def __init__(self, rig: Rig, seen: TriPlanes, actor: Actor, poses: Floats) -> None:
        """seen (F, P, H, W), poses (F, D): those begun with."""
        self._rig, self._contours = rig, contours_of(rig, seen, CONTOUR_POINTS)
        self._shape, self._poses = vector_of(actor), poses
        self._slopes = ShapeSlopes.at(self._shape, (), actor)
        self._prior = Prior(poses)

    def solve(self, free: Mask, progress: Callable[[float], None] = lambda _: None) -> tuple[Floats, Floats]:
        """Move those of the cameras (C,) that are free, and all poses; progress is called with 0 to 1.

        Returns the motions (C, 6), see _motion_of, and the poses (F, D). If all cameras are free, the world
        stays only about where it was.
        """
        parameters = tuple(np.flatnonzero(np.repeat(free, TWIST_SIZE)).tolist())
        steps = [replace(stage, parameters=parameters) for stage in _STAGES for _ in range(stage.steps)]
        trail = [State(np.zeros(TWIST_SIZE * len(free)), self._poses)]
        for n, stage in enumerate(steps):
            trail.append(self._linearised(trail[-1], stage).step(trail[-1], stage, bounds=lambda x: x))
            progress((n + 1) / len(steps))
        mean = mean_of_last(trail)
        return mean.x.reshape(-1, TWIST_SIZE), mean.poses

    def offsets_px(self, motions: Floats, poses: Floats) -> Floats:
        """(C,) how far each camera sees the body in poses (F, D) beside the silhouettes, with motions (C, 6)
        before the cameras: the shift t of all its pictures that leaves least of the residuals r along the
        normals n,

            sum w (r - n t)^2
        """
        rig = self._moved(motions)
        matched = match_frames(self._slopes.body, poses, rig, self._contours)
        offsets = np.zeros(rig.n_cameras)
        for c, views in enumerate(zip(*matched, strict=True)):
            normals = np.concatenate([view.normals for view in views]) * rig.scales[c]
            residuals_px = np.concatenate([view.residuals_px for view in views])
            lengths_px = np.concatenate([view.lengths_px for view in views])
            weighted = (lengths_px * _STAGES[1].weights(residuals_px))[:, None] * normals
            shift_px = np.linalg.solve(normals.T @ weighted + _RIDGE * np.eye(2), weighted.T @ residuals_px)
            offsets[c] = np.linalg.norm(shift_px)
        return offsets

    def _moved(self, motions: Floats) -> Rig:
        matrices = np.array([_motion_of(motion).matrix for motion in motions])
        return replace(self._rig, P_px_world=self._rig.P_px_world @ matrices)

    def _linearised(self, state: State, stage: FitStage) -> System:
        rig = self._moved(state.x.reshape(-1, TWIST_SIZE))
        n_frames, s = len(state.poses), len(stage.parameters)
        of_poses, n_views = replace(stage, parameters=()), n_frames * rig.n_cameras
        system = replace(
            self._prior.system(State(self._shape, state.poses), of_poses, n_views),
            cross=np.zeros((n_frames, len(stage.dofs), s)),
            shape=_RIDGE * np.eye(s),
            shape_slopes=np.zeros(s),
        )
        columns = np.array([*stage.dofs, *(N_DOF + p for p in stage.parameters)])
        matched = match_frames(self._slopes.body, state.poses, rig, self._contours)
        for f, (pose, views) in enumerate(zip(state.poses, matched, strict=True)):
            rows = self._rows(pose, rig, views)[:, columns]
            residuals_px = np.concatenate([view.residuals_px for view in views])
            weights = np.concatenate([view.lengths_px for view in views]) * stage.weights(residuals_px)
            system.add_frame(f, *normal_sums(rows, residuals_px, weights))
        return system

    def _rows(self, pose: Floats, rig: Rig, views: list[Matches]) -> Floats:
        """(N, D + 6 C) slopes of a frame's residuals by the pose and by the motion before each camera."""
        by_pose = jacobian(self._slopes, pose, rig, views)
        twists = np.zeros((N_DOF, TWIST_SIZE))
        place_twists(pose, joint_transforms(pose[None], self._slopes.body.offsets_m)[0], twists)
        by_motion = by_pose[:, :TWIST_SIZE] @ np.linalg.pinv(twists[:TWIST_SIZE].T)
        camera = np.repeat(np.arange(len(views)), [len(view.edges) for view in views])
        is_its = camera[:, None] == np.arange(len(views))
        of_cameras = (is_its[:, :, None] * by_motion[:, None, :]).reshape(
            len(by_pose), TWIST_SIZE * len(views)
        )
        return np.hstack([by_pose, of_cameras])
