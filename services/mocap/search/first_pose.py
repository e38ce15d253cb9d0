"""The first pose of a take, from its first silhouettes: position from the visual hull, heading by trials."""

from dataclasses import dataclass
from itertools import product
from math import pi, radians

import numpy as np

from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.body.skeleton import DOF_INDEX, DOFS, JOINTS, SEGMENTS, SIDES, Dof
from services.mocap.energy.picture import Picture
from services.mocap.search.found import FrameSolution
from services.mocap.search.frame import solve_frame
from services.mocap.search.hull import Hull
from services.mocap.search.jobs import LimbPool, limb_jobs
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import whole_body_energy
from services.mocap.types import Floats

_HEADINGS = 16
_CANDIDATES = 6
"""Number of headings that are searched further."""
_ARMS_DOWN_RAD = (0.0, radians(45), radians(80))
_STRIDES_RAD = (0.0, radians(25), radians(-25))
AMBIGUOUS_SHARE = 0.05
"""Two opposite headings whose energies differ by less are ambiguous."""


@dataclass(frozen=True, eq=False)
class FirstPose:
    """The first pose and how certain it is; energies without the cameras of weight 0."""

    solution: FrameSolution
    opposite_energy_px: float | None
    """Energy of the best pose that faces at least a quarter turn away, if any was tried."""

    @property
    def ambiguous(self) -> bool:
        """Whether the actor may also face the opposite direction."""
        limit = (1.0 + AMBIGUOUS_SHARE) * self.solution.energy_px
        return self.opposite_energy_px is not None and self.opposite_energy_px < limit


def find_first_pose(
    model: Model,
    picture: Picture,
    hull: Hull,
    limbs: LimbPool,
    settings: SearchSettings,
    facing_rad: float | None = None,
) -> FirstPose:
    """Search the first pose of an upright actor; facing_rad restricts the heading to about that angle.

    picture: the whole first frame. settings: as for the frames to come; the search is wider here. Cameras of
    weight 0 are not used.
    """
    weightless = np.flatnonzero(settings.weights(model.rig.n_cameras) == 0)
    picture = picture.without_cameras(weightless.tolist())
    starts = _starts(model, hull, facing_rad)
    energy = whole_body_energy(model, picture.halved(), starts[0], settings.cost, settings.detail_px)
    starts = _best_of_each_heading(starts, energy(starts))[:_CANDIDATES]
    found = [_first_look(model, picture, start, settings, limbs) for start in starts]
    found.sort(key=_energy_px)
    best = solve_frame(model, picture, found[0].pose[None], settings.widened(), limbs)
    if facing_rad is not None:
        return FirstPose(best, None)
    # The opposite direction is searched as thoroughly: from its best start, and from the mirror image of the
    # best pose.
    away = [other.pose for other in found if _turned_away(other.pose, best.pose)][:1]
    opposites = np.array([*away, _turned_round(best.pose)])
    opposite = solve_frame(model, picture, opposites, settings.widened(), limbs)
    if not _turned_away(opposite.pose, best.pose):
        return FirstPose(min(best, opposite, key=_energy_px), None)
    best, opposite = sorted((best, opposite), key=_energy_px)
    return FirstPose(best, opposite.energy_px)


def _energy_px(solution: FrameSolution) -> float:
    return solution.energy_px


def _first_look(
    model: Model, picture: Picture, start: Floats, settings: SearchSettings, limbs: LimbPool
) -> FrameSolution:
    """One pass from a start pose (D,), its limbs searched first, far and wide.

    The hull determines the trunk's position to about 10 cm; limbs in a wrong direction would pull the trunk
    away.
    """
    limbs.start(limb_jobs(model, picture, start, settings.widened()))
    pose = start
    for _, limb in limbs.finish():
        pose = limb.applied_to(pose)
    one_pass = settings.model_copy(update={"max_passes": 1})
    return solve_frame(model, picture, np.stack([start, pose]), one_pass, limbs)


def _turned_round(pose: Floats) -> Floats:
    """The pose (D,) that looks most alike from far away, facing the other way: left is right."""
    turned = pose.copy()
    for name, d in DOF_INDEX.items():
        if name.startswith("left_"):
            other = DOF_INDEX["right_" + name.removeprefix("left_")]
            turned[[d, other]] = pose[[other, d]]
    turned[DOF_INDEX["root_heading"]] += pi
    turned[_OTHER_WAY] *= -1.0
    return clip_to_limits(turned)


def _bends_the_other_way(dof: Dof) -> bool:
    """Whether somebody who looks alike from afar, but faces the other way, has a parameter's opposite.

    Trunk and head lean and pitch in the world as before. Arms and legs, whose left is right, go on pointing
    forward or back as before from shoulder and hip; knees, elbows, hands and feet bend in one way only.
    """
    about_x, _, about_z = dof.axis
    if dof.joint not in _CENTRE_AND_NEXT or dof.role not in ("lean", "pitch", "swing"):
        return False
    return about_x == 0.0 if dof.name.startswith(SIDES) else about_z == 0.0


_CENTRE = {segment.joint for segment in SEGMENTS if segment.side is None}
_CENTRE_AND_NEXT = _CENTRE | {joint.name for joint in JOINTS if joint.parent in _CENTRE}
_OTHER_WAY = [d for d, dof in enumerate(DOFS) if _bends_the_other_way(dof)]


def standing_pose(model: Model, hull: Hull) -> Floats:
    """The T pose (D,) upright on the hull's lowest point, facing along x."""
    pose = np.zeros(N_DOF)
    pose[:2] = hull.axis_world_m
    pose[2] = hull.bottom_m + model.body.pelvis_height_m
    return pose


def _starts(model: Model, hull: Hull, facing_rad: float | None) -> Floats:
    """Standing poses (N, D) on the hull's lowest point: all headings, arm heights and strides."""
    if facing_rad is None:
        headings = np.arange(_HEADINGS) * (2 * pi / _HEADINGS)
    else:
        headings = facing_rad + radians(15) * np.arange(-1, 2)
    poses = []
    for heading, arms_down, stride in product(headings, _ARMS_DOWN_RAD, _STRIDES_RAD):
        pose = standing_pose(model, hull)
        pose[DOF_INDEX["root_heading"]] = heading
        for side, sign in (("left", 1.0), ("right", -1.0)):
            pose[DOF_INDEX[f"{side}_shoulder_elevation"]] = -arms_down
            pose[DOF_INDEX[f"{side}_hip_flexion"]] = sign * stride
            pose[DOF_INDEX[f"{side}_knee_flexion"]] = 0.3 * abs(stride)
        poses.append(pose)
    return np.array(poses)


def _best_of_each_heading(starts: Floats, energies: Floats) -> Floats:
    """The start of least energy for each heading, the best heading first."""
    per_heading = len(_ARMS_DOWN_RAD) * len(_STRIDES_RAD)
    energies = energies.reshape(-1, per_heading)
    best: Floats = starts.reshape(-1, per_heading, N_DOF)[np.arange(len(energies)), energies.argmin(axis=1)]
    return best[np.argsort(energies.min(axis=1), kind="stable")]


def _turned_away(pose: Floats, other: Floats) -> bool:
    heading = DOF_INDEX["root_heading"]
    return bool(np.cos(pose[heading] - other[heading]) < 0.0)
