"""The first pose of a take, from its first silhouettes: place by the visual hull, heading by trial."""

from dataclasses import dataclass
from itertools import product
from math import pi, radians

import numpy as np

from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.energy.picture import Picture
from services.mocap.search.frame import FrameSolution, LimbPool, solve_frame
from services.mocap.search.hull import Hull
from services.mocap.search.settings import SearchSettings
from services.mocap.search.solve import Model, whole_body_energy
from services.mocap.types import Floats

_HEADINGS = 16
_CANDIDATES = 5
"""Headings that are searched further."""
_ARMS_DOWN_RAD = (0.0, radians(45), radians(80))
_STRIDES_RAD = (0.0, radians(25), radians(-25))
AMBIGUOUS_SHARE = 0.05
"""Two opposite headings whose energies differ by less are called ambiguous."""


@dataclass(frozen=True, eq=False)
class FirstPose:
    """What was found, and how clearly."""

    solution: FrameSolution
    opposite_energy_px: float | None
    """Energy of the best pose that faces at least a quarter turn away, if any was tried."""

    @property
    def ambiguous(self) -> bool:
        """Whether the actor may as well face the other way."""
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
    """Search the first pose of an upright actor; facing_rad narrows the heading to about that angle.

    picture: the whole first frame. settings: as for the frames to come; the search is wider here.
    """
    starts = _starts(model, hull, facing_rad)
    energy = whole_body_energy(model, picture.halved(), starts[0], settings.cost, settings.detail_px)
    starts = _best_of_each_heading(starts, energy(starts))[:_CANDIDATES]
    # Pass numbers tell the candidates' limb tasks apart.
    first_look = settings.widened().model_copy(update={"max_passes": 1})
    found = [
        solve_frame(model, picture, start[None], first_look, limbs, first_pass=100 * k)
        for k, start in enumerate(starts)
    ]
    found.sort(key=lambda solution: solution.energy_px)
    opposite = next((other for other in found[1:] if _turned_away(other.pose, found[0].pose)), None)
    finalists = [found[0]] if opposite is None else [found[0], opposite]
    finished = [
        solve_frame(model, picture, finalist.pose[None], settings.widened(), limbs, first_pass=1000 * (k + 1))
        for k, finalist in enumerate(finalists)
    ]
    finished.sort(key=lambda solution: solution.energy_px)
    return FirstPose(finished[0], finished[1].energy_px if len(finished) > 1 else None)


def standing_pose(model: Model, hull: Hull) -> Floats:
    """The T pose (35,) upright on the hull's lowest point, facing along x."""
    pose = np.zeros(N_DOF)
    pose[:2] = hull.axis_world_m
    pose[2] = hull.bottom_m + model.body.pelvis_height_m
    return pose


def _starts(model: Model, hull: Hull, facing_rad: float | None) -> Floats:
    """Standing poses (N, 35) on the hull's lowest point: all headings, arm heights and strides."""
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
