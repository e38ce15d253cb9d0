"""A limb with its hand or foot: grid search, then downhill on the energy, along the contours, or both.

And both arms, or both legs, at once: neither of two that are exchanged can be searched without the other.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from services.mocap.body.kinematics import clip_to_limits
from services.mocap.body.skeleton import DOFS, bare
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import LIMBS, Stage
from services.mocap.search.descent import Box, Solution, best_of
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import (
    ColouredEnergy,
    descend_from,
    descend_stage,
    prepare,
    stage_window,
)
from services.mocap.search.typical_poses import first_apart, typical_poses
from services.mocap.take.marks import LimbName
from services.mocap.types import Floats

_STARTS = 4
"""Points of a grid from which a limb is aligned with the contours."""
_AT_ONCE = 32
"""Points whose colours are looked at in one call."""
_MOST_PROMISING = 5
"""Poses that are worth a closer look."""


def limb_picture(
    model: Model, name: LimbName, whole: Picture, pose: Floats, settings: SearchSettings
) -> Picture:
    """The part of a whole picture that a limb's search needs: its windows."""
    return stage_window(model, LIMBS[name].main, whole, pose) if settings.windows else whole


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
    by_contours = settings.method == "contours"
    stage = limb.whole if by_contours else limb.main
    prepared = energy, start, box = prepare(model, stage, seen, pose, settings, priced=by_contours)
    points, steps = points_to_try(name, start, box, settings)
    k, n = shard
    points = np.concatenate([points[:1], points[1:][k::n]])
    if by_contours:
        begun = best_apart(energy, points, 1.5 * steps)
        found = _align_limb(model, stage, seen, pose, settings, prepared, begun)
        return replace(found, evaluations=len(points) + found.evaluations)
    main = descend_from(energy, best_of(energy, points, limb.main.dofs), box, settings)
    # Then the hand or foot, at the end of the limb's new pose (the paper, section 3).
    extremity = descend_stage(model, limb.extremity, seen, main.applied_to(pose), settings)
    values = np.concatenate([main.values, extremity.values])
    return Solution(limb.dofs, values, main.energy_px, main.evaluations + extremity.evaluations)


def points_to_try(name: LimbName, start: Floats, box: Box, settings: SearchSettings) -> tuple[Floats, Floats]:
    """Values of a limb's parameters (N, d), the start (d,) first, where its search begins: a grid, and by
    the settings typical poses; and the distances of the grid's points (k,).

    The start may have the hand or foot as well, which then stays as it is.
    """
    main = LIMBS[name].main
    n_main, counts = len(main.dofs), settings.arm_grid if bare(name) == "arm" else settings.leg_grid
    of_main = Box(box.lower[:n_main], box.upper[:n_main])
    steps = np.array([settings.grid_step_rad * (2.0 if DOFS[d].role == "twist" else 1.0) for d in main.dofs])
    points = grid_points(start[:n_main], counts, steps, of_main)
    if settings.typical_limbs:
        typical = typical_poses()[:, list(main.dofs)]
        points = np.concatenate([points, np.clip(typical, of_main.lower, of_main.upper)])
    return np.column_stack([points, np.tile(start[n_main:], (len(points), 1))]), steps


def _align_limb(
    model: Model,
    stage: Stage,
    seen: Picture,
    pose: Floats,
    settings: SearchSettings,
    prepared: tuple[ColouredEnergy, Floats, Box],
    points: Sequence[Floats],
) -> Solution:
    """Align a whole limb from points (d,) of a grid; returns the best by the energy.

    prepared: what `prepare` returns for the stage. Where colours count, a descent on the energy follows,
    because a limb before the trunk has no contour.
    """
    (energy, start, box), aligner = prepared, model.aligner(settings)
    candidates = [start]
    for point in points:
        begun = pose.copy()
        begun[list(stage.dofs)] = point
        aligned = aligner.align(seen, begun, settings, stage.dofs, stage.surfaces)
        candidates += [point, aligned.pose[list(stage.dofs)]]
    found = best_of(energy, np.array(candidates), stage.dofs)
    if model.counts_colours(seen, settings.colour):
        found = descend_from(energy, found, box, settings)
    return replace(found, evaluations=len(points) * settings.contour_steps + found.evaluations)


def grid_points(centre: Floats, counts: tuple[int, ...], steps: Floats, box: Box) -> Floats:
    """All combinations (N, d) of counts[k] values spaced by steps[k] about centre (d,), within the box.

    The centre is the first point, whatever the counts.
    """
    axes = [
        np.unique(np.clip(c + step * (np.arange(n) - (n - 1) / 2), low, high))
        for c, n, step, low, high in zip(centre, counts, steps, box.lower, box.upper, strict=True)
    ]
    points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    return np.concatenate([np.clip(centre, box.lower, box.upper)[None], points])


def best_apart(energy: ColouredEnergy, points: Floats, steps: Floats) -> list[Floats]:
    """Some points (of N, d) of least energy, each farther than steps (k,) from those before in one of the
    first k parameters.

    Colours are looked at from the quickly known least energy on, as long as the points that follow may be
    among the chosen.
    """
    quick = energy.quick(points)
    if energy.colours is None:
        return [points[k] for k in _apart(points, quick, steps)]
    order, energies = np.argsort(quick, kind="stable"), np.full(len(points), np.inf)
    for first in range(0, len(points), _AT_ONCE):
        looked_at = order[first : first + _AT_ONCE]
        energies[looked_at] = quick[looked_at] + energy.colours(points[looked_at])
        chosen = _apart(points, energies, steps)
        following = quick[order[first + _AT_ONCE :]]
        if len(chosen) == _STARTS and np.all(following[:1] > energies[chosen[-1]]):
            break
    return [points[k] for k in chosen]


def _apart(points: Floats, energies: Floats, steps: Floats) -> list[int]:
    """The first _STARTS of these points with a known energy, the least first, that are apart."""
    chosen, left = list[int](), np.argsort(energies, kind="stable")
    left = left[energies[left] < np.inf]
    while len(left) and len(chosen) < _STARTS:
        best = int(left[0])
        chosen.append(best)
        left = left[np.any(np.abs(points[left] - points[best])[:, : len(steps)] > steps, axis=1)]
    return chosen


def promising_of_pair(
    model: Model, pair: tuple[LimbName, LimbName], whole: Picture, pose: Floats, settings: SearchSettings
) -> Floats:
    """(N, D) other poses than one (D,) that may be better: two limbs exchanged, or as in typical poses.

    pose: within the limits. Of these the best, each apart from the pose and from those before.
    """
    one, other = (LIMBS[name] for name in pair)
    stage = Stage(one.dofs + other.dofs, tuple(sorted({*one.main.surfaces, *other.main.surfaces})), 0)
    energy, _, _ = prepare(model, stage, whole, pose, settings, priced=True)
    poses = np.tile(pose, (2 + len(typical_poses()), 1))
    poses[1, list(stage.dofs)] = pose[list(other.dofs + one.dofs)]
    turned = list(one.main.dofs + other.main.dofs)  # hands and feet stay as they are
    poses[2:, turned] = typical_poses()[:, turned]
    by_energy = np.argsort(energy(poses[2:, list(stage.dofs)]), kind="stable") + 2
    return first_apart(poses[[0, 1, *by_energy]], 1 + _MOST_PROMISING, model.body.offsets_m)[1:]
