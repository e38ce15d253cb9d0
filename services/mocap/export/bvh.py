"""Motion as a BVH file.

BVH's world is y-up and the actor faces +z at heading zero, left hand on +x: BVH's axes (x, y, z) are the
axes (y, z, x) of the world inside. The file's rest pose is the skeleton's T pose.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.atomic import atomic_file
from services.mocap.body.kinematics import joint_transforms
from services.mocap.body.skeleton import JOINT_INDEX, JOINT_NAMES, JOINTS
from services.mocap.camera.camera import R_ZUP_YUP
from services.mocap.motion.root import nearest_angles
from services.mocap.types import Floats

_UNITS_PER_METRE = {"m": 1.0, "cm": 100.0}
_DECIMALS = 7
"""Digits after the point, of lengths in the file's unit and of angles in degrees (1e-7° is 1.7e-9 rad)."""

# Hands and feet have no joint at their end: their bones get a tip. Lengths in body heights, as the
# skeleton's after Drillis and Contini 1966: hand 0.108, forearm 0.152; the toes lie 0.110 before the ankle
# and 0.040 below it, the shank is 0.242 long.
_HAND_PER_FOREARM = 0.108 / 0.152
_TOES_PER_SHANK: Floats = np.array([0.110, 0.0, -0.040]) / 0.242

_TIPS = ("left_wrist", "left_ankle", "right_wrist", "right_ankle")
_TIP_INDEX = {name: len(JOINT_NAMES) + i for i, name in enumerate(_TIPS)} | {"head": JOINT_INDEX["head_top"]}


def write_bvh(
    path: Path, poses: Floats, offsets_m: Floats, fps: float, *, unit: Literal["m", "cm"] = "m"
) -> None:
    """Write poses as a BVH file, whole or not at all.

    poses: (N, 35) in metres and radians in the z-up world inside, N >= 1. offsets_m: (17, 3), each joint
    relative to its parent in the rest pose. unit: of the file's lengths. The angles go on from frame to
    frame without jumps: a second full turn ends at 720°. Raises ValueError on no frames, on another shape
    and on numbers that are not finite.
    """
    if len(poses) == 0 or not np.isfinite(poses).all():
        raise ValueError("poses: expected at least one, of finite numbers")
    scale = _UNITS_PER_METRE[unit]
    motion = _motion(joint_transforms(poses, offsets_m), scale)
    hierarchy = "\n".join(_joint_lines("pelvis", _with_tips(offsets_m) @ R_ZUP_YUP * scale))
    with atomic_file(path) as temporary, temporary.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"HIERARCHY\n{hierarchy}\nMOTION\nFrames: {len(poses)}\nFrame Time: {1.0 / fps:.10f}\n")
        np.savetxt(file, motion, fmt=f"%.{_DECIMALS}f")


def _motion(T_world_joint: Floats, scale: float) -> Floats:
    """The file's numbers (N, 3 + 16 * 3): root position in file units, then degrees in the file's order."""
    R_world_joint = T_world_joint[:, :, :3, :3]
    R_local = R_world_joint.copy()
    for joint in JOINTS:
        if joint.parent is not None:
            R_world_parent = R_world_joint[:, JOINT_INDEX[joint.parent]]
            R_local[:, JOINT_INDEX[joint.name]] = (
                R_world_parent.transpose(0, 2, 1) @ R_world_joint[:, JOINT_INDEX[joint.name]]
            )
    written = [JOINT_INDEX[name] for name in _written_joints("pelvis")]
    angles_deg = np.degrees(_continuous_angles_rad(R_ZUP_YUP.T @ R_local[:, written] @ R_ZUP_YUP))
    root = T_world_joint[:, 0, :3, 3] @ R_ZUP_YUP * scale
    motion = np.column_stack([root, angles_deg.reshape(len(root), -1)])
    return np.round(motion, _DECIMALS) + 0.0  # no -0.0000000


def _continuous_angles_rad(R: Floats) -> Floats:
    """Angles (N, J, 3) of turns about z, then the new x, then the new y, of R (N, J, 3, 3), without jumps."""
    n_frames, n_joints = R.shape[:2]
    angles: Floats = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_euler("ZXY", suppress_warnings=True)
    angles = angles.reshape(n_frames, n_joints, 3)
    previous = np.zeros((n_joints, 3))
    for frame in range(n_frames):
        previous = angles[frame] = nearest_angles(angles[frame], previous)
    return angles


def _children(name: str) -> list[str]:
    return [joint.name for joint in JOINTS if joint.parent == name]


def _written_joints(name: str) -> Iterator[str]:
    """Names of the joints that get channels, in the file's order; head_top is only a tip."""
    if name != "head_top":
        yield name
        for child in _children(name):
            yield from _written_joints(child)


def _with_tips(offsets_m: Floats) -> Floats:
    """(17 + 4, 3): the offsets, the root's zero, then the tips at the `_TIPS`, relative to their joints."""
    tips_m = []
    for name in _TIPS:
        bone_m = offsets_m[JOINT_INDEX[name]]
        is_hand = name.endswith("wrist")
        tips_m.append(_HAND_PER_FOREARM * bone_m if is_hand else _TOES_PER_SHANK * np.linalg.norm(bone_m))
    # The root's place comes from its position channels alone: readers differ in whether its offset adds.
    return np.vstack([np.zeros((1, 3)), offsets_m[1:], tips_m])


def _joint_lines(name: str, offsets: Floats, depth: int = 0) -> Iterator[str]:
    """The hierarchy's lines for a joint and all below it; offsets as of `_with_tips` in the file's axes."""
    indent, inner = "  " * depth, "  " * (depth + 1)
    yield f"{indent}{'JOINT' if depth else 'ROOT'} {name}"
    yield f"{indent}{{"
    yield f"{inner}{_offset(offsets[JOINT_INDEX[name]])}"
    position, count = ("", 3) if depth else ("Xposition Yposition Zposition ", 6)
    yield f"{inner}CHANNELS {count} {position}Zrotation Xrotation Yrotation"
    if name in _TIP_INDEX:
        yield f"{inner}End Site"
        yield f"{inner}{{"
        yield f"{inner}  {_offset(offsets[_TIP_INDEX[name]])}"
        yield f"{inner}}}"
    else:
        for child in _children(name):
            yield from _joint_lines(child, offsets, depth + 1)
    yield f"{indent}}}"


def _offset(offset: Floats) -> str:
    x, y, z = np.round(offset, _DECIMALS) + 0.0
    return f"OFFSET {x:.{_DECIMALS}f} {y:.{_DECIMALS}f} {z:.{_DECIMALS}f}"
