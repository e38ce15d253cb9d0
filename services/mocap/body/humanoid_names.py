"""Which bone of somebody else's humanoid skeleton is which of our joints, told by its name.

Knows the names of mocap databases and tools (CMU, ACCAD, Mixamo, HumanIK, Rokoko, Xsens, Perception Neuron,
Poser, DAZ, Biped, Unreal, VRM, Rigify, MakeHuman, SMPL) and our own. A bone is named by the joint at which it
turns.
"""

import re
from collections.abc import Iterable
from typing import Literal

from services.mocap.body.skeleton import SIDES

# Our joint -> other names, without side, case, separators and numbers; the first one that a skeleton has
# wins, since many names say different things beside others: HumanIK's LeftShoulder is the collar bone beside
# a LeftArm, SMPL's L_Foot the toes beside an L_Ankle.
_CENTRE_ALIASES: dict[str, tuple[str, ...]] = {
    "pelvis": ("hips", "pelvis", "hip", "root"),
    "waist": ("waist", "lowerback", "abdomen", "abdomenlower", "tospine", "spine", "chest", "torso"),
    "neck": ("neck", "necklower", "lowerneck"),
    "head": ("head",),
    "head_top": ("headtop", "headtopend", "headend", "headnub", "headsite"),
}
_SIDE_ALIASES: dict[str, tuple[str, ...]] = {
    "shoulder": ("upperarm", "uparm", "shldr", "shldrbend", "arm", "humerus", "shoulder"),
    "elbow": ("elbow", "forearm", "lowerarm", "lowarm", "lorearm", "forearmbend", "radius"),
    "wrist": ("wrist", "hand"),
    "hip": ("upleg", "upperleg", "thigh", "thighbend", "femur", "hip"),
    "knee": ("knee", "lowleg", "lowerleg", "shin", "calf", "shank", "tibia", "leg"),
    "ankle": ("ankle", "foot"),
}
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_SIDE_WORDS = {"left": "left", "l": "left", "right": "right", "r": "right"}
_PREFIXES = {"bip", "j", "c", "def", "org", "cc", "base", "character", "ctrl", "armature", "mixamorig", "b"}
"""Words that tools put before the name proper."""


def matched_joints(names: Iterable[str]) -> dict[str, str]:
    """Our joint -> the bone among `names` that turns there, for all joints that can be told.

    Of numbered bones (spine_01, spine_02, …) the first counts, in the order of `names`, which should be that
    of the hierarchy, parents first.
    """
    known: dict[tuple[Side, str], str] = {}
    for name in names:
        known.setdefault(_plain(name), name)
    found: dict[str, str] = {}
    for joint, aliases in _CENTRE_ALIASES.items():
        _take_first(found, joint, None, aliases, known)
    for side in SIDES:
        for joint, aliases in _SIDE_ALIASES.items():
            _take_first(found, f"{side}_{joint}", side, aliases, known)
    return found


Side = Literal["left", "right"] | None


def _take_first(
    found: dict[str, str],
    joint: str,
    side: Side,
    aliases: tuple[str, ...],
    known: dict[tuple[Side, str], str],
) -> None:
    for alias in aliases:
        if (side, alias) in known:
            found[joint] = known[side, alias]
            return


def _plain(name: str) -> tuple[Side, str]:
    """Side and bare lower-case name of a bone: (left, upperarm) for `J_Bip_L_UpperArm` and `upperarm01.L`."""
    words = [word.lower() for word in _WORD.findall(name.rpartition(":")[2])]
    sides = [_SIDE_WORDS[word] for word in words if word in _SIDE_WORDS]
    words = [word for word in words if word not in _SIDE_WORDS and not word.isdigit()]
    while len(words) > 1 and words[0] in _PREFIXES:
        words.pop(0)
    side: Side = None if not sides else ("left" if sides[0] == "left" else "right")
    return side, "".join(words)
