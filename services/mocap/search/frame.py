"""Solves one frame by the method of the settings.

The paper's search is here: passes of torso, limbs and head until the energy stops falling.
"""

import numpy as np

from services.mocap.body.kinematics import clip_to_limits
from services.mocap.body.skeleton import pose_of_body
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import HEAD, TORSO
from services.mocap.search.contour_search import solve_by_contours
from services.mocap.search.error_by_part import error_by_part
from services.mocap.search.found import Clock, FrameSolution
from services.mocap.search.jobs import LimbPool, limb_jobs
from services.mocap.search.model import Model
from services.mocap.search.part_confidence import PartConfidence
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import descend_stage, whole_body_energy
from services.mocap.types import Floats


def solve_frame(
    model: Model,
    whole: Picture,
    starts: Floats,
    settings: SearchSettings,
    limbs: LimbPool,
    trust: PartConfidence | None = None,
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
        return _solve_by_passes(model, whole, starts, settings, limbs)
    trust = trust or PartConfidence(model.rig, settings.doubt_px)
    return solve_by_contours(model, whole, starts, settings, limbs, trust, other, thorough=thorough)


def extrapolated(poses: list[Floats]) -> Floats:
    """Start poses (N, D) for a frame from those of the frames before it, the latest last.

    The last pose, its linear extrapolation, and the pose half-way between.
    """
    last = poses[-1]
    if len(poses) < 2:
        return last[None]
    move = last - poses[-2]
    return np.stack([last, last + move, last + 0.5 * move])


def _solve_by_passes(
    model: Model, whole: Picture, starts: Floats, settings: SearchSettings, limbs: LimbPool
) -> FrameSolution:
    """Find the pose of one frame, beginning at the best of the start poses (N, D) within the limits.

    The paper, section 3: torso, then every limb with its hand or foot and the head, repeated until converged.
    The result is the best pose seen at the end of a pass, by the cost and the level of detail of the search;
    starts count as seen.
    """
    energy = whole_body_energy(model, whole, settings)
    energies = energy(starts)
    best = FrameSolution(
        starts[int(energies.argmin())].copy(), float(energies.min()), evaluations=len(starts)
    )
    # The paper, section 4.2: the torso is searched in whole pictures at half resolution.
    coarse, pose = whole.halved() if settings.windows else whole, best.pose
    for _ in range(settings.max_passes):
        before = best.energy_px
        pose = _one_pass(model, whole, coarse, pose, settings, limbs, best)
        energy_px = float(energy(pose[None])[0])
        best.passes, best.evaluations = best.passes + 1, best.evaluations + 1
        if energy_px < best.energy_px:
            best.pose, best.energy_px = pose, energy_px
        if before - energy_px <= settings.pass_tolerance * before:
            break
    best.note_shares(error_by_part(model, whole, best.pose))
    return best


def _one_pass(
    model: Model,
    whole: Picture,
    coarse: Picture,
    pose: Floats,
    settings: SearchSettings,
    limbs: LimbPool,
    account: FrameSolution,
) -> Floats:
    """Torso, then limbs and head at the same time; returns the new pose and notes times and evaluations."""
    clock = Clock(account.seconds)
    torso = descend_stage(model, TORSO.of(settings.body), coarse, pose, settings)
    pose = torso.applied_to(pose)
    clock.book("torso")
    limbs.start(limb_jobs(model, whole, pose, settings))
    head = descend_stage(model, HEAD.of(settings.body), whole, pose, settings)
    pose = head.applied_to(pose)
    clock.book("head")
    account.evaluations += torso.evaluations + head.evaluations
    for name, limb in limbs.finish():
        pose = limb.applied_to(pose)
        account.note_limb(name, limb)
    clock.book("limbs")
    return pose
