"""Arms inside the trunk or the head, and legs inside each other: how deep they are, and what pulls them out.

In silhouettes an arm before the trunk and one inside it look alike, and so do one leg and two in its place.
The trunk, the head and the legs are taken as stacks of ellipses, limbs as points on their axes: a point at
the surface is a limb half inside.
"""

from typing import NamedTuple

import numba
import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF, N_JOINTS, PARENT, SEGMENT_JOINTS, place_frames
from services.mocap.body.skeleton import JOINT_INDEX, SEGMENT_INDEX, SIDES, TRUNK
from services.mocap.search.alignment.twists import DOF_JOINT, MOVED_BY, cross
from services.mocap.take.marks import LIMB_NAMES
from services.mocap.types import Floats, Ints, Mask

_ELLIPSES = 24
_NOTHING_M = 1e-3
"""Half axes of a section that is empty."""
_AROUND_ARMS = (*TRUNK, "head")
_FOREARM_SHARES = (0.25, 0.5, 0.75, 1.0)
_HAND_SHARES = (0.33, 0.66, 0.9)
_THIGH_SHARES, _SHANK_SHARES = (0.6, 0.8, 1.0), (0.25, 0.5, 0.75, 1.0)
_LOWEST_HEIGHTS = -0.06
"""Of what counts, from a segment's joint, in body heights: skirts of own meshes hang lower and give way."""
_JOINTS: Ints = np.arange(N_JOINTS, dtype=np.int32)
_CENTRAL = 1e-3
"""Of an ellipse's radius: nearer to its centre no direction leads out."""


class Contacts(NamedTuple):
    """The shapes whose overlap counts, for compiled code."""

    stack_joints: Ints
    """(K,) the joints in whose frames the ellipses are: of the trunk, the head and the legs."""
    ellipses: Floats
    """(K, E, 4): height, centre in depth, half depth, half width in metres; heights in even steps."""
    point_joints: Ints
    """(P,) the joints in whose frames the points are."""
    points_m: Floats
    """(P, 3)"""
    point_limbs: Ints
    """(P,) the limb (LIMB_NAMES) that each point is of."""
    carriers: Ints
    """(P,) the joint that carries that limb; what moves it takes none of the cost."""
    counts: Mask
    """(P, K) which stacks a point must not be in: the trunk and the head for arms, the other leg for legs."""

    @classmethod
    def of(cls, body: Body) -> "Contacts":
        """The shapes of a body."""
        legs = [f"{side}_{bone}" for side in SIDES for bone in ("thigh", "shank")]
        names = [*_AROUND_ARMS, *legs]
        stacks = [SEGMENT_INDEX[name] for name in names]
        lowest_m = {"pelvis": _LOWEST_HEIGHTS * body.height_m}
        points = list[tuple[int, Floats, int, int, list[bool]]]()
        for limb, name in enumerate(LIMB_NAMES):
            side, part = name.split("_")
            carrier = int(PARENT[JOINT_INDEX[f"{side}_{'shoulder' if part == 'arm' else 'hip'}"]])
            other = "right" if side == "left" else "left"
            counts = [s in _AROUND_ARMS if part == "arm" else s.startswith(other) for s in names]
            points += [(joint, at_m, limb, carrier, counts) for joint, at_m in _axis(body, side, part)]
        joints, points_m, limbs, carriers, counted = zip(*points, strict=True)
        return cls(
            SEGMENT_JOINTS[stacks],
            np.array(
                [
                    _stack(body.vertices_m[s], body.faces[s], lowest_m.get(name, -np.inf))
                    for s, name in zip(stacks, names, strict=True)
                ]
            ),
            np.array(joints, np.int32),
            np.array(points_m),
            np.array(limbs, np.int32),
            np.array(carriers, np.int32),
            np.array(counted, bool),
        )


def _axis(body: Body, side: str, part: str) -> list[tuple[int, Floats]]:
    """Points on a limb's axis: the joint in whose frame each is, and its place there (3,) in metres."""
    near, far = (
        JOINT_INDEX[f"{side}_{name}"] for name in (("elbow", "wrist") if part == "arm" else ("knee", "ankle"))
    )
    if part == "leg":
        hip = JOINT_INDEX[f"{side}_hip"]
        thigh = [(hip, share * body.offsets_m[near]) for share in _THIGH_SHARES]
        return thigh + [(near, share * body.offsets_m[far]) for share in _SHANK_SHARES]
    tip_m = np.zeros(3)
    across_m = body.vertices_m[SEGMENT_INDEX[f"{side}_hand"]][:, 1]
    tip_m[1] = across_m[np.argmax(np.abs(across_m))]
    forearm = [(near, share * body.offsets_m[far]) for share in _FOREARM_SHARES]
    return forearm + [(far, share * tip_m) for share in _HAND_SHARES]


def _stack(vertices_m: Floats, faces: Ints, lowest_m: float) -> Floats:
    """(E, 4) ellipses around the sections of a closed mesh above a height, as in Contacts."""
    ends_m = vertices_m[np.concatenate([faces[:, [k, k - 1]] for k in range(3)])]  # of edges
    low_m, high_m = max(vertices_m[:, 2].min(), lowest_m), vertices_m[:, 2].max()
    rows = []
    for height_m in np.linspace(low_m, high_m, _ELLIPSES + 2)[1:-1]:
        above = ends_m[:, :, 2] > height_m
        crossing = ends_m[above[:, 0] != above[:, 1]]
        if not len(crossing):  # between pieces that hang apart, such as a head and its hat
            rows.append((height_m, 0.0, _NOTHING_M, _NOTHING_M))
            continue
        a, b = crossing.transpose(1, 2, 0)
        share = (height_m - a[2]) / (b[2] - a[2])
        depths_m, widths_m = (a + share * (b - a))[:2]
        back_m, front_m = depths_m.min(), depths_m.max()
        rows.append((height_m, (back_m + front_m) / 2, (front_m - back_m) / 2, np.abs(widths_m).max()))
    return np.array(rows)


def depths_m(contacts: Contacts, offsets_m: Floats, poses: Floats) -> Floats:
    """(N, 4) how deep the axis of each limb (LIMB_NAMES) is inside, at its deepest point, in poses (N, D)."""
    found = np.zeros((len(poses), len(LIMB_NAMES)))
    _depths(contacts, offsets_m, np.ascontiguousarray(poses), _JOINTS, found)
    return found


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _depths(contacts: Contacts, offsets_m: Floats, poses: Floats, joints: Ints, found: Floats) -> None:
    T_world_joint, point_m, out = np.empty((N_JOINTS, 4, 4)), np.empty(3), np.empty(3)
    for n in range(len(poses)):
        place_frames(poses[n], offsets_m, joints, T_world_joint)
        for p in range(len(contacts.points_m)):
            depth_m = _deepest(contacts, p, T_world_joint, point_m, out)
            limb = contacts.point_limbs[p]
            found[n, limb] = max(found[n, limb], depth_m)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_contacts(
    contacts: Contacts, weight: float, T_world_joint: Floats, twists: Floats, hessian: Floats, slope: Floats
) -> float:
    """Add the cost weight x depth² of every point to the normal equations (D, D) and (D,); returns the sum.

    Only the parameters of the limb itself take it: the trunk stays where the contours put it, and of two legs
    each is pulled out of the other.
    """
    point_m, out, moves_m, row, cost = np.empty(3), np.empty(3), np.empty(3), np.empty(N_DOF), 0.0
    for p in range(len(contacts.points_m)):
        depth_m = _deepest(contacts, p, T_world_joint, point_m, out)
        if depth_m <= 0.0:
            continue
        cost += weight * depth_m * depth_m
        for d in range(N_DOF):
            row[d] = 0.0
            joint = DOF_JOINT[d]
            if MOVED_BY[joint, contacts.point_joints[p]] and not MOVED_BY[joint, contacts.carriers[p]]:
                cross(twists[d, :3], point_m, moves_m)
                for i in range(3):
                    row[d] -= out[i] * (moves_m[i] + twists[d, 3 + i])
                slope[d] += weight * row[d] * depth_m
        for d in range(N_DOF):
            if row[d] != 0.0:
                for e in range(N_DOF):
                    hessian[d, e] += weight * row[d] * row[e]
    return cost


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _deepest(contacts: Contacts, p: int, T_world_joint: Floats, point_m: Floats, out: Floats) -> float:
    """How deep a point is in the stack where it is deepest (0: outside); writes its place in the world.

    The depth is (1 - radius) of the ellipse's smaller half axis. point_m (3,) becomes the point in the world,
    and out (3,) minus the depth's slope there, which leads out; that an ellipse changes with height is left
    out.
    """
    T, deepest_m = T_world_joint[contacts.point_joints[p]], 0.0
    for i in range(3):
        point_m[i] = T[i, 3]
        for k in range(3):
            point_m[i] += T[i, k] * contacts.points_m[p, k]
    for k in range(len(contacts.stack_joints)):
        if not contacts.counts[p, k]:
            continue
        T_stack, rows = T_world_joint[contacts.stack_joints[k]], contacts.ellipses[k]
        forward_m = left_m = up_m = 0.0  # in the stack's frame
        for j in range(3):
            off_m = point_m[j] - T_stack[j, 3]
            forward_m += T_stack[j, 0] * off_m
            left_m += T_stack[j, 1] * off_m
            up_m += T_stack[j, 2] * off_m
        at = (up_m - rows[0, 0]) / (rows[1, 0] - rows[0, 0])
        low = int(np.floor(at))
        if low < 0 or low >= len(rows) - 1:
            continue
        share, below, above = at - low, rows[low], rows[low + 1]
        centre_m = below[1] + share * (above[1] - below[1])
        depth_m = below[2] + share * (above[2] - below[2])
        width_m = below[3] + share * (above[3] - below[3])
        u, v = (forward_m - centre_m) / depth_m, left_m / width_m
        radius, thinnest_m = np.sqrt(u * u + v * v), min(depth_m, width_m)
        if (1.0 - radius) * thinnest_m > deepest_m and radius > _CENTRAL:
            deepest_m = (1.0 - radius) * thinnest_m
            for i in range(3):
                slope = T_stack[i, 0] * u / depth_m + T_stack[i, 1] * v / width_m
                out[i] = slope * thinnest_m / radius
    return float(deepest_m)
