"""Solving one chain of one frame: torso, head, or a limb with its hand or foot."""

from dataclasses import dataclass

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.body.skeleton import DOFS, LOWER, UPPER
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Backend, Energy, Problem
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
from services.mocap.search.compensation import limbs_staying
from services.mocap.search.descent import Box, Minimum, descend
from services.mocap.search.grid import best_of, grid_points
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Floats


@dataclass(frozen=True, eq=False)
class Model:
    """What every sub-problem needs to know: the body, the cameras, and a backend made for both."""

    body: Body
    rig: Rig
    backend: Backend


@dataclass(frozen=True, eq=False)
class Solution:
    """A chain's parameter values and what they cost."""

    dofs: tuple[int, ...]
    values: Floats
    """(d,)"""
    energy_px: float
    evaluations: int

    def applied_to(self, pose: Floats) -> Floats:
        """The pose (35,) with this chain's parameters replaced."""
        changed = pose.copy()
        changed[list(self.dofs)] = self.values
        return changed


def whole_body_energy(model: Model, picture: Picture, pose: Floats, cost: Cost, detail_px: float) -> Energy:
    """The energy of all parameters with the whole body drawn; pose (35,) is any; the rest as in Problem."""
    problem = Problem(pose, tuple(range(N_DOF)), ALL_SEGMENTS, cost.priced(picture), cost, detail_px)
    return model.backend.energy(problem)


def solve_torso(model: Model, halved: Picture, pose: Floats, settings: SearchSettings) -> Solution:
    """Find the root from a pose by going downhill, at half resolution.

    The whole body moves with the root, as in the paper, and in further directions the torso alone, the limbs
    making up for it. Without these a torso that is turned wrongly is held fast by limbs that fit.
    """
    energy = whole_body_energy(model, halved, pose, settings.cost, settings.detail_px)
    box = Box(LOWER, UPPER)
    start = best_of(energy, np.clip(pose, box.lower, box.upper)[None])
    rigid = np.eye(N_DOF)[list(TORSO.dofs)] * _steps(TORSO, settings)[:, None]
    directions = np.concatenate([rigid, limbs_staying(start.values, rigid, model.body)])
    found = _descend(energy, start, box, directions, settings)
    return Solution(tuple(range(N_DOF)), found.values, found.energy_px, found.evaluations)


def solve_head(model: Model, whole: Picture, pose: Floats, settings: SearchSettings) -> Solution:
    """Find the head's turn by going downhill in its window."""
    window = stage_window(model, HEAD, whole, pose)
    return _descend_stage(model, HEAD, window, pose, settings)


def stage_window(model: Model, stage: Stage, picture: Picture, pose: Floats, margin_px: int = 0) -> Picture:
    """Cut the windows of a stage out of a picture, centred on where the pose (35,) has its segments.

    margin_px: how much larger they are on all sides.
    """
    size_px = window_size_px(stage, model.rig) + 2 * margin_px
    origins_px = window_origins_px(stage, pose, model.body, model.rig) - np.int32(margin_px)
    return picture.window(origins_px, size_px, size_px)


def _without_margin(window: Picture, margin_px: int) -> Picture:
    region = window.region
    width_px, height_px = region.width_px - 2 * margin_px, region.height_px - 2 * margin_px
    return window.window(region.origin_px + np.int32(margin_px), width_px, height_px)


def solve_limb(
    model: Model,
    name: LimbName,
    window: Picture,
    pose: Floats,
    settings: SearchSettings,
    shard: tuple[int, int] = (0, 1),
) -> Solution:
    """Find a limb in its window: grid search over ball and hinge, downhill, then its hand or foot.

    window: the input in the limb's window and in the cost's margin around it, nothing pre-rendered. shard (k,
    n): search the start and only every n-th grid point, from the k-th on, so that n workers share a limb and
    none returns worse than the start. A pose beyond the joint limits is moved to them first.
    """
    limb, pose = LIMBS[name], clip_to_limits(pose)
    window = _without_margin(settings.cost.priced(window), settings.cost.margin_px)
    energy, start, box = _prepare(model, limb.main, window, pose, settings)
    points = grid_points(start, _grid_counts(limb, settings), _grid_steps(limb.main, settings), box)
    k, n = shard
    points = np.concatenate([points[:1], points[1:][k::n]])
    best, axes = best_of(energy, points), _axes(limb.main, settings)
    main = _solution(limb.main, _descend(energy, best, box, axes, settings))
    found = main.applied_to(pose)
    extremity = _descend_stage(
        model, limb.extremity, stage_window(model, limb.extremity, window, found), found, settings
    )
    return Solution(
        limb.dofs,
        np.concatenate([main.values, extremity.values]),
        main.energy_px,
        main.evaluations + extremity.evaluations,
    )


def _grid_counts(limb: Limb, settings: SearchSettings) -> tuple[int, ...]:
    is_arm = DOFS[limb.main.dofs[0]].joint.endswith("shoulder")
    return settings.arm_grid if is_arm else settings.leg_grid


def _grid_steps(stage: Stage, settings: SearchSettings) -> Floats:
    return np.array([settings.grid_step_rad * (2.0 if DOFS[d].role == "twist" else 1.0) for d in stage.dofs])


def _prepare(
    model: Model, stage: Stage, picture: Picture, pose: Floats, settings: SearchSettings
) -> tuple[Energy, Floats, Box]:
    """The stage's energy with everything else pre-rendered, the pose's values (d,), and their limits."""
    cost, detail_px = settings.cost, settings.detail_px
    if stage.others:
        drawn = model.backend.coverage(pose[None], stage.others, picture.region, detail_px)
        picture = picture.ignoring(drawn[0])
    energy = model.backend.energy(Problem(pose, stage.dofs, stage.segments, picture, cost, detail_px))
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
    start_at = best_of(energy, start[None])
    return _solution(stage, _descend(energy, start_at, box, _axes(stage, settings), settings))


def _solution(stage: Stage, minimum: Minimum) -> Solution:
    return Solution(stage.dofs, minimum.values, minimum.energy_px, minimum.evaluations)
