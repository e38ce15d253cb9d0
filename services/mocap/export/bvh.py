"""Motion as a BVH file.

BVH's world is y-up and the actor faces +z at heading zero, left hand on +x: BVH's axes (x, y, z) are the
axes (y, z, x) of the world inside. The file's rest pose is an upright T or A pose.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np

from services.mocap.atomic import atomic_file
from services.mocap.body.humanoid_names import Naming, bone_names
from services.mocap.body.kinematics import joint_transforms
from services.mocap.body.skeleton import JOINT_INDEX, JOINTS, SEGMENTS, TIP_JOINTS, mirrored
from services.mocap.motion.motion import Rest, rest_rotations, rotations_to_y_up, to_y_up, turns_from_rest
from services.mocap.motion.root import continuous_angles
from services.mocap.types import Floats

_UNITS_PER_METRE = {"m": 1.0, "cm": 100.0}
_DECIMALS = 7
"""Digits after the point, of lengths in the file's unit and of angles in degrees (1e-7° is 1.7e-9 rad)."""

_TIPS_HEIGHTS = {
    segment.joint: np.array(mirrored(tip.offset_heights, segment.side))
    for segment in SEGMENTS
    if (tip := segment.row.tip) and tip.joint is None
}
"""Hands and feet have no joint at their end: their bones get a tip, here for the generic body."""
_TIP_INDEX = {name: len(JOINTS) + i for i, name in enumerate(_TIPS_HEIGHTS)} | {
    joint.parent: JOINT_INDEX[joint.name] for joint in JOINTS if joint.parent and joint.name in TIP_JOINTS
}


def write_bvh(
    path: Path,
    poses: Floats,
    offsets_m: Floats,
    fps: float,
    *,
    unit: Literal["m", "cm"] = "m",
    rest: Rest = "T",
    naming: Naming = "xormocap",
) -> None:
    """Write poses as a BVH file, completely or not at all.

    poses: (N, D) in metres and radians in the z-up world inside, N >= 1. offsets_m: (J, 3), each joint
    relative to its parent in the skeleton's T pose. unit: of the file's lengths. rest: the pose of the file's
    offsets, in which all angles are zero. Angles are continuous from frame to frame: a second full turn ends
    at 720°. Raises ValueError for no frames, a wrong shape and numbers that are not finite.
    """
    if len(poses) == 0 or not np.isfinite(poses).all():
        raise ValueError("poses: expected at least one, of finite numbers")
    scale, R_world_rest = _UNITS_PER_METRE[unit], rest_rotations(rest)
    motion = _motion(joint_transforms(poses, offsets_m), R_world_rest, scale)
    offsets = to_y_up(_with_tips(offsets_m, R_world_rest)) * scale
    hierarchy = "\n".join(_joint_lines("pelvis", offsets, bone_names(naming)))
    with atomic_file(path) as temporary, temporary.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"HIERARCHY\n{hierarchy}\nMOTION\nFrames: {len(poses)}\nFrame Time: {1.0 / fps:.10f}\n")
        np.savetxt(file, motion, fmt=f"%.{_DECIMALS}f")


def _motion(T_world_joint: Floats, R_world_rest: Floats, scale: float) -> Floats:
    """The file's numbers (N, 3 + S * 3): root position in file units, then degrees in the file's order."""
    written = [JOINT_INDEX[name] for name in _written_joints("pelvis")]
    turns = rotations_to_y_up(turns_from_rest(T_world_joint, R_world_rest)[:, written])
    angles_deg = np.degrees(continuous_angles(turns))
    root = to_y_up(T_world_joint[:, 0, :3, 3]) * scale
    motion = np.column_stack([root, angles_deg.reshape(len(root), -1)])
    return np.round(motion, _DECIMALS) + 0.0  # no -0.0000000


def _children(name: str) -> list[str]:
    return [joint.name for joint in JOINTS if joint.parent == name]


def _written_joints(name: str) -> Iterator[str]:
    """Names of the joints that get channels, in the file's order, which tips do not."""
    if name not in TIP_JOINTS:
        yield name
        for child in _children(name):
            yield from _written_joints(child)


def _with_tips(offsets_m: Floats, R_world_rest: Floats) -> Floats:
    """(J + T, 3) places against the parents in a rest pose: the joints, the root's zero, then the T tips.

    offsets_m: of a body, in the T pose. R_world_rest: (J, 3, 3) of the rest pose.
    """
    tips_m = []
    for name, tip_heights in _TIPS_HEIGHTS.items():
        j = JOINT_INDEX[name]
        m_per_height = np.linalg.norm(offsets_m[j]) / np.linalg.norm(JOINTS[j].offset_heights)
        tips_m.append(tip_heights * m_per_height)  # as long as the bone before it says
    carriers = [*(joint.parent for joint in JOINTS[1:]), *_TIPS_HEIGHTS]
    R_world_carrier = R_world_rest[[JOINT_INDEX[name] for name in carriers if name]]
    turned_m = np.einsum("jab,jb->ja", R_world_carrier, np.vstack([offsets_m[1 : len(JOINTS)], tips_m]))
    # The root's position comes only from its position channels: some readers add its offset, others do not.
    return np.vstack([np.zeros((1, 3)), turned_m])


def _joint_lines(name: str, offsets: Floats, names: dict[str, str], depth: int = 0) -> Iterator[str]:
    """The hierarchy's lines for a joint and all below it; offsets as of `_with_tips` in the file's axes."""
    indent, inner = "  " * depth, "  " * (depth + 1)
    yield f"{indent}{'JOINT' if depth else 'ROOT'} {names[name]}"
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
            yield from _joint_lines(child, offsets, names, depth + 1)
    yield f"{indent}}}"


def _offset(offset: Floats) -> str:
    x, y, z = np.round(offset, _DECIMALS) + 0.0
    return f"OFFSET {x:.{_DECIMALS}f} {y:.{_DECIMALS}f} {z:.{_DECIMALS}f}"
