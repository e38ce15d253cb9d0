"""The first pose of a take, from its first silhouettes: position from the visual hull, the rest by trials."""

from dataclasses import dataclass
from math import pi, radians

import numpy as np

from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.body.skeleton import DOF_INDEX, DOFS, JOINTS, SEGMENTS, SIDES, BodyName, Dof, pose_of_body
from services.mocap.energy.picture import Picture
from services.mocap.search.found import BY_ENERGY, FrameSolution
from services.mocap.search.frame import solve_frame
from services.mocap.search.hull import Hull
from services.mocap.search.jobs import LimbPool, limb_jobs
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import whole_body_energy
from services.mocap.search.typical_poses import first_apart, typical_poses
from services.mocap.types import Floats

_HEADINGS = 16
_MOST_ALIGNED, _MOST_SEARCHED, _MOST_SEARCHED_OF_HEADING = 32, 6, 3
"""Number of starts that are aligned, and of their results that are searched further; fewer with a known
heading."""
AMBIGUOUS_SHARE = 0.05
"""Two opposite headings whose energies differ by less are ambiguous."""


@dataclass(frozen=True, eq=False)
class FirstPose:
    """The first pose and how certain it is; energies without the cameras of weight 0."""

    solution: FrameSolution
    opposite: FrameSolution | None = None
    """The best that faces at least a quarter turn away, if any was tried."""

    @property
    def ambiguous(self) -> bool:
        """Whether the actor may also face the opposite direction."""
        limit = (1.0 + AMBIGUOUS_SHARE) * self.solution.energy_px
        return self.opposite is not None and self.opposite.energy_px < limit


def find_first_pose(
    model: Model,
    picture: Picture,
    hull: Hull,
    limbs: LimbPool,
    settings: SearchSettings,
    facing_rad: float | None = None,
) -> FirstPose:
    """Search the first pose of an actor; facing_rad restricts the heading to about that angle.

    Starts are typical poses in all headings, about the hull's middle. The best are aligned with the contours,
    and the best results that differ are searched. picture: the whole first frame. settings: as for the frames
    to come; the search is wider here. Cameras of weight 0 are not used.
    """
    weightless = np.flatnonzero(settings.cost.weights(model.rig.n_cameras) == 0)
    picture = picture.without_cameras(weightless.tolist())
    starts = _promising(model, picture, _starts(model, hull, settings.body, facing_rad), settings)
    n_searched = _MOST_SEARCHED if facing_rad is None else _MOST_SEARCHED_OF_HEADING
    starts = first_apart(_aligned(model, picture, starts, settings), n_searched, model.body.offsets_m)
    found = [_first_look(model, picture, start, settings, limbs) for start in starts]
    found.sort(key=BY_ENERGY)
    best = solve_frame(model, picture, found[0].pose[None], settings.widened(), limbs)
    if facing_rad is not None:
        return FirstPose(best)
    # The opposite direction is searched as thoroughly: from its best start, and from the mirror image of the
    # best pose.
    away = [other.pose for other in found if _turned_away(other.pose, best.pose)][:1]
    opposites = np.array([*away, turned_round(best.pose)])
    opposite = solve_frame(model, picture, opposites, settings.widened(), limbs)
    if not _turned_away(opposite.pose, best.pose):
        return FirstPose(min(best, opposite, key=BY_ENERGY))
    best, opposite = sorted((best, opposite), key=BY_ENERGY)
    return FirstPose(best, opposite)


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


def turned_round(pose: Floats) -> Floats:
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


def _starts(model: Model, hull: Hull, body: BodyName, facing_rad: float | None) -> Floats:
    """Typical poses about the hull's middle in all headings: (P, H, D) of P poses and H headings."""
    if facing_rad is None:
        headings_rad = np.arange(_HEADINGS) * (2 * pi / _HEADINGS)
    else:
        headings_rad = facing_rad + radians(15) * np.arange(-1, 2)
    poses = pose_of_body(typical_poses(), body)
    starts = np.repeat(poses[:, None], len(headings_rad), axis=1)
    starts[:, :, DOF_INDEX["root_heading"]] = headings_rad
    every = clip_to_limits(starts.reshape(-1, N_DOF))
    every[:, :3] += hull.middle_world_m - model.body.middles_m(every)
    return every.reshape(starts.shape)


def _promising(model: Model, picture: Picture, starts: Floats, settings: SearchSettings) -> Floats:
    """The best start of each pose and of each heading (N, D), the best first; starts (P, H, D)."""
    energy = whole_body_energy(model, picture.halved(), settings)
    energies = energy(starts.reshape(-1, N_DOF)).reshape(starts.shape[:2])
    of_poses = set(enumerate(energies.argmin(axis=1).tolist()))
    of_headings = {(p, h) for h, p in enumerate(energies.argmin(axis=0).tolist())}
    best = sorted(of_poses | of_headings, key=lambda at: (energies[at], at))
    return np.array([starts[at] for at in best[:_MOST_ALIGNED]])


def _aligned(model: Model, picture: Picture, starts: Floats, settings: SearchSettings) -> Floats:
    """Starts (N, D), each aligned twice with a picture, the best first."""

    def aligned(copy: Model, pose: Floats) -> Floats:
        for _ in range(2):
            pose = copy.aligner(settings).align(picture, pose, settings).pose
        return pose

    model.aligner(settings)  # thins the meshes, which the copies then read
    poses = np.array(list(model.copies.each(aligned, starts)))
    energies = whole_body_energy(model, picture, settings)(poses)
    return np.asarray(poses[np.argsort(energies, kind="stable")])


def _turned_away(pose: Floats, other: Floats) -> bool:
    heading = DOF_INDEX["root_heading"]
    return bool(np.cos(pose[heading] - other[heading]) < 0.0)
