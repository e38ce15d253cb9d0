"""Solving one chain of one frame: torso, head, or a limb with its hand or foot."""

from dataclasses import dataclass

import numpy as np

from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.body.skeleton import DOFS
from services.mocap.energy.backend import Energy, Problem
from services.mocap.energy.cost import Cost
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import (
    ALL_SEGMENTS,
    HEAD,
    LIMBS,
    TORSO,
    Limb,
    LimbName,
    Stage,
    window_origins_px,
    window_size_px,
)
from services.mocap.search.descent import Box, Minimum, descend
from services.mocap.search.grid import Tried, best_of, grid_points
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Floats

_STARTS = 4
"""Points of a grid from which a limb is aligned with the contours."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A chain's parameter values and what they cost."""

    dofs: tuple[int, ...]
    values: Floats
    """(d,)"""
    energy_px: float
    evaluations: int
    seconds: float = 0.0
    """What finding them took, where somebody looked at the clock."""

    def applied_to(self, pose: Floats) -> Floats:
        """The pose (35,) with this chain's parameters replaced."""
        changed = pose.copy()
        changed[list(self.dofs)] = self.values
        return changed


def whole_body_energy(model: Model, picture: Picture, pose: Floats, cost: Cost, detail_px: float) -> Energy:
    """The energy of all parameters with the whole body drawn; pose (35,) is any; the rest as in Problem."""
    problem = Problem(pose, tuple(range(N_DOF)), ALL_SEGMENTS, cost.priced(picture), cost, detail_px)
    return model.backend.energy(problem)


def solve_torso(model: Model, coarse: Picture, pose: Floats, settings: SearchSettings) -> Solution:
    """Find the root from a pose by going downhill, the whole body moving with it.

    coarse: whole pictures, at half resolution in the paper (section 4.2).
    """
    return _descend_stage(model, TORSO, coarse, pose, settings)


def solve_head(model: Model, whole: Picture, pose: Floats, settings: SearchSettings) -> Solution:
    """Find the head's turn by going downhill in its window."""
    return _descend_stage(model, HEAD, _looked_at(model, HEAD, whole, pose, settings), pose, settings)


def stage_window(model: Model, stage: Stage, picture: Picture, pose: Floats, margin_px: int = 0) -> Picture:
    """Cut the windows of a stage out of a picture, centred on where the pose (35,) has its segments.

    margin_px: how much larger they are on all sides.
    """
    size_px = window_size_px(stage, model.rig) + 2 * margin_px
    origins_px = window_origins_px(stage, pose, model.body, model.rig) - np.int32(margin_px)
    return picture.window(origins_px, size_px, size_px)


def _looked_at(
    model: Model, stage: Stage, picture: Picture, pose: Floats, settings: SearchSettings
) -> Picture:
    return stage_window(model, stage, picture, pose) if settings.windows else picture


def limb_picture(
    model: Model, name: LimbName, whole: Picture, pose: Floats, settings: SearchSettings
) -> Picture:
    """What of a whole picture a limb's search needs to see: windows, and the cost's margin around them."""
    if not settings.windows:
        return whole
    return stage_window(model, LIMBS[name].main, whole, pose, settings.cost.margin_px)


def _without_margin(window: Picture, settings: SearchSettings) -> Picture:
    margin_px = settings.cost.margin_px if settings.windows else 0
    region = window.region
    width_px, height_px = region.width_px - 2 * margin_px, region.height_px - 2 * margin_px
    return window.window(region.origin_px + np.int32(margin_px), width_px, height_px)


def solve_limb(
    model: Model,
    name: LimbName,
    seen: Picture,
    pose: Floats,
    settings: SearchSettings,
    shard: tuple[int, int] = (0, 1),
) -> Solution:
    """Find a limb: grid search over ball and hinge, then downhill by the settings' method.

    seen: what limb_picture cut out, nothing pre-rendered. shard (k, n): search the start and only every n-th
    grid point, from the k-th on, so that n workers share a limb and none returns worse than the start. A pose
    beyond the joint limits is moved to them first.
    """
    limb, pose = LIMBS[name], clip_to_limits(pose)
    seen = _without_margin(settings.cost.priced(seen), settings)
    energy, start, box = _prepare(model, limb.main, seen, pose, settings)
    points = grid_points(start, _grid_counts(limb, settings), _grid_steps(limb.main, settings), box)
    k, n = shard
    points = np.concatenate([points[:1], points[1:][k::n]])
    if settings.method == "contours":
        return _align_limb(model, limb, seen, pose, settings, Tried(points, energy(points)))
    return _descend_limb(model, limb, seen, pose, settings, best_of(energy, points))


def _descend_limb(
    model: Model, limb: Limb, seen: Picture, pose: Floats, settings: SearchSettings, best: Minimum
) -> Solution:
    """From the best point of the grid downhill on XOR, then the hand or foot (the paper, section 3)."""
    energy, _, box = _prepare(model, limb.main, seen, pose, settings)
    main = _solution(limb.main, _descend(energy, best, box, _axes(limb.main, settings), settings))
    found = main.applied_to(pose)
    window = _looked_at(model, limb.extremity, seen, found, settings)
    extremity = _descend_stage(model, limb.extremity, window, found, settings)
    return Solution(
        limb.dofs,
        np.concatenate([main.values, extremity.values]),
        main.energy_px,
        main.evaluations + extremity.evaluations,
    )


def _align_limb(
    model: Model, limb: Limb, seen: Picture, pose: Floats, settings: SearchSettings, tried: Tried
) -> Solution:
    """From the best points of the grid that are no neighbours along the contours; the best by XOR."""
    whole_limb = Stage(limb.dofs, limb.main.segments, limb.main.window_px)
    energy, start, _ = _prepare(model, whole_limb, seen, pose, settings)
    aligner = model.aligner(settings)
    candidates = [start]
    for point in tried.best_apart(_STARTS, 1.5 * _grid_steps(limb.main, settings)):
        begun = pose.copy()
        begun[list(limb.main.dofs)] = point
        aligned = aligner.align(seen, begun, settings, limb.dofs, limb.main.segments)
        candidates += [begun[list(limb.dofs)], aligned.pose[list(limb.dofs)]]
    found = best_of(energy, np.array(candidates))
    steps = (len(candidates) - 1) // 2 * settings.contour_steps
    evaluations = len(tried.points) + found.evaluations + steps
    return Solution(limb.dofs, found.values, found.energy_px, evaluations)


def _grid_counts(limb: Limb, settings: SearchSettings) -> tuple[int, ...]:
    is_arm = DOFS[limb.main.dofs[0]].joint.endswith("shoulder")
    return settings.arm_grid if is_arm else settings.leg_grid


def _grid_steps(stage: Stage, settings: SearchSettings) -> Floats:
    return np.array([settings.grid_step_rad * (2.0 if DOFS[d].role == "twist" else 1.0) for d in stage.dofs])


def _prepare(
    model: Model, stage: Stage, picture: Picture, pose: Floats, settings: SearchSettings
) -> tuple[Energy, Floats, Box]:
    """The stage's energy with everything else pre-rendered, the pose's values (d,), and their limits."""
    cost, detail_px, drawn = settings.cost, settings.detail_px, ALL_SEGMENTS
    if stage.others and settings.prerender:
        drawn = stage.segments
        others = model.backend.coverage(pose[None], stage.others, picture.region, detail_px)
        picture = picture.ignoring(others[0])
    energy = model.backend.energy(Problem(pose, stage.dofs, drawn, picture, cost, detail_px))
    box = Box(*stage.limits())
    return energy, np.clip(pose[list(stage.dofs)], box.lower, box.upper), box


def _steps(stage: Stage, settings: SearchSettings) -> Floats:
    """The first step (d,) of a line search over each of a stage's parameters."""
    return np.array(
        [settings.shift_step_m if DOFS[d].unit == "m" else settings.angle_step_rad for d in stage.dofs]
    )


def _axes(stage: Stage, settings: SearchSettings) -> Floats:
    """One direction (d, d) per parameter."""
    return np.diag(_steps(stage, settings))


def _descend(
    energy: Energy, start: Minimum, box: Box, directions: Floats, settings: SearchSettings
) -> Minimum:
    return descend(
        energy,
        start,
        box,
        directions,
        settings.line_tolerance,
        settings.descent_tolerance,
        settings.descent_rounds,
    )


def _descend_stage(
    model: Model, stage: Stage, picture: Picture, pose: Floats, settings: SearchSettings
) -> Solution:
    energy, start, box = _prepare(model, stage, picture, pose, settings)
    return _descended(energy, stage, start, box, settings)


def _descended(energy: Energy, stage: Stage, start: Floats, box: Box, settings: SearchSettings) -> Solution:
    found = _descend(energy, best_of(energy, start[None]), box, _axes(stage, settings), settings)
    return _solution(stage, found)


def _solution(stage: Stage, minimum: Minimum) -> Solution:
    return Solution(stage.dofs, minimum.values, minimum.energy_px, minimum.evaluations)
