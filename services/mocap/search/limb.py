"""A limb with its hand or foot: grid search, then downhill on the energy, along the contours, or both."""

from dataclasses import replace

import numpy as np

from services.mocap.body.kinematics import clip_to_limits
from services.mocap.body.skeleton import DOFS
from services.mocap.energy.backend import Energy
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import LIMBS, Limb, LimbName, Stage
from services.mocap.search.descent import Solution
from services.mocap.search.grid import Tried, best_of, grid_points
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import (
    descend_from,
    descend_stage,
    prepare,
    stage_window,
)
from services.mocap.search.typical_poses import typical_poses
from services.mocap.types import Floats

_STARTS = 4
"""Points of a grid from which a limb is aligned with the contours."""


def limb_picture(
    model: Model, name: LimbName, whole: Picture, pose: Floats, settings: SearchSettings
) -> Picture:
    """The part of a whole picture that a limb's search needs: its windows with the margin of the cost."""
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

    seen: from limb_picture, without a pre-render. shard (k, n): search the start and only every n-th grid
    point, from the k-th on, so that n workers share a limb and none returns a worse pose than the start. A
    pose beyond the joint limits is first moved to them.
    """
    limb, pose = LIMBS[name], clip_to_limits(pose)
    seen = _without_margin(settings.cost.priced(seen), settings)
    energy, start, box = prepare(model, limb.main, seen, pose, settings)
    points = grid_points(start, _grid_counts(limb, settings), _grid_steps(limb.main, settings), box)
    if settings.typical_limbs:
        typical = typical_poses()[:, list(limb.main.dofs)]
        points = np.concatenate([points, np.clip(typical, box.lower, box.upper)])
    k, n = shard
    points = np.concatenate([points[:1], points[1:][k::n]])
    if settings.method == "contours":
        energy = with_unlikely(model, limb.main, pose, settings, energy)
        return _align_limb(model, limb, seen, pose, settings, Tried(points, energy(points)))
    main = descend_from(energy, best_of(energy, points, limb.main.dofs), box, settings)
    return _with_extremity(model, limb, seen, main.applied_to(pose), settings, main)


def _with_extremity(
    model: Model, limb: Limb, seen: Picture, pose: Floats, settings: SearchSettings, main: Solution
) -> Solution:
    """A limb's solution, which the pose has, and that of its hand or foot (the paper, section 3)."""
    extremity = descend_stage(model, limb.extremity, seen, pose, settings)
    return Solution(
        limb.dofs,
        np.concatenate([main.values, extremity.values]),
        main.energy_px,
        main.evaluations + extremity.evaluations,
    )


def _align_limb(
    model: Model, limb: Limb, seen: Picture, pose: Floats, settings: SearchSettings, tried: Tried
) -> Solution:
    """Align from the best grid points that are not neighbours; returns the best by the energy.

    Where colours count, a descent on the energy follows, because a limb before the trunk has no contour.
    """
    whole_limb = Stage(limb.dofs, limb.main.surfaces, limb.main.window_px)
    energy, start, box = prepare(model, whole_limb, seen, pose, settings)
    energy = with_unlikely(model, whole_limb, pose, settings, energy)
    aligner = model.aligner(settings)
    candidates = [start]
    for point in tried.best_apart(_STARTS, 1.5 * _grid_steps(limb.main, settings)):
        begun = pose.copy()
        begun[list(limb.main.dofs)] = point
        aligned = aligner.align(seen, begun, settings, limb.dofs, limb.main.surfaces)
        candidates += [begun[list(limb.dofs)], aligned.pose[list(limb.dofs)]]
    found = best_of(energy, np.array(candidates), limb.dofs)
    before = len(tried.points) + (len(candidates) - 1) // 2 * settings.contour_steps
    if not model.counts_colours(seen, settings.colour):
        return replace(found, evaluations=before + found.evaluations)
    lowest = descend_from(energy, found, box, settings)
    return replace(lowest, evaluations=before + lowest.evaluations)


def with_unlikely(
    model: Model, stage: Stage, pose: Floats, settings: SearchSettings, energy: Energy
) -> Energy:
    """A stage's energy with what limbs inside others or in unusual poses cost."""
    aligner = model.aligner(settings)

    def priced(values: Floats) -> Floats:
        poses = np.tile(pose, (len(values), 1))
        poses[:, list(stage.dofs)] = values
        return np.asarray(energy(values) + aligner.unlikely_px(poses, settings))

    return priced


def _grid_counts(limb: Limb, settings: SearchSettings) -> tuple[int, ...]:
    is_arm = DOFS[limb.main.dofs[0]].joint.endswith("shoulder")
    return settings.arm_grid if is_arm else settings.leg_grid


def _grid_steps(stage: Stage, settings: SearchSettings) -> Floats:
    return np.array([settings.grid_step_rad * (2.0 if DOFS[d].role == "twist" else 1.0) for d in stage.dofs])
