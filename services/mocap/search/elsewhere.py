"""How much more the best pose costs that has a limb elsewhere: what is lost could be elsewhere as well."""

import time

import numpy as np

from services.mocap.body.kinematics import joint_positions
from services.mocap.energy.picture import Picture
from services.mocap.search.best_path import PART_JOINTS
from services.mocap.search.chains import LIMBS
from services.mocap.search.found import FrameSolution
from services.mocap.search.limb import best_apart, points_to_try
from services.mocap.search.lost_probability import LOST_M, lost_at_price
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import prepare
from services.mocap.take.marks import PARTS, LimbName
from services.mocap.types import Floats

_SURE = 0.985
"""Limbs that are at least so sure are not looked at."""


def look_elsewhere(model: Model, whole: Picture, solution: FrameSolution, settings: SearchSettings) -> None:
    """Judge limbs of a solution again that are not sure, by what they would cost elsewhere."""
    begun_s = time.thread_time()
    for limb in LIMBS:
        if (sure := solution.confidence.get(limb, 1.0)) < _SURE:
            price = price_elsewhere(model, limb, whole, solution.pose, settings)
            solution.confidence[limb] = 1.0 - lost_at_price(1.0 - sure, price)
    solution.seconds["limbs"] += time.thread_time() - begun_s


def price_elsewhere(
    model: Model, name: LimbName, whole: Picture, pose: Floats, settings: SearchSettings
) -> float:
    """By which share of its energy a pose (D,) is better than the best found with a limb elsewhere: with a
    joint of this limb more than LOST_M from where the pose has it. Negative if that one is better."""
    stage, settings, aligner = LIMBS[name].whole, settings.widened(), model.aligner(settings)
    energy, start, box = prepare(model, stage, whole, pose, settings, priced=True)
    points, steps = points_to_try(name, start, box, settings)
    dofs, joints = list(stage.dofs), PART_JOINTS[PARTS.index(name)]
    own_m = joint_positions(pose[None], model.body.offsets_m)[:, joints]

    def posed(values: Floats) -> Floats:
        poses = np.tile(pose, (len(values), 1))
        poses[:, dofs] = values
        return poses

    def elsewhere(values: Floats) -> Floats:
        joints_m = joint_positions(posed(values), model.body.offsets_m)[:, joints]
        is_elsewhere = (np.linalg.norm(joints_m - own_m, axis=-1) > LOST_M).any(axis=-1)
        return np.asarray(values[is_elsewhere])

    begun = np.array(best_apart(energy, elsewhere(points), 1.5 * steps)).reshape(-1, len(dofs))
    aligned = [aligner.align(whole, one, settings, stage.dofs, stage.surfaces).pose for one in posed(begun)]
    others = np.concatenate([begun, elsewhere(np.array(aligned).reshape(-1, len(pose))[:, dofs])])
    if not len(others):
        return np.inf
    own_px = float(energy(start[None])[0])
    return float((energy(others).min() - own_px) / max(own_px, 1.0))
