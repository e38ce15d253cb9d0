"""Inverse kinematics of a leg: the hip, knee and ankle angles that put a foot where it should be.

The knee is a hinge and the ankle has no twist, so the leg's plane is turned about the line from hip to
ankle until the foot points where it should.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d, minimum_filter1d
from scipy.spatial.transform import Rotation

from services.mocap.body.kinematics import joint_transforms
from services.mocap.body.skeleton import DOF_INDEX, DOFS, JOINT_INDEX, Side, dofs_of
from services.mocap.types import Floats, Ints

_YAW_ROUNDS = 16  # each leaves a tenth to a third of the error of the one before


@dataclass(frozen=True, eq=False)
class FootTargets:
    """Where one foot is to be, frame by frame."""

    ankle_world_m: Floats
    """(N, 3) the ankle joint."""
    R_world_foot: Floats
    """(N, 3, 3) rotations."""

    def at(self, frames: Ints) -> "FootTargets":
        """The targets of some of the frames, given by index."""
        return FootTargets(self.ankle_world_m[frames], self.R_world_foot[frames])


def _bones_m(offsets_m: Floats, side: Side) -> Floats:
    """(2,) how long thigh and shank are; offsets_m (J, 3)."""
    below = offsets_m[[JOINT_INDEX[f"{side}_{joint}"] for joint in ("knee", "ankle")]]
    return np.asarray(np.linalg.norm(below, axis=1), np.float64)


def reach_m(offsets_m: Floats, side: Side) -> float:
    """The distance from hip to ankle with a straight knee; offsets_m (J, 3)."""
    return float(_bones_m(offsets_m, side).sum())


def hip_rises_m(
    poses: Floats, offsets_m: Floats, targets: dict[Side, FootTargets], bend: float
) -> dict[Side, Floats]:
    """By side how much higher (N,) the hip of poses (N, D) may be until the leg to its target is as straight
    as it gets: a share `bend` of its length."""
    hips_m, rises_m = joint_transforms(poses, offsets_m)[:, :, :3, 3], {}
    for side, target in targets.items():
        way_m = target.ankle_world_m - hips_m[:, JOINT_INDEX[f"{side}_hip"]]
        height2 = (bend * reach_m(offsets_m, side)) ** 2 - (way_m[:, :2] ** 2).sum(axis=1)
        rises_m[side] = np.asarray(way_m[:, 2] + np.sqrt(np.maximum(height2, 0.0)), np.float64)
    return rises_m


def smoothed_from_below(values: Floats, radius: int) -> Floats:
    """Values (N,) smoothed over some samples to both sides, never above the values themselves."""
    lowest = minimum_filter1d(values, 2 * radius + 1, mode="nearest")
    smooth: Floats = gaussian_filter1d(lowest, radius / 3, mode="nearest", truncate=3.0)
    return smooth


def put_feet(poses: Floats, offsets_m: Floats, targets: dict[Side, FootTargets]) -> Floats:
    """The (N, D) poses with the legs set so that the feet meet their targets, the root staying as it is.

    offsets_m: (J, 3), knee and ankle straight below the hip in the rest pose. A target out of reach gets a
    straight leg that points to it.
    """
    poses = poses.copy()
    T_world_joint = joint_transforms(poses, offsets_m)
    for side, target in targets.items():
        hip, knee = JOINT_INDEX[f"{side}_hip"], DOF_INDEX[f"{side}_knee_flexion"]
        R_pelvis_world = T_world_joint[:, 0, :3, :3].transpose(0, 2, 1)
        to_ankle_m = target.ankle_world_m - T_world_joint[:, hip, :3, 3]
        to_ankle_m = np.einsum("nij,nj->ni", R_pelvis_world, to_ankle_m)
        R_pelvis_foot = R_pelvis_world @ target.R_world_foot
        thigh_m, shank_m = _bones_m(offsets_m, side)
        distance_m = np.linalg.norm(to_ankle_m, axis=1)
        cosine = (distance_m**2 - thigh_m**2 - shank_m**2) / (2 * thigh_m * shank_m)
        flexion = np.arccos(np.clip(cosine, -1.0, 1.0))
        # How far the ankle then lies behind the thigh's line, about the hip's lateral axis.
        behind = np.arctan2(shank_m * np.sin(flexion), thigh_m + shank_m * np.cos(flexion))
        poses[:, knee] = flexion
        R_hip, R_ankle = _turn_leg_plane(to_ankle_m, behind, flexion, R_pelvis_foot)
        set_ball_joint(poses, f"{side}_hip", R_hip)
        set_ball_joint(poses, f"{side}_ankle", R_ankle)
    return poses


def _turn_leg_plane(
    to_ankle_m: Floats, behind: Floats, knee_flexion: Floats, R_pelvis_foot: Floats
) -> tuple[Floats, Floats]:
    """Rotations (N, 3, 3) of hip and ankle; the leg's plane is turned until the ankle needs no twist."""
    up = -to_ankle_m / np.linalg.norm(to_ankle_m, axis=1, keepdims=True)
    R_unbend = Rotation.from_euler("y", -behind[:, None]).as_matrix()
    R_knee = Rotation.from_euler("y", knee_flexion[:, None]).as_matrix()
    forward = R_pelvis_foot[:, :, 0]
    for _ in range(_YAW_ROUNDS):
        left = np.cross(up, forward)
        left /= np.linalg.norm(left, axis=1, keepdims=True)
        R_hip = np.stack([np.cross(left, up), left, up], axis=2) @ R_unbend
        R_ankle = (R_hip @ R_knee).transpose(0, 2, 1) @ R_pelvis_foot
        swing = _swing_of_axis(R_ankle, np.array([0.0, 0.0, 1.0]))
        twist = (swing.inv() * Rotation.from_matrix(R_ankle)).as_rotvec()[:, 2]
        forward = Rotation.from_rotvec(twist[:, None] * up).apply(forward)
    return R_hip, R_ankle


def set_ball_joint(poses: Floats, joint: str, R_parent_joint: Floats) -> None:
    """Write rotations (N, 3, 3) into a joint's parameters in poses (N, D): the swing, then the twist.

    Where the joint has no twist parameter, the rotation's twist is left out.
    """
    rows = dofs_of(joint)
    twist_axis = np.array(next((DOFS[i].axis for i in rows if DOFS[i].role == "twist"), (0.0, 0.0, 1.0)))
    swing = _swing_of_axis(R_parent_joint, twist_axis)
    twist = swing.inv() * Rotation.from_matrix(R_parent_joint)
    for i in rows:
        turned = twist if DOFS[i].role == "twist" else swing
        poses[:, i] = turned.as_rotvec() @ np.array(DOFS[i].axis)


def _swing_of_axis(R: Floats, axis: Floats) -> Rotation:
    """The shortest rotations that turn an axis (3,) as R (N, 3, 3) do; not defined for half a turn."""
    turned = R @ axis
    normal = np.cross(axis, turned)
    sine = np.linalg.norm(normal, axis=1, keepdims=True)
    angle = np.arctan2(sine, (turned @ axis)[:, None])
    return Rotation.from_rotvec(normal * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 1e-12))
