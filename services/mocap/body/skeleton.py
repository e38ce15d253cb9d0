"""The one table of the body: 17 joints, 16 segments, 35 degrees of freedom.

The rest pose (all parameters zero) is an upright T pose: x forward, y to the actor's left, z up; arms
along ±y with the palms down, legs straight down. Every joint frame is parallel to the body frame there.
A parameter means the same movement on both sides (positive elbow flexion bends either elbow).

Rotations: a joint turns by a swing (the rotation vector made of its swing parameters) after a twist about
the bone. This keeps ball joints free of gimbal lock wherever the swing stays below half a turn. The root
turns by heading about z, then side lean about x, then pitch about y; its only singularity is a side lean
of a quarter turn.
"""

from dataclasses import dataclass
from math import inf, radians
from typing import Literal

import numpy as np

from services.mocap.types import Floats

Role = Literal["translation", "heading", "lean", "pitch", "swing", "twist"]
Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")


@dataclass(frozen=True)
class Joint:
    """A joint and where it sits in the rest pose."""

    name: str
    parent: str | None
    offset_heights: tuple[float, float, float]
    """Position relative to the parent joint in the rest pose, in body heights."""


@dataclass(frozen=True)
class Dof:
    """One pose parameter."""

    name: str
    joint: str
    role: Role
    axis: tuple[float, float, float]
    """Unit axis in the joint frame, of a positive turn (right-hand rule) or shift."""
    lower: float
    upper: float

    @property
    def unit(self) -> Literal["m", "rad"]:
        """The parameter's unit."""
        return "m" if self.role == "translation" else "rad"

    @property
    def column(self) -> str:
        """The parameter's column in poses.csv: its name and its unit."""
        return f"{self.name}_{self.unit}"


def _mirror_point(point: tuple[float, float, float], side: Side) -> tuple[float, float, float]:
    x, y, z = point
    return (x, y, z) if side == "left" else (x, -y, z)


def _mirror_axis(axis: tuple[float, float, float], side: Side) -> tuple[float, float, float]:
    """An axis of rotation is a pseudovector: mirroring in y keeps y and turns x and z round."""
    x, y, z = axis
    return (x, y, z) if side == "left" else (-x, y, -z)


# Joint centres in body heights, after de Leva 1996 (J. Biomechanics 29(9)) and Drillis and Contini 1966.
# head_top ends the chain; the waist joins pelvis and torso rigidly (as one body in the paper).
_CENTRE_JOINTS = (
    Joint("pelvis", None, (0.0, 0.0, 0.0)),
    Joint("waist", "pelvis", (0.0, 0.0, 0.075)),
    Joint("neck", "waist", (0.0, 0.0, 0.248)),
    Joint("head", "neck", (0.006, 0.0, 0.058)),
    Joint("head_top", "head", (0.010, 0.0, 0.094)),
)
_LEFT_JOINTS = (
    ("shoulder", "waist", (0.0, 0.1075, 0.205)),
    ("elbow", "shoulder", (0.0, 0.165, 0.0)),
    ("wrist", "elbow", (0.0, 0.152, 0.0)),
    ("hip", "pelvis", (0.0, 0.0525, 0.0)),
    ("knee", "hip", (0.0, 0.0, -0.243)),
    ("ankle", "knee", (0.0, 0.0, -0.242)),
)
PELVIS_HEIGHT = 0.525
"""Height of the hip centres over the sole, in body heights, when standing upright in the rest pose."""


def _limb_joints(side: Side) -> tuple[Joint, ...]:
    def sided(name: str) -> str:
        return name if name in ("waist", "pelvis") else f"{side}_{name}"

    return tuple(
        Joint(f"{side}_{name}", sided(parent), _mirror_point(offset, side))
        for name, parent, offset in _LEFT_JOINTS
    )


JOINTS: tuple[Joint, ...] = _CENTRE_JOINTS + _limb_joints("left") + _limb_joints("right")
JOINT_NAMES: tuple[str, ...] = tuple(joint.name for joint in JOINTS)
JOINT_INDEX: dict[str, int] = {name: i for i, name in enumerate(JOINT_NAMES)}

# Segment -> the joint that carries it, in the order of every (…, 16, …) array.
SEGMENT_JOINT: dict[str, str] = {
    "pelvis": "pelvis",
    "torso": "waist",
    "neck": "neck",
    "head": "head",
    **{
        f"{side}_{segment}": f"{side}_{joint}"
        for side in SIDES
        for segment, joint in (
            ("upper_arm", "shoulder"),
            ("forearm", "elbow"),
            ("hand", "wrist"),
            ("thigh", "hip"),
            ("shank", "knee"),
            ("foot", "ankle"),
        )
    },
}
SEGMENT_NAMES: tuple[str, ...] = tuple(SEGMENT_JOINT)
SEGMENT_INDEX: dict[str, int] = {name: i for i, name in enumerate(SEGMENT_NAMES)}


_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_DOWN = (0.0, 0.0, -1.0)
_NEGATIVE_Y, _NEGATIVE_X = (0.0, -1.0, 0.0), (-1.0, 0.0, 0.0)

_CENTRE_DOFS = (
    Dof("root_x", "pelvis", "translation", _X, -inf, inf),
    Dof("root_y", "pelvis", "translation", _Y, -inf, inf),
    Dof("root_z", "pelvis", "translation", _Z, -inf, inf),
    Dof("root_heading", "pelvis", "heading", _Z, -inf, inf),
    Dof("root_lean", "pelvis", "lean", _X, -inf, inf),
    Dof("root_pitch", "pelvis", "pitch", _Y, -inf, inf),
    Dof("head_pitch", "neck", "swing", _Y, radians(-60), radians(70)),
    Dof("head_lean", "neck", "swing", _X, radians(-50), radians(50)),
    Dof("head_turn", "neck", "twist", _Z, radians(-80), radians(80)),
)
# (name, joint, role, axis on the left, lower, upper in degrees). The T pose is the shoulder's zero, so
# that an arm hanging down, forward or overhead is about a quarter turn of swing away.
_LEFT_DOFS: tuple[tuple[str, str, Role, tuple[float, float, float], float, float], ...] = (
    ("shoulder_elevation", "shoulder", "swing", _X, -115.0, 100.0),
    ("shoulder_forward", "shoulder", "swing", (0.0, 0.0, -1.0), -70.0, 140.0),
    ("shoulder_twist", "shoulder", "twist", _NEGATIVE_Y, -100.0, 100.0),
    ("elbow_flexion", "elbow", "swing", (0.0, 0.0, -1.0), 0.0, 150.0),
    ("wrist_flexion", "wrist", "swing", _NEGATIVE_X, -75.0, 80.0),
    ("wrist_deviation", "wrist", "swing", (0.0, 0.0, -1.0), -35.0, 25.0),
    ("wrist_twist", "wrist", "twist", _NEGATIVE_Y, -90.0, 90.0),
    ("hip_flexion", "hip", "swing", _NEGATIVE_Y, -40.0, 130.0),
    ("hip_abduction", "hip", "swing", _X, -35.0, 75.0),
    ("hip_twist", "hip", "twist", _DOWN, -50.0, 50.0),
    ("knee_flexion", "knee", "swing", _Y, -8.0, 150.0),
    ("ankle_flexion", "ankle", "swing", _NEGATIVE_Y, -55.0, 35.0),
    ("ankle_inversion", "ankle", "swing", _NEGATIVE_X, -30.0, 30.0),
)


def _limb_dofs(side: Side) -> tuple[Dof, ...]:
    return tuple(
        Dof(f"{side}_{name}", f"{side}_{joint}", role, _mirror_axis(axis, side), radians(low), radians(high))
        for name, joint, role, axis, low, high in _LEFT_DOFS
    )


DOFS: tuple[Dof, ...] = _CENTRE_DOFS + _limb_dofs("left") + _limb_dofs("right")
DOF_NAMES: tuple[str, ...] = tuple(dof.name for dof in DOFS)
DOF_INDEX: dict[str, int] = {name: i for i, name in enumerate(DOF_NAMES)}
LOWER: Floats = np.array([dof.lower for dof in DOFS])
UPPER: Floats = np.array([dof.upper for dof in DOFS])


def dofs_of(*joints: str) -> tuple[int, ...]:
    """Indices into a pose of the parameters that turn or shift the named joints."""
    return tuple(i for i, dof in enumerate(DOFS) if dof.joint in joints)


def dof_range(joint: str) -> tuple[int, int]:
    """The first of a joint's parameters, which stand in a row in a pose, and the one after the last."""
    dofs = dofs_of(joint)
    return (dofs[0], dofs[0] + len(dofs)) if dofs else (0, 0)


def segments_below(joint: str) -> tuple[int, ...]:
    """Indices of the segments that move when the joint turns, itself included."""
    moved = {joint}
    for candidate in JOINTS:  # parents precede children
        if candidate.parent in moved:
            moved.add(candidate.name)
    return tuple(i for i, carrier in enumerate(SEGMENT_JOINT.values()) if carrier in moved)
