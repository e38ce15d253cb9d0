"""Prepares the stages of a frame's search, and solves them by a descent on XOR."""

from dataclasses import dataclass, replace

import numpy as np

from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOFS, LOWER, UPPER
from services.mocap.energy.backend import Energy, Problem
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import ALL_SURFACES, Stage, window_origins_px, window_size_px
from services.mocap.search.descent import Box, Solution, best_of, descend
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Floats


def whole_body_energy(model: Model, picture: Picture, settings: SearchSettings) -> Energy:
    """The energy of all parameters with the whole body drawn."""
    return energy_of(model, whole_body_problem(picture, settings))


def whole_body_problem(picture: Picture, settings: SearchSettings) -> Problem:
    """The problem of whole_body_energy."""
    dofs = tuple(range(N_DOF))
    return Problem(np.zeros(N_DOF), dofs, ALL_SURFACES, picture, settings.cost, settings.detail_px)


@dataclass(frozen=True, eq=False)
class ColouredEnergy:
    """An energy in two parts, since what wrong colours cost takes several times as long to compute."""

    quick: Energy
    """What silhouettes, and poses beside their pixels, cost: never more than the whole energy."""
    colours: Energy | None = None
    """What wrong colours cost; None where they do not count."""

    def __call__(self, values: Floats) -> Floats:
        """The whole energy (N,) of values (N, d)."""
        return self.quick(values) if self.colours is None else self.quick(values) + self.colours(values)


def energy_of(model: Model, problem: Problem) -> ColouredEnergy:
    """The energy of a problem, with what wrong colours cost if its picture has classes."""
    quick, price = model.backend.energy(problem), problem.cost.colour
    if not model.counts_colours(problem.picture, price):
        return ColouredEnergy(quick)
    wrong_px = model.colours.wrong_px(problem)
    return ColouredEnergy(quick, lambda values: price * wrong_px(values))


def stage_window(model: Model, stage: Stage, picture: Picture, pose: Floats) -> Picture:
    """Cut the windows of a stage out of a picture, centred on where the pose (D,) has its segments."""
    size_px = window_size_px(stage, model.rig)
    return picture.window(window_origins_px((stage,), pose, model.body, model.rig)[0], size_px, size_px)


def prepare(
    model: Model,
    stage: Stage,
    picture: Picture,
    pose: Floats,
    settings: SearchSettings,
    *,
    priced: bool = False,
) -> tuple[ColouredEnergy, Floats, Box]:
    """The stage's energy with everything else pre-rendered, the pose's values (d,), and their limits.

    priced: with what poses cost beside their pixels (pose_prices).
    """
    cost, detail_px, drawn = settings.cost, settings.detail_px, ALL_SURFACES
    if stage.others and settings.prerender:
        drawn = stage.surfaces
        others = model.backend.coverage(pose[None], stage.others, picture.region, detail_px)
        picture = picture.ignoring(others[0])
    problem = Problem(pose, stage.dofs, drawn, picture, cost, detail_px)
    energy = energy_of(model, problem)
    dofs = list(stage.dofs)
    box = Box(LOWER[dofs], UPPER[dofs])
    start = np.clip(pose[dofs], box.lower, box.upper)
    if not priced:
        return energy, start, box
    aligner = model.aligner(settings)

    def with_prices(values: Floats) -> Floats:
        return np.asarray(energy.quick(values) + aligner.prices_px(problem.poses(values), settings))

    return replace(energy, quick=with_prices), start, box


def descend_from(energy: Energy, start: Solution, box: Box, settings: SearchSettings) -> Solution:
    """Lower an energy from a start, first along the parameters one by one."""
    steps = [settings.shift_step_m if DOFS[d].unit == "m" else settings.angle_step_rad for d in start.dofs]
    return descend(energy, start, box, np.diag(steps), settings)


def descend_stage(
    model: Model, stage: Stage, picture: Picture, pose: Floats, settings: SearchSettings
) -> Solution:
    """Lower a stage's energy from a pose (D,), in the stage's windows of a picture or in all of it."""
    if settings.windows and stage.window_px:
        picture = stage_window(model, stage, picture, pose)
    energy, start, box = prepare(model, stage, picture, pose, settings)
    return descend_from(energy, best_of(energy, start[None], stage.dofs), box, settings)
