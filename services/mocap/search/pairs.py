"""Both arms, or both legs, at once: neither of two that are exchanged can be searched without the other."""

import numpy as np

from services.mocap.body.kinematics import joint_positions
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import LIMBS, LimbName, Stage
from services.mocap.search.limb import with_unlikely
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import prepare
from services.mocap.search.typical_poses import typical_poses
from services.mocap.types import Floats

PAIRS: tuple[tuple[LimbName, LimbName], ...] = (("left_arm", "right_arm"), ("left_leg", "right_leg"))
_MOST = 5
"""Poses that are worth a closer look."""
_APART_M = 0.15
"""Poses are different if some joint is farther apart."""


def promising(
    model: Model, pair: tuple[LimbName, LimbName], whole: Picture, pose: Floats, settings: SearchSettings
) -> Floats:
    """(N, D) other poses than one (D,) that may be better: two limbs exchanged, or as in typical poses.

    pose: within the limits. Of these the best, each apart from the pose and from those before.
    """
    one, other = (LIMBS[name] for name in pair)
    stage = Stage(one.dofs + other.dofs, tuple(sorted({*one.main.surfaces, *other.main.surfaces})), 0)
    energy, _, _ = prepare(model, stage, whole, pose, settings)
    energy = with_unlikely(model, stage, pose, settings, energy)
    poses = np.tile(pose, (2 + len(typical_poses()), 1))
    poses[1, list(stage.dofs)] = pose[list(other.dofs + one.dofs)]
    turned = list(one.main.dofs + other.main.dofs)  # hands and feet stay as they are
    poses[2:, turned] = typical_poses()[:, turned]
    joints_m, chosen = joint_positions(poses, model.body.offsets_m), [0]
    by_energy = np.argsort(energy(poses[2:, list(stage.dofs)]), kind="stable") + 2
    for k in (1, *by_energy.tolist()):
        off_m = np.linalg.norm(joints_m[chosen] - joints_m[k], axis=-1).max(axis=-1)
        if bool((off_m > _APART_M).all()):
            chosen.append(k)
        if len(chosen) > _MOST:
            break
    return poses[chosen[1:]]
