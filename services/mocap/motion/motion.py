"""A body in motion, the source of every motion file; its joints' turns counted from a rest pose."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF, joint_transforms
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, JOINTS, SIDES
from services.mocap.camera.camera import R_ZUP_YUP
from services.mocap.types import Floats, Ints

Rest: TypeAlias = Literal["T", "A"]
_ARMS_RAD: dict[str, float] = {"T": 0.0, "A": -np.pi / 4, "hanging": -np.pi / 2}


@dataclass(frozen=True, eq=False)
class Motion:
    """Poses of one body in consecutive frames, N >= 1."""

    name: str
    """The take's."""
    fps: float
    frames: Ints
    """(N,) the frames' numbers in the take."""
    times_s: Floats
    """(N,) the frames' times in the take."""
    poses: Floats
    """(N, D) in metres and radians."""
    body: Body

    @cached_property
    def T_world_joint(self) -> Floats:
        """(N, J, 4, 4) in the z-up world, in the order of JOINT_NAMES."""
        return joint_transforms(self.poses, self.body.offsets_m)


def to_y_up(points_zup: Floats) -> Floats:
    """Points or offsets (…, 3) of the z-up world in the axes of motion.bvh, .glb and .trc.

    These are y-up; z is where an actor with heading zero faces, x is to the actor's left.
    """
    return points_zup @ R_ZUP_YUP


def rotations_to_y_up(R_zup: Floats) -> Floats:
    """Rotations (…, 3, 3) of the z-up world in those axes."""
    return R_ZUP_YUP.T @ R_zup @ R_ZUP_YUP


def rest_pose(rest: Literal["T", "A", "hanging"]) -> Floats:
    """The pose (D,) of somebody upright with straight limbs, in metres and radians.

    The arms point sideways (T), half way down (A) or down (hanging: palms towards the thighs).
    """
    pose = np.zeros(N_DOF)
    for side in SIDES:
        pose[DOF_INDEX[f"{side}_shoulder_elevation"]] = _ARMS_RAD[rest]
    return pose


def rest_rotations(rest: Literal["T", "A", "hanging"]) -> Floats:
    """R_world_joint (J, 3, 3) of a rest pose; that of the T pose is 1 for all."""
    return joint_transforms(rest_pose(rest)[None], np.zeros((len(JOINTS), 3)))[0, :, :3, :3]


def turns_from_rest(T_world_joint: Floats, R_world_rest: Floats) -> Floats:
    """How each joint is turned against its parent (N, J, 3, 3), counted from a rest pose.

    T_world_joint: (N, J, 4, 4). R_world_rest: (J, 3, 3) of the rest pose, in which all rotations are the
    identity. The frames are parallel to the world's axes in the rest pose.
    """
    R_world_joint = T_world_joint[:, :, :3, :3] @ R_world_rest.transpose(0, 2, 1)
    turns = R_world_joint.copy()
    for j, joint in enumerate(JOINTS):
        if joint.parent is not None:
            R_world_parent = R_world_joint[:, JOINT_INDEX[joint.parent]]
            turns[:, j] = R_world_parent.transpose(0, 2, 1) @ R_world_joint[:, j]
    return turns
