"""Where the cloth of a skirt, or of a coat's tails, hangs: about the pelvis, and between the legs.

Cloth about the pelvis hangs by its weight: it turns with the pelvis, but leans half as far. Legs that leave
it stretch the cloth between them, down to the hem, and where they rise it hangs down from them. Seen from the
side, that is the hull of both legs; it is drawn as webs, tetrahedra between two points of either leg.
"""

import numba
import numpy as np

from services.mocap.body.skeleton import JOINT_INDEX, SIDES
from services.mocap.types import Floats, Ints

_PARALLEL = 1e-6
"""A sum of two unit vectors shorter than this has no direction; a thigh with less depth is level."""
_KNEE_ABOVE_HEM_M = 0.1
"""The cloth lies along the whole of a shin that is level or raised if its knee is at least this far above the
hem; less far if it is lower, so that no web appears at once when a knee rises above the hem."""
PELVIS = JOINT_INDEX["pelvis"]
HIPS, KNEES, ANKLES = (
    np.array([JOINT_INDEX[f"{side}_{at}"] for side in SIDES], np.int32) for at in ("hip", "knee", "ankle")
)
_HIP, _KNEE, _LEAVES, _BELOW, _UNDER_KNEE = range(5)
"""Points of a leg that cloth hangs on: hip; knee; where the leg leaves the cloth; and under these two where
cloth that hangs from them ends. What is below the hem counts as the place where the leg leaves."""
WEBS: Ints = np.array([(_HIP, _KNEE), (_KNEE, _LEAVES), (_LEAVES, _BELOW), (_KNEE, _UNDER_KNEE)], np.int32)
"""(4, 2) the two points of either leg that span each web of cloth."""


@numba.njit(cache=True, nogil=True)
def hang(pelvis: Floats, out: Floats) -> None:
    """Write the frame (4, 4) of cloth that hangs from the pelvis (4, 4).

    Its z axis is halfway to upright, its y axis as near to the pelvis's as it can be. Upside down, it is
    turned as the pelvis.
    """
    for i in range(3):
        out[i, 1], out[i, 2], out[i, 3] = pelvis[i, 1], pelvis[i, 2], pelvis[i, 3]
    out[2, 2] += 1.0
    up = np.sqrt(out[0, 2] ** 2 + out[1, 2] ** 2 + out[2, 2] ** 2)
    along = (out[0, 1] * out[0, 2] + out[1, 1] * out[1, 2] + out[2, 1] * out[2, 2]) / max(up, _PARALLEL) ** 2
    for i in range(3):
        out[i, 1] -= along * out[i, 2]
    across = np.sqrt(out[0, 1] ** 2 + out[1, 1] ** 2 + out[2, 1] ** 2)
    if up < _PARALLEL or across < _PARALLEL:
        for i in range(3):
            for j in range(3):
                out[i, j] = pelvis[i, j]
        return
    for i in range(3):
        out[i, 1] /= across
        out[i, 2] /= up
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        out[i, 0] = out[k, 1] * out[m, 2] - out[m, 1] * out[k, 2]


@numba.njit(cache=True, nogil=True)
def span(T_world_joint: Floats, hanging: Floats, hem_m: float, web: Ints, out: Floats) -> None:
    """Write the frame (4, 4) of a web (2,): its corners are two points of the left leg's, then two of the
    right one's; the first is its origin.

    T_world_joint (J, 4, 4); hanging (4, 4): from hang; hem_m: how far the hem is under the pelvis, along the
    z axis of hanging.
    """
    lowest_m = min(
        hem_m, max(_depth_m(hanging, T_world_joint[ANKLES[0]]), _depth_m(hanging, T_world_joint[ANKLES[1]]))
    )
    for k in range(2):
        for side in range(2):
            column = 3 if k == 0 and side == 0 else 2 * side + k - 1
            _write_point(T_world_joint, hanging, side, web[k], hem_m, lowest_m, out, column)
    for column in range(3):
        for i in range(3):
            out[i, column] -= out[i, 3]


@numba.njit(cache=True, nogil=True)
def _write_point(
    T_world_joint: Floats,
    hanging: Floats,
    side: int,
    point: int,
    hem_m: float,
    lowest_m: float,
    out: Floats,
    column: int,
) -> None:
    """Write a point of a leg that cloth hangs on into a column of out (4, 4).

    lowest_m: how far down what hangs reaches.
    """
    hip, knee = T_world_joint[HIPS[side]], T_world_joint[KNEES[side]]
    ankle = T_world_joint[ANKLES[side]]
    hip_m, knee_m, ankle_m = _depth_m(hanging, hip), _depth_m(hanging, knee), _depth_m(hanging, ankle)
    # Along the leg, from 0 at the hip over 1 at the knee to 2 at the ankle.
    if knee_m > hem_m:
        leaves = max(hem_m - hip_m, 0.0) / max(knee_m - hip_m, _PARALLEL)
    else:
        leaves = 1.0 + min((hem_m - knee_m) / max(ankle_m - knee_m, _KNEE_ABOVE_HEM_M), 1.0)
    at = 0.0
    if point in (_KNEE, _UNDER_KNEE):
        at = min(1.0, leaves)
    elif point != _HIP:
        at = leaves
    depth_m = 0.0
    for i in range(3):
        if at <= 1.0:
            out[i, column] = hip[i, 3] + at * (knee[i, 3] - hip[i, 3])
        else:
            out[i, column] = knee[i, 3] + (at - 1.0) * (ankle[i, 3] - knee[i, 3])
        depth_m -= hanging[i, 2] * (out[i, column] - hanging[i, 3])
    if point in (_BELOW, _UNDER_KNEE):
        for i in range(3):
            out[i, column] -= max(lowest_m - depth_m, 0.0) * hanging[i, 2]


@numba.njit(cache=True, nogil=True, inline="always")
def _depth_m(hanging: Floats, joint: Floats) -> float:
    """How far a joint (4, 4) is under the origin of hanging cloth (4, 4)."""
    return float(
        hanging[0, 2] * (hanging[0, 3] - joint[0, 3])
        + hanging[1, 2] * (hanging[1, 3] - joint[1, 3])
        + hanging[2, 2] * (hanging[2, 3] - joint[2, 3])
    )
