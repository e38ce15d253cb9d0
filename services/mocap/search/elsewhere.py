"""What a limb would cost in other places: it is hardly lost if all of them cost much more than its own."""

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
"""Limbs with at least this confidence are not tried elsewhere."""


def look_elsewhere(model: Model, whole: Picture, solution: FrameSolution, settings: SearchSettings) -> None:
    """Correct low confidence in a solution's limbs by what these would cost elsewhere."""
    begun_s = time.thread_time()
    for limb in LIMBS:
        if (sure := solution.confidence.get(limb, 1.0)) < _SURE:
            price = price_elsewhere(model, limb, whole, solution.pose, settings)
            solution.confidence[limb] = 1.0 - lost_at_price(1.0 - sure, price)
    solution.seconds["limbs"] += time.thread_time() - begun_s


def price_elsewhere(
    model: Model, name: LimbName, whole: Picture, pose: Floats, settings: SearchSettings
) -> float:
    """How much more the best pose costs in which a joint of a limb is more than LOST_M from where a pose (D,)
    has it, as a share of that pose's energy; negative if it costs less."""
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
