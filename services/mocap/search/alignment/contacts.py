"""Arms inside the trunk or the head: how deep they are there, and what pulls them out.

In silhouettes an arm before the trunk and one inside it look alike. The trunk and the head are taken as
stacks of ellipses, arms as points on their axes: a point at the surface is an arm half inside.
"""

from typing import NamedTuple

import numba
import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF, N_JOINTS, SEGMENT_JOINTS, place_joints
from services.mocap.body.skeleton import JOINT_INDEX, SEGMENT_INDEX
from services.mocap.search.alignment.twists import DOF_JOINT, MOVED_BY
from services.mocap.types import Floats, Ints

SIDES = ("left", "right")
_ELLIPSES = 24
_STACKS = ("pelvis", "torso", "head")
_FOREARM_SHARES = (0.25, 0.5, 0.75, 1.0)
_HAND_SHARES = (0.33, 0.66, 0.9)
_SHOULDER_CARRIER = int(SEGMENT_JOINTS[SEGMENT_INDEX["torso"]])
_LOWEST_HEIGHTS = -0.06
"""Of what counts, from a segment's joint, in body heights: skirts hang lower and give way."""
_CENTRAL = 1e-3
"""Of an ellipse's radius: nearer to its centre no direction leads out."""
_ALL_JOINTS = np.arange(N_JOINTS, dtype=np.int32)


class Contacts(NamedTuple):
    """The shapes whose overlap counts, for compiled code."""

    stack_joints: Ints
    """(K,) the joints in whose frames the ellipses are."""
    ellipses: Floats
    """(K, E, 4): height, centre in depth, half depth, half width in metres; heights in even steps."""
    point_joints: Ints
    """(2 P,) the joints in whose frames the points are; the left arm's come first."""
    points_m: Floats
    """(2 P, 3)"""

    @classmethod
    def of(cls, body: Body) -> "Contacts":
        """The shapes of a body."""
        stacks = [SEGMENT_INDEX[name] for name in _STACKS]
        joints, points_m = list[int](), list[Floats]()
        for side in SIDES:
            forearm, hand = (JOINT_INDEX[f"{side}_{name}"] for name in ("elbow", "wrist"))
            tip_m = np.zeros(3)
            across_m = body.vertices_m[SEGMENT_INDEX[f"{side}_hand"]][:, 1]
            tip_m[1] = across_m[np.argmax(np.abs(across_m))]
            joints += [forearm] * len(_FOREARM_SHARES) + [hand] * len(_HAND_SHARES)
            points_m += [share * body.offsets_m[hand] for share in _FOREARM_SHARES]
            points_m += [share * tip_m for share in _HAND_SHARES]
        return cls(
            SEGMENT_JOINTS[stacks],
            np.array(
                [_stack(body.vertices_m[s], body.faces[s], _LOWEST_HEIGHTS * body.height_m) for s in stacks]
            ),
            np.array(joints, np.int32),
            np.array(points_m),
        )


def _stack(vertices_m: Floats, faces: Ints, lowest_m: float) -> Floats:
    """(E, 4) ellipses around the sections of a closed mesh above a height, as in Contacts."""
    ends_m = vertices_m[np.concatenate([faces[:, [k, k - 1]] for k in range(3)])]  # of edges
    low_m, high_m = max(vertices_m[:, 2].min(), lowest_m), vertices_m[:, 2].max()
    rows = []
    for height_m in np.linspace(low_m, high_m, _ELLIPSES + 2)[1:-1]:
        above = ends_m[:, :, 2] > height_m
        a, b = ends_m[above[:, 0] != above[:, 1]].transpose(1, 2, 0)
        share = (height_m - a[2]) / (b[2] - a[2])
        depths_m, widths_m = (a + share * (b - a))[:2]
        back_m, front_m = depths_m.min(), depths_m.max()
        rows.append((height_m, (back_m + front_m) / 2, (front_m - back_m) / 2, np.abs(widths_m).max()))
    return np.array(rows)


def depths_m(contacts: Contacts, offsets_m: Floats, poses: Floats) -> Floats:
    """(N, 2) how deep the left and the right arm's axis is inside, at its deepest point, in poses (N, D)."""
    found = np.zeros((len(poses), len(SIDES)))
    _depths(contacts, offsets_m, np.ascontiguousarray(poses), _ALL_JOINTS, found)
    return found


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _depths(contacts: Contacts, offsets_m: Floats, poses: Floats, joints: Ints, found: Floats) -> None:
    T_world_joint, out = np.empty((N_JOINTS, 4, 4)), np.empty(3)
    n_points = len(contacts.points_m) // 2
    for n in range(len(poses)):
        place_joints(poses[n], offsets_m, joints, T_world_joint)
        for p in range(2 * n_points):
            depth_m, _ = _deepest(contacts, p, T_world_joint, out)
            found[n, p // n_points] = max(found[n, p // n_points], depth_m)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_contacts(
    contacts: Contacts,
    weight: float,
    T_world_joint: Floats,
    twists: Floats,
    hessian: Floats,
    slope: Floats,
) -> float:
    """Add the cost weight x depth² of every point to the normal equations (D, D) and (D,); returns the sum.

    Only the parameters of the arms take it: the trunk stays where the contours put it.
    """
    out, row, cost = np.empty(3), np.empty(N_DOF), 0.0
    for p in range(len(contacts.points_m)):
        depth_m, point_m = _deepest(contacts, p, T_world_joint, out)
        if depth_m <= 0.0:
            continue
        cost += weight * depth_m * depth_m
        for d in range(N_DOF):
            row[d] = 0.0
            joint = DOF_JOINT[d]
            if MOVED_BY[joint, contacts.point_joints[p]] and not MOVED_BY[joint, _SHOULDER_CARRIER]:
                row[d] = -np.dot(out, np.cross(twists[d, :3], point_m) + twists[d, 3:])
                slope[d] += weight * row[d] * depth_m
        for d in range(N_DOF):
            if row[d] != 0.0:
                for e in range(N_DOF):
                    hessian[d, e] += weight * row[d] * row[e]
    return cost


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _deepest(contacts: Contacts, p: int, T_world_joint: Floats, out: Floats) -> tuple[float, Floats]:
    """How deep a point is in the stack where it is deepest (0: outside), and its place in the world.

    The depth is (1 - radius) of the ellipse's smaller half axis. out (3,) becomes minus its slope in the
    world, which leads out; that an ellipse changes with height is left out.
    """
    T, point_m, deepest_m = T_world_joint[contacts.point_joints[p]], np.empty(3), 0.0
    for i in range(3):
        point_m[i] = T[i, 3]
        for k in range(3):
            point_m[i] += T[i, k] * contacts.points_m[p, k]
    local_m = np.empty(3)
    for k in range(len(contacts.stack_joints)):
        T_stack, rows = T_world_joint[contacts.stack_joints[k]], contacts.ellipses[k]
        for i in range(3):
            local_m[i] = 0.0
            for j in range(3):
                local_m[i] += T_stack[j, i] * (point_m[j] - T_stack[j, 3])
        at = (local_m[2] - rows[0, 0]) / (rows[1, 0] - rows[0, 0])
        low = int(np.floor(at))
        if low < 0 or low >= len(rows) - 1:
            continue
        _, centre_m, depth_m, width_m = rows[low] + (at - low) * (rows[low + 1] - rows[low])
        u, v = (local_m[0] - centre_m) / depth_m, local_m[1] / width_m
        radius, thinnest_m = np.sqrt(u * u + v * v), min(depth_m, width_m)
        if (1.0 - radius) * thinnest_m > deepest_m and radius > _CENTRAL:
            deepest_m = (1.0 - radius) * thinnest_m
            for i in range(3):
                slope = T_stack[i, 0] * u / depth_m + T_stack[i, 1] * v / width_m
                out[i] = slope * thinnest_m / radius
    return deepest_m, point_m
