"""What joints are called in motion.bvh and by the bridge: our own names, or those that other tools know."""

from typing import Literal, TypeAlias

from services.mocap.body.skeleton import JOINT_NAMES, SIDES

Naming: TypeAlias = Literal["xormocap", "mixamo", "cmu", "unity"]

_COLUMNS: tuple[Naming, ...] = ("mixamo", "cmu", "unity")
_CENTRE: dict[str, tuple[str, str, str]] = {
    "pelvis": ("Hips", "Hips", "Hips"),
    "waist": ("Spine", "LowerBack", "Spine"),
    "neck": ("Neck", "Neck", "Neck"),
    "head": ("Head", "Head", "Head"),
}
_SIDED: dict[str, tuple[str, str, str]] = {
    "shoulder": ("Arm", "Arm", "UpperArm"),
    "elbow": ("ForeArm", "ForeArm", "LowerArm"),
    "wrist": ("Hand", "Hand", "Hand"),
    "hip": ("UpLeg", "UpLeg", "UpperLeg"),
    "knee": ("Leg", "Leg", "LowerLeg"),
    "ankle": ("Foot", "Foot", "Foot"),
}
"""Our joint -> its bone's name in Mixamo's skeletons, in those of the CMU database as BVH, and in Unity's
humanoid (HumanBodyBones), which VRM and VMC follow."""


def bone_names(naming: Naming) -> dict[str, str]:
    """Our joint -> its name in the file, for all that get channels (head_top is only a tip)."""
    if naming == "xormocap":
        return {name: name for name in JOINT_NAMES if name != "head_top"}
    column = _COLUMNS.index(naming)
    names = {joint: row[column] for joint, row in _CENTRE.items()}
    for side in SIDES:
        names |= {f"{side}_{joint}": f"{side.title()}{row[column]}" for joint, row in _SIDED.items()}
    prefix = "mixamorig:" if naming == "mixamo" else ""
    return {joint: prefix + name for joint, name in names.items()}
