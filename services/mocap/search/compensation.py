"""Moving the torso while the limbs stay where they are, to first order."""

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF, joint_positions
from services.mocap.body.skeleton import JOINT_INDEX, SIDES
from services.mocap.search.chains import LIMBS
from services.mocap.types import Floats

_HELD_JOINTS = [
    JOINT_INDEX[f"{side}_{joint}"] for side in SIDES for joint in ("elbow", "wrist", "knee", "ankle")
]
_LIMB_DOFS = [d for limb in LIMBS.values() for d in limb.main.dofs]
_PROBE_RAD = 1e-4
_DAMPING_M = 0.05
"""A turn of one radian is worth this much of the joints' shift; it keeps straight limbs from spinning."""


def limbs_staying(pose: Floats, moves: Floats, body: Body) -> Floats:
    """To each move (k, 35) of the root add the turns of the limbs that best keep their joints in place.

    Damped least squares on the positions of elbows, wrists, knees and ankles, about the pose (35,).
    """
    jacobian = _jacobian(pose, body)
    limbs = jacobian[:, _LIMB_DOFS]
    normal = limbs.T @ limbs + _DAMPING_M**2 * np.eye(len(_LIMB_DOFS))
    compensated = moves.copy()
    compensated[:, _LIMB_DOFS] -= np.linalg.solve(normal, limbs.T @ jacobian @ moves.T).T
    return compensated


def _jacobian(pose: Floats, body: Body) -> Floats:
    """Derivatives (24, 35) of the held joints' positions in metres by the pose's parameters."""
    probes = np.concatenate([pose + _PROBE_RAD * np.eye(N_DOF), pose - _PROBE_RAD * np.eye(N_DOF)])
    ahead, behind = np.split(
        joint_positions(probes, body.offsets_m)[:, _HELD_JOINTS].reshape(2 * N_DOF, -1), 2
    )
    jacobian: Floats = (ahead - behind).T / (2 * _PROBE_RAD)
    return jacobian
