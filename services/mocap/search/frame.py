"""Solves one frame by the method of the settings."""

import time

import numpy as np

from services.mocap.body.kinematics import clip_to_limits
from services.mocap.body.skeleton import pose_of_body
from services.mocap.energy.picture import Picture
from services.mocap.search.contour_search import solve_by_contours
from services.mocap.search.found import FrameSolution
from services.mocap.search.jobs import LimbPool, LocalLimbs
from services.mocap.search.model import Model
from services.mocap.search.paper_search import solve_by_passes
from services.mocap.search.settings import SearchSettings
from services.mocap.search.usual_differences import UsualDifferences
from services.mocap.types import Floats


def solve_frame(
    model: Model,
    whole: Picture,
    starts: Floats,
    settings: SearchSettings,
    limbs: LimbPool,
    trust: UsualDifferences | None = None,
    other: Floats | None = None,
    *,
    thorough: bool = False,
) -> FrameSolution:
    """Find the pose of one frame, beginning at the best of the start poses (N, D).

    Starts are first moved within the joint limits; parameters that the settings' body lacks become zero, and
    stay so. trust: the memory of previous frames; None for a single frame. other, thorough: as in
    solve_by_contours.
    """
    starts = pose_of_body(clip_to_limits(starts), settings.body)
    if settings.method == "paper":
        return solve_by_passes(model, whole, starts, settings, limbs)
    trust = trust or UsualDifferences(model.rig, settings.doubt_px)
    return solve_by_contours(model, whole, starts, settings, limbs, trust, other, thorough=thorough)


def align_alone(model: Model, picture: Picture, pose: Floats, settings: SearchSettings) -> FrameSolution:
    """Align the body from a pose (D,); frames before and after, and limbs, are not looked at.

    So frames can be aligned at the same time, each with a copy of the model. Time is that of this thread.
    """
    begun_s = time.thread_time()
    solution = solve_frame(model, picture, pose[None], settings.aligned_only(), LocalLimbs(model))
    solution.seconds["torso"] = time.thread_time() - begun_s
    return solution


def extrapolated(poses: list[Floats]) -> Floats:
    """Start poses (N, D) for a frame from those of the frames before it, the latest last.

    The last pose, its linear extrapolation, and the pose half-way between.
    """
    last = poses[-1]
    if len(poses) < 2:
        return last[None]
    move = last - poses[-2]
    return np.stack([last, last + move, last + 0.5 * move])
