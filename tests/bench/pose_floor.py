"""The floor of the errors: how exact the best pose of a run's body is, and how often the search misses it.

The best pose is found from the true joints, and then aligned with the silhouettes. What it is off by is due
to the body and the silhouettes; where its energy is clearly lower than that of the tracked pose, the search
failed.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from bench.limb_scores import Errors, errors_of
from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX, DOFS, LOWER, UPPER
from services.mocap.camera.rig import Rig
from services.mocap.energy.picture import Picture
from services.mocap.search.model import Model, model_on_cpu
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import whole_body_energy
from services.mocap.take.folder import Take
from services.mocap.take.tables import REFERENCE_JOINTS, reference_joints
from services.mocap.types import Floats
from services.runs.take_silhouettes import seen_of
from services.segmentation.segmenters import make_segmenter

FAILED = 1.05
"""The search failed where the tracked pose has more than this times the energy of the best one."""
_PULL_M = np.array([0.0 if dof.role in ("translation", "heading", "lean", "pitch") else 0.02 for dof in DOFS])
"""(D,) how far off all joints may be together for one radian less from the rest pose."""
_STEP = 1e-6
_INSIDE = 1e-9
"""A start has to lie within the limits, not on them."""


@dataclass(frozen=True)
class Floor:
    """The best poses of some frames."""

    frames: int
    errors: Errors
    tracked_errors: Errors
    """Of the tracked poses, unsmoothed, in the same frames."""
    failures_percent: float
    """Frames in which the search failed."""


def floor_of(take: Take, actor: Actor, frames: list[int], tracked: Floats, true_m: Floats) -> Floor:
    """The floor in some frames of a take.

    tracked: (F, D) poses; true_m: (F, 15, 3) joints in the z-up world. Raises TakeError where fit_take does.
    """
    made = make_segmenter(take, take.cameras)
    cameras, seen = seen_of(take, frames, made, lambda _: None)
    body, rig = build_body(actor), Rig.of(cameras)
    best = true_poses(true_m, body)
    energies_px = np.zeros((2, len(frames)))
    with model_on_cpu(actor, rig) as model:
        for f in range(len(frames)):
            picture = Picture.whole(rig, seen[f].silhouettes, seen[f].unsure)
            best[f] = aligned(model, picture, best[f])
            energies_px[:, f] = _energies_px(model, picture, np.stack([tracked[f], best[f]]))
    joints_mm = [1000.0 * reference_joints(poses, body.offsets_m) for poses in (best, tracked)]
    return Floor(
        frames=len(frames),
        errors=errors_of(joints_mm[0], 1000.0 * true_m),
        tracked_errors=errors_of(joints_mm[1], 1000.0 * true_m),
        failures_percent=100.0 * float((energies_px[0] > FAILED * energies_px[1]).mean()),
    )


def true_poses(joints_m: Floats, body: Body) -> Floats:
    """Poses (F, D) with joints nearest to true ones (F, 15, 3), started upright and from the one before."""
    poses: list[Floats] = []
    for of_frame in joints_m:
        found = [_nearest(of_frame, body, start) for start in (_upright(of_frame), *poses[-1:])]
        poses.append(min(found, key=lambda each: each[0])[1])
    return np.array(poses)


def _nearest(joints_m: Floats, body: Body, start: Floats) -> tuple[float, Floats]:
    """The cost and the pose (D,) nearest to joints (15, 3), with a weak pull to the rest pose."""

    def residuals(poses: Floats) -> Floats:
        """(N, 45 + D) of poses (N, D)."""
        off_m = reference_joints(poses, body.offsets_m) - joints_m
        return np.hstack([off_m.reshape(len(poses), -1), _PULL_M * poses])

    def jacobian(pose: Floats) -> Floats:
        near = residuals(np.vstack([pose, pose + _STEP * np.eye(N_DOF)]))
        return np.asarray((near[1:] - near[0]).T / _STEP)

    inside = np.clip(start, LOWER + _INSIDE, UPPER - _INSIDE)
    found = least_squares(lambda pose: residuals(pose[None])[0], inside, jacobian, bounds=(LOWER, UPPER))
    return float(found.cost), np.asarray(found.x, np.float64)


def _upright(joints_m: Floats) -> Floats:
    """A pose (D,) upright where the pelvis is, that faces as the hips do; joints (15, 3)."""
    pelvis, left, right = (
        joints_m[REFERENCE_JOINTS.index(name)] for name in ("pelvis", "left_hip", "right_hip")
    )
    pose = np.zeros(N_DOF)
    pose[[DOF_INDEX[f"root_{axis}"] for axis in "xyz"]] = pelvis
    across_m = left - right
    pose[DOF_INDEX["root_heading"]] = np.arctan2(-across_m[0], across_m[1])
    return pose


def aligned(model: Model, picture: Picture, start: Floats) -> Floats:
    """The pose (D,) of the least energy among alignments with a picture, each from the one before."""
    settings = SearchSettings()
    poses = [start]
    for _ in range(settings.max_passes):
        poses.append(model.aligner(settings).align(picture, poses[-1], settings).pose)
    return poses[1 + int(np.argmin(_energies_px(model, picture, np.array(poses[1:]))))]


def _energies_px(model: Model, picture: Picture, poses: Floats) -> Floats:
    """(N,) differing pixels of poses (N, D), with the full mesh."""
    return whole_body_energy(model, picture, SearchSettings(detail_px=0.0))(poses)
