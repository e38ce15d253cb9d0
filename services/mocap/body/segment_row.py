"""What a row of the skeleton's table says: the types of skeleton_table.py."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Literal, TypeAlias

from services.mocap.body.shape_loft import Loft

Vector: TypeAlias = tuple[float, float, float]
Role: TypeAlias = Literal["translation", "heading", "lean", "pitch", "swing", "twist"]
Tool: TypeAlias = Literal["mixamo", "cmu", "unity"]
"""Whose names for bones are known: Mixamo's skeletons, those of the CMU database as BVH, and Unity's humanoid
(HumanBodyBones), which VRM and VMC follow."""


@dataclass(frozen=True)
class Parameter:
    """One pose parameter of a joint."""

    name: str
    role: Role
    axis: Vector
    """Unit axis in the joint frame, of a positive rotation (right-hand rule) or translation."""
    lower_deg: float = -inf
    upper_deg: float = inf
    rest: float = 0.0
    """How firmly an alignment draws it to zero, against the firmest. Zero is a straight hand, a foot square
    to the shank, an upright waist and no twist of a limb: silhouettes tell these least, and people are seldom
    far from it."""
    in_paper: bool = True
    """Whether the body of Theobalt et al. 2003 has it."""


@dataclass(frozen=True)
class Length:
    """A bone's length, or the distance of two joints, that may differ between people."""

    bone: str
    length_heights: float
    """The generic body's, in body heights."""
    mesh_axes: str
    """The axes of the segment's mesh that it stretches."""
    deviation: float
    """Standard deviation of the logarithm of its factor over the generic body's."""
    lowest: float
    """The smallest factor that a fit may find."""
    highest: float
    mean_factor: float = 1.0
    """People's mean length over the generic body's, both over stature."""
    looks_changed_by_clothes: bool = False
    """Whether loose clothes can look like a change of it."""


@dataclass(frozen=True)
class Section:
    """How a segment lies in its frame, which is the body's in the rest pose."""

    axes: str
    """The frame axes along its bone, of its width and of its depth."""
    start: float
    """Where along the bone the first control of its profile lies, in body heights from the carrying joint."""
    end: float
    """Position of the last one."""


@dataclass(frozen=True)
class Turns:
    """How a joint's turn is taken apart into anatomical angles."""

    order: Literal["ZXY", "YXZ", "YXY"]
    """The axes about which it turns, one after the other, each in the frame turned so far."""
    named: tuple[tuple[str, int, str], ...]
    """Of the first turns (all three but for a hinge): name; sign, -1 where the movement that counts as
    positive turns against the right-hand rule; the positive movement in words."""


@dataclass(frozen=True)
class Tip:
    """Where the last segment of a chain ends."""

    offset_heights: Vector
    """From the joint that carries the segment, in body heights in the rest pose."""
    joint: str | None = None
    """The name of a joint without parameters there, if it is one."""
    aliases: tuple[str, ...] = ()


@dataclass(frozen=True)
class SegmentRow:
    """All that is said of a segment and of the joint that carries it; of a pair, on the left."""

    name: str
    joint: str
    """The joint that carries it."""
    parent: str | None
    """The joint that carries that joint; None for the root."""
    offset_heights: Vector
    """From the parent to the joint in the rest pose, in body heights."""
    offset_bones: Mapping[str, str]
    """Axis -> the bone with whose length that offset grows."""
    paired: bool
    """Whether there is one for the left and one for the right side."""
    part: Literal["torso", "head", "arm", "leg"]
    """Which chain of the search turns the joint, and to what part its pixels count."""
    window_px: int
    """The search's window in pictures 320 pixels wide: the whole picture (0), a limb's, or a smaller one
    for what is turned last."""
    parameters: tuple[Parameter, ...]
    angles: tuple[Turns, ...]
    """What angles.csv lists: of the joint against the segment above, of the root against the world."""
    lengths: tuple[Length, ...]
    section: Section
    width: tuple[str, ...]
    """The shape parameters that control its width, evenly spaced along its section."""
    depth: tuple[str, ...]
    lofts: tuple[Loft, ...]
    """Its closed surfaces."""
    garment: Literal["shirt", "skin", "trousers", "shoes"]
    """What it wears in synthetic takes."""
    aliases: tuple[str, ...]
    """Names of the joint in other skeletons, as humanoid_names takes them."""
    tool_names: Mapping[Tool, str] = field(default_factory=dict)
    """What tools call the joint, without the side."""
    continued_by: str | None = None
    """The segment whose bone goes on straight in its own."""
    tip: Tip | None = None
