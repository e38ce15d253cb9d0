"""Poses for Unity's humanoid skeleton.

Unity's world is left-handed: x right, y up, z forward for an actor with heading zero. Bones have Unity's
names (HumanBodyBones); they rotate relative to their parents, and no bone is rotated in the T pose.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.body.humanoid_names import bone_names
from services.mocap.body.kinematics import joint_transforms
from services.mocap.body.skeleton import JOINT_INDEX
from services.mocap.motion.motion import rest_rotations, turns_from_rest
from services.mocap.types import Floats

R_UNITY_ZUP: Floats = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""From the z-up world's axes (x ahead, y left, z up) to Unity's; it mirrors, since that is left-handed."""
BONES: dict[str, str] = bone_names("unity")
"""Our joint -> the bone of Unity's humanoid that turns there, one for each segment."""
_JOINTS = [JOINT_INDEX[joint] for joint in BONES]


@dataclass(frozen=True)
class Bone:
    """Position and rotation of a bone."""

    name: str
    position_m: tuple[float, ...]
    """(3,) position of its joint in the parent bone's axes; for the hips, in the world."""
    rotation_xyzw: tuple[float, ...]
    """(4,) rotation relative to the parent bone; for the hips, to the world."""


def bones_of(pose: Floats, offsets_m: Floats) -> list[Bone]:
    """The bones of a pose (D,), parents first. offsets_m: (J, 3), as joint_transforms takes them."""
    T_world_joint = joint_transforms(pose[None], offsets_m)
    turns = turns_from_rest(T_world_joint, rest_rotations("T"))[0, _JOINTS]
    quaternions = Rotation.from_matrix(R_UNITY_ZUP @ turns @ R_UNITY_ZUP.T).as_quat(canonical=True)
    places_m = offsets_m.copy()
    places_m[0] = T_world_joint[0, 0, :3, 3]
    positions_m = places_m[_JOINTS] @ R_UNITY_ZUP.T
    return [
        Bone(name, tuple(position), tuple(quaternion))
        for name, position, quaternion in zip(
            BONES.values(), positions_m.tolist(), quaternions.tolist(), strict=True
        )
    ]
