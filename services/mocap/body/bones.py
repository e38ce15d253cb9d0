"""Bones: lengths that may differ between people, and the parts that each stretches."""

from dataclasses import dataclass

import numpy as np

from services.mocap.body.skeleton import JOINTS, bare
from services.mocap.body.skeleton_table import ROWS
from services.mocap.types import Floats


@dataclass(frozen=True)
class Bone:
    """A length that may differ between people, and the parts that it stretches, on both sides."""

    length_heights: float
    """The generic body's length, in body heights."""
    joints: dict[str, int]
    """Joint (without its side) -> the axis of its offset from its parent that scales with this bone."""
    segments: dict[str, str]
    """Segment (without its side) -> the axes of its mesh that scale with this bone."""


_STRETCHED_BY = {row.joint: row.offset_bones for row in ROWS} | {
    row.tip.joint: {row.section.axes[0]: row.name} for row in ROWS if row.tip and row.tip.joint
}
"""Joint (without its side) -> the axes of its offset from its parent, and the bones that stretch them."""
BONES: dict[str, Bone] = {
    length.bone: Bone(
        length.length_heights,
        {
            joint: "xyz".index(axis)
            for joint, stretched_by in _STRETCHED_BY.items()
            for axis, bone in stretched_by.items()
            if bone == length.bone
        },
        {row.name: length.mesh_axes} if length.mesh_axes else {},
    )
    for row in ROWS
    for length in row.lengths
}
"""The trunk's mesh widens too: with shoulder_width at the shoulders and above, with the hip joints at the
hips and below, and smoothly between."""

_JOINTS_OF = {
    name: [
        (j, bone.joints[bare(joint.name)])
        for j, joint in enumerate(JOINTS)
        if bare(joint.name) in bone.joints
    ]
    for name, bone in BONES.items()
}
"""Bone -> the joints (their places in JOINTS) and the axes of their offsets that scale with it."""
_HIPS_SHARE = 0.536
"""Share of the trunk's width at the hips between the hip joints."""
_OVER_HIPS: dict[str | None, float] = {None: 0.0}
for _row in ROWS:  # parents precede children; sums of the table's decimals, without the error of binary ones
    _OVER_HIPS[_row.joint] = round(_OVER_HIPS[_row.parent] + _row.offset_heights[2], 6)
"""Joint (without its side) -> its height over the hips' in the rest pose, in body heights."""
_TRUNK_OFFSETS = {row.name: _OVER_HIPS[row.joint] for row in ROWS if row.part == "torso"}
"""The trunk's segments, and the height of their joints over the hips'."""


def scales_across(segment: str, ratios: dict[str, float]) -> Floats:
    """(3,) stretch of a segment (without its side) along its frame's axes.

    ratios: bone -> its length over the generic one; those left out are 1.
    """
    scales = np.ones(3)
    for name, ratio in ratios.items():
        for axis in BONES[name].segments.get(segment, ""):
            scales["xyz".index(axis)] *= ratio
    return scales


def stretched_offsets(offsets: Floats, ratios: dict[str, float]) -> Floats:
    """(J, 3) joints relative to their parents, stretched along the bones by ratios."""
    stretched = offsets.copy()
    for name, ratio in ratios.items():
        for j, axis in _JOINTS_OF[name]:
            stretched[j, axis] *= ratio
    return stretched


def trunk_ratios(segment: str, ratios: dict[str, float]) -> tuple[float, float]:
    """The ratios of the widths at hips and shoulders for a segment of the trunk; 1 for others."""
    if segment not in _TRUNK_OFFSETS:
        return 1.0, 1.0
    return ratios.get("hip_width", 1.0), ratios.get("shoulder_width", 1.0)


def trunk_widening(segment: str, z_heights: Floats, hips: float, shoulders: float) -> Floats | float:
    """(V,) factor of the trunk's width at heights (V,), in body heights in the segment's frame.

    1 for other segments. hips, shoulders: ratios of the widths there (trunk_ratios).
    """
    if segment not in _TRUNK_OFFSETS:
        return 1.0
    at_hips = 1.0 + _HIPS_SHARE * (hips - 1.0)
    share = smoothstep((z_heights + _TRUNK_OFFSETS[segment]) / _OVER_HIPS["shoulder"])
    return at_hips + (shoulders - at_hips) * share


def smoothstep(t: Floats) -> Floats:
    """0 below 0, 1 above 1, and smoothly from one to the other between."""
    within: Floats = np.clip(t, 0.0, 1.0)
    return within * within * (3.0 - 2.0 * within)
