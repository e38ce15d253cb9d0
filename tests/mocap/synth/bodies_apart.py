"""A coarse check that body parts keep out of each other: limbs as capsules, the trunk as a flat cylinder."""

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import joint_transforms
from services.mocap.body.skeleton import JOINT_INDEX, SIDES
from services.mocap.types import Floats

Capsules = dict[str, tuple[Floats, float]]
"""Part -> nine points along its bone (N, 9, 3) and its radius in metres."""
_NEIGHBOURS = [{f"{s}_{a}", f"{s}_{b}"} for s in SIDES for a, b in (("forearm", "hand"), ("shank", "foot"))]
_NEIGHBOURS += [{f"{s}_thigh", f"{s}_shank"} for s in SIDES]
_TRUNK_DEPTH, _TRUNK_WIDTH, _TRUNK_TOP = (
    0.066,
    0.094,
    0.29,
)  # body heights: half axes, and the shoulders' height


def capsules(poses: Floats, body: Body) -> Capsules:
    T, h = joint_transforms(poses, body.offsets_m), body.height_m
    parts = {"head": (_place(T, "head", 0.01, 0, 0.02, h), _place(T, "head", 0.01, 0, 0.06, h), 0.045)}
    for side, out in zip(SIDES, (1.0, -1.0), strict=True):
        elbow, wrist, hip, knee, ankle = (
            _place(T, f"{side}_{joint}", 0, 0, 0, h) for joint in ("elbow", "wrist", "hip", "knee", "ankle")
        )
        parts[f"{side}_forearm"] = (elbow, wrist, 0.023)
        parts[f"{side}_hand"] = (wrist, _place(T, f"{side}_wrist", 0, 0.086 * out, 0, h), 0.02)
        parts[f"{side}_thigh"] = (0.75 * hip + 0.25 * knee, knee, 0.034)
        parts[f"{side}_shank"] = (knee, ankle, 0.025)
        parts[f"{side}_foot"] = (ankle, _place(T, f"{side}_ankle", 0.075, 0, -0.017, h), 0.02)
    shares = np.linspace(0.0, 1.0, 9)[:, None]
    return {name: (a[:, None] + (b - a)[:, None] * shares, r * h) for name, (a, b, r) in parts.items()}


def _place(T: Floats, joint: str, x: float, y: float, z: float, height_m: float) -> Floats:
    """(N, 3) a point in a joint's frame, in body heights, in the world."""
    place: Floats = T[:, JOINT_INDEX[joint]] @ np.array([x * height_m, y * height_m, z * height_m, 1.0])
    return place[:, :3]


def deepest_overlap_m(poses: Floats, body: Body) -> tuple[float, str]:
    """How deep two limbs, or a limb and the head, go into each other at most, and which."""
    parts = list(capsules(poses, body).items())
    worst = (-np.inf, "")
    for i, (name, (a_m, a_radius_m)) in enumerate(parts):
        for other, (b_m, b_radius_m) in parts[:i]:
            if {name, other} not in _NEIGHBOURS:
                gaps_m = np.linalg.norm(a_m[:, :, None] - b_m[:, None], axis=3).min(axis=(1, 2))
                frame = int(gaps_m.argmin())
                depth_m = a_radius_m + b_radius_m - float(gaps_m[frame])
                worst = max(worst, (depth_m, f"{name}, {other}, frame {frame}"))
    return worst


def nearest_to_trunk(poses: Floats, body: Body) -> float:
    """How near forearms and hands come to the trunk's axis, in its radius and theirs; 1 touches."""
    T, h = joint_transforms(poses, body.offsets_m), body.height_m
    nearest = np.inf
    for name, (points_m, radius_m) in capsules(poses, body).items():
        if name.endswith(("forearm", "hand")):
            points_m = points_m[:, 3:] if name.endswith("forearm") else points_m
            local = np.einsum("nij,nki->nkj", T[:, 0, :3, :3], points_m - T[:, 0, None, :3, 3])
            share = np.hypot(
                local[..., 0] / (_TRUNK_DEPTH * h + radius_m), local[..., 1] / (_TRUNK_WIDTH * h + radius_m)
            )
            beside = (local[..., 2] > -0.05 * h) & (local[..., 2] < _TRUNK_TOP * h)
            nearest = min(nearest, float(share[beside].min(initial=np.inf)))
    return nearest
