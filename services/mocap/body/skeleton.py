"""The skeleton: joints, segments and pose parameters in their order, as skeleton_table.py has them.

What is on the body's plane of symmetry comes first, then the left, then the right side.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, get_args

import numpy as np

from services.mocap.body.segment_row import Parameter, SegmentRow, Vector
from services.mocap.body.skeleton_table import ROWS
from services.mocap.types import Floats

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")
BodyName: TypeAlias = Literal["anatomical", "paper"]
"""Whose parameters vary: all of the table, or only those of the published body; the others stay zero."""


@dataclass(frozen=True)
class Joint:
    """A joint and its position in the rest pose."""

    name: str
    parent: str | None
    offset_heights: Vector
    """Position relative to the parent joint in the rest pose, in body heights."""


@dataclass(frozen=True)
class Segment:
    """A rigid segment of the body."""

    name: str
    joint: str
    """The joint that carries it."""
    part: str
    """Which of services.mocap.take.marks.PARTS it belongs to."""
    side: Side | None
    row: SegmentRow
    """What the table says of it."""


@dataclass(frozen=True)
class Dof(Parameter):
    """One pose parameter, on its side of the body."""

    joint: str = field(kw_only=True)

    @property
    def unit(self) -> Literal["m", "rad"]:
        """The parameter's unit."""
        return "m" if self.role == "translation" else "rad"

    @property
    def column(self) -> str:
        """The parameter's column in poses.csv: its name and its unit."""
        return f"{self.name}_{self.unit}"


def sided(name: str, side: Side | None) -> str:
    """A name of the table with its side before it, where it has one."""
    return name if side is None else f"{side}_{name}"


def bare(name: str) -> str:
    """The name of a joint, segment or part without its side."""
    return name.removeprefix("left_").removeprefix("right_")


def mirrored(vector: Vector, side: Side | None, *, is_axis: bool = False) -> Vector:
    """A point of the left side on a side; an axis of rotation, a pseudovector, turns round besides."""
    x, y, z = vector
    if side != "right":
        return vector
    return (-x, y, -z) if is_axis else (x, -y, z)


def _joints() -> Iterator[Joint]:
    paired = {row.joint: row.paired for row in ROWS}
    for segment in SEGMENTS:
        row, side = segment.row, segment.side
        parent = row.parent and sided(row.parent, side if paired[row.parent] else None)
        yield Joint(segment.joint, parent, mirrored(row.offset_heights, side))
        if row.tip is not None and row.tip.joint is not None:
            yield Joint(sided(row.tip.joint, side), segment.joint, mirrored(row.tip.offset_heights, side))


SEGMENTS: tuple[Segment, ...] = tuple(
    Segment(sided(row.name, side), sided(row.joint, side), sided(row.part, side), side, row)
    for side in (None, *SIDES)
    for row in ROWS
    if row.paired == (side is not None)
)
SEGMENT_JOINT: dict[str, str] = {segment.name: segment.joint for segment in SEGMENTS}
"""Segment -> the joint that carries it, in the order of every (…, S, …) array."""
SEGMENT_NAMES: tuple[str, ...] = tuple(SEGMENT_JOINT)
SEGMENT_INDEX: dict[str, int] = {name: i for i, name in enumerate(SEGMENT_NAMES)}
TRUNK: tuple[str, ...] = tuple(segment.name for segment in SEGMENTS if segment.part == "torso")
"""The segments to which head and limbs are attached."""

JOINTS: tuple[Joint, ...] = tuple(_joints())
JOINT_NAMES: tuple[str, ...] = tuple(joint.name for joint in JOINTS)
JOINT_INDEX: dict[str, int] = {name: i for i, name in enumerate(JOINT_NAMES)}
SEGMENT_AT: dict[str, str] = {joint: name for name, joint in SEGMENT_JOINT.items()}
"""Joint -> the segment that it carries."""
SEGMENT_PARENTS: dict[str, str | None] = {
    name: SEGMENT_AT.get(JOINTS[JOINT_INDEX[joint]].parent or "") for name, joint in SEGMENT_JOINT.items()
}
"""Segment -> the segment that carries it; None for the pelvis."""
TIP_JOINTS: tuple[str, ...] = tuple(name for name in JOINT_NAMES if name not in SEGMENT_AT)
"""Joints that carry no segment but end one: they never turn."""

DOFS: tuple[Dof, ...] = tuple(
    Dof(
        sided(row.name, segment.side),
        row.role,
        mirrored(row.axis, segment.side, is_axis=True),
        row.lower_deg,
        row.upper_deg,
        row.rest,
        row.in_paper,
        joint=segment.joint,
    )
    for segment in SEGMENTS
    for row in segment.row.parameters
)
DOF_NAMES: tuple[str, ...] = tuple(dof.name for dof in DOFS)
DOF_INDEX: dict[str, int] = {name: i for i, name in enumerate(DOF_NAMES)}
LOWER: Floats = np.radians([dof.lower_deg for dof in DOFS])
UPPER: Floats = np.radians([dof.upper_deg for dof in DOFS])
"""(D,) the joint limits, in the parameters' units."""
BODY_DOFS: dict[BodyName, tuple[int, ...]] = {
    body: tuple(i for i, dof in enumerate(DOFS) if body == "anatomical" or dof.in_paper)
    for body in get_args(BodyName)
}
"""Indices into a pose of the parameters that vary."""


def dofs_of(*joints: str) -> tuple[int, ...]:
    """Indices into a pose of the parameters of the named joints."""
    return tuple(i for i, dof in enumerate(DOFS) if dof.joint in joints)


def pose_of_body(poses: Floats, body: BodyName) -> Floats:
    """A copy of poses (…, D) in which the parameters that a body lacks are zero."""
    posed = np.zeros_like(poses)
    posed[..., BODY_DOFS[body]] = poses[..., BODY_DOFS[body]]
    return posed


def segments_below(joint: str) -> tuple[int, ...]:
    """Indices of the segments that move when the joint rotates."""
    moved = {joint}
    for candidate in JOINTS:  # parents precede children
        if candidate.parent in moved:
            moved.add(candidate.name)
    return tuple(i for i, carrier in enumerate(SEGMENT_JOINT.values()) if carrier in moved)
