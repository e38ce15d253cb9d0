"""Our joints' names in other humanoid skeletons: those that we understand, and those that we write.

Knows the names of mocap databases and tools (CMU, ACCAD, Mixamo, HumanIK, Rokoko, Xsens, Perception Neuron,
Poser, DAZ, Biped, Unreal, VRM, Rigify, MakeHuman, SMPL) and our own. A bone is identified by the joint at
which it rotates.
"""

import re
from collections.abc import Iterable
from typing import Literal, TypeAlias

from services.mocap.body.segment_row import Tool
from services.mocap.body.skeleton import SEGMENTS, Side, sided

Naming: TypeAlias = Literal["xormocap", Tool]
# Our joint and its side -> other names, without side, case, separators and numbers; the first one in a
# skeleton is used, because some names depend on others: HumanIK's LeftShoulder is the collar bone beside a
# LeftArm, SMPL's L_Foot the toes beside an L_Ankle.
_ALIASES = {(segment.joint, segment.side): segment.row.aliases for segment in SEGMENTS}
_ALIASES |= {
    (sided(tip.joint, segment.side), segment.side): tip.aliases
    for segment in SEGMENTS
    if (tip := segment.row.tip) and tip.joint
}
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_SIDE_WORDS = {"left": "left", "l": "left", "right": "right", "r": "right"}
_PREFIXES = {"bip", "j", "c", "def", "org", "cc", "base", "character", "ctrl", "armature", "mixamorig", "b"}
"""Prefixes that tools add to names."""


def matched_joints(names: Iterable[str]) -> dict[str, str]:
    """Our joint -> the bone among `names` that rotates there, for all joints that can be identified.

    Of numbered bones (spine_01, spine_02, …) the first in `names` is used; `names` should be ordered parents
    first.
    """
    known: dict[tuple[Side | None, str], str] = {}
    for name in names:
        known.setdefault(_plain(name), name)
    found: dict[str, str] = {}
    for (joint, side), aliases in _ALIASES.items():
        bones = [known[side, alias] for alias in aliases if (side, alias) in known]
        if bones:
            found[joint] = bones[0]
    return found


def bone_names(naming: Naming) -> dict[str, str]:
    """Our joint -> what it is called in files of that naming, for all joints that carry a segment."""
    if naming == "xormocap":
        return {segment.joint: segment.joint for segment in SEGMENTS}
    prefix = "mixamorig:" if naming == "mixamo" else ""
    return {
        segment.joint: f"{prefix}{(segment.side or '').title()}{segment.row.tool_names[naming]}"
        for segment in SEGMENTS
    }


def _plain(name: str) -> tuple[Side | None, str]:
    """Side and bare lower-case name of a bone: (left, upperarm) for `J_Bip_L_UpperArm` and `upperarm01.L`."""
    words = [word.lower() for word in _WORD.findall(name.rpartition(":")[2])]
    sides = [_SIDE_WORDS[word] for word in words if word in _SIDE_WORDS]
    words = [word for word in words if word not in _SIDE_WORDS and not word.isdigit()]
    while len(words) > 1 and words[0] in _PREFIXES:
        words.pop(0)
    side: Side | None = None if not sides else ("left" if sides[0] == "left" else "right")
    return side, "".join(words)
