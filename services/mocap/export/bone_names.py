"""What joints are called in motion.bvh: our own names, or those that other tools know."""

from typing import Literal, TypeAlias

from services.mocap.body.skeleton import JOINT_NAMES, SIDES

Naming: TypeAlias = Literal["xormocap", "mixamo", "cmu"]

_CENTRE: dict[str, tuple[str, str]] = {
    "pelvis": ("Hips", "Hips"),
    "waist": ("Spine", "LowerBack"),
    "neck": ("Neck", "Neck"),
    "head": ("Head", "Head"),
}
_SIDED: dict[str, tuple[str, str]] = {
    "shoulder": ("Arm", "Arm"),
    "elbow": ("ForeArm", "ForeArm"),
    "wrist": ("Hand", "Hand"),
    "hip": ("UpLeg", "UpLeg"),
    "knee": ("Leg", "Leg"),
    "ankle": ("Foot", "Foot"),
}
"""Our joint -> its bone's name in Mixamo's skeletons, and in those of the CMU database as BVH."""


def bone_names(naming: Naming) -> dict[str, str]:
    """Our joint -> its name in the file, for all that get channels (head_top is only a tip)."""
    if naming == "xormocap":
        return {name: name for name in JOINT_NAMES if name != "head_top"}
    column = 0 if naming == "mixamo" else 1
    names = {joint: row[column] for joint, row in _CENTRE.items()}
    for side in SIDES:
        names |= {f"{side}_{joint}": f"{side.title()}{row[column]}" for joint, row in _SIDED.items()}
    prefix = "mixamorig:" if naming == "mixamo" else ""
    return {joint: prefix + name for joint, name in names.items()}
