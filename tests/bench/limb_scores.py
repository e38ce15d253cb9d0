"""Joint errors, lost limbs, and right and wrong marks: found joints against those of another body model.

What one body model calls a hip or the top of a head lies elsewhere in another one, by some centimetres that
are the same in every frame. Errors leave that out; lost limbs do not. Joints are in millimetres, (F, 15, 3),
in the order of REFERENCE_JOINTS, found and true ones in one world.
"""

from dataclasses import dataclass

import numpy as np

from services.mocap.take.marks import PARTS, Marks, Part, doubtful_parts
from services.mocap.take.tables import REFERENCE_JOINTS
from services.mocap.types import Floats, Mask

LOST_MM = 150.0
"""A limb with a joint farther off than this is lost."""
RIGHT_MM = 75.0
"""A limb whose joints are all nearer than this is right, and a mark on it false."""
MOST_DEFINITION_MM = 60.0
"""No body models differ more than this in where they put a joint."""
LIMBS: dict[Part, tuple[str, str]] = {
    "left_arm": ("left_elbow", "left_wrist"),
    "right_arm": ("right_elbow", "right_wrist"),
    "left_leg": ("left_knee", "left_ankle"),
    "right_leg": ("right_knee", "right_ankle"),
}
"""The joints by which a limb is judged."""
BONES = {
    "upper_arm": ("left_shoulder", "left_elbow"),
    "forearm": ("left_elbow", "left_wrist"),
    "thigh": ("left_hip", "left_knee"),
    "shank": ("left_knee", "left_ankle"),
}
"""Bones whose ends are the same joints in every body model, nearly."""
_ON_TRUNK = {
    "hip": ("pelvis", "left_hip", "right_hip"),
    "shoulder": ("left_shoulder", "right_shoulder", "neck", "head_top"),
}
"""Pair of joints that spans a frame -> the joints whose place in it is a matter of definition."""
_INDEX = {name: j for j, name in enumerate(REFERENCE_JOINTS)}
_LIMB_PARTS = [PARTS.index(limb) for limb in LIMBS]


@dataclass(frozen=True)
class Errors:
    """How far joints are off, over all frames and joints."""

    mean_mm: float
    p95_mm: float
    """The 95th percentile."""
    raw_mean_mm: float
    """The mean without leaving out what is a matter of definition."""
    lost_percent: float
    """Of the limb-frames (each limb in each frame)."""


@dataclass(frozen=True)
class MarkErrors:
    """How right the marks are, in per cent of the limb-frames."""

    silent_percent: float
    """Lost without a mark on the limb or the torso."""
    false_percent: float
    """Marked and right."""
    marked_percent: float


def errors_of(found_mm: Floats, true_mm: Floats) -> Errors:
    """The errors of F frames."""
    raw_mm = np.linalg.norm(found_mm - true_mm, axis=2)
    off_mm = np.linalg.norm(without_definition(found_mm - true_mm, true_mm), axis=2)
    return Errors(
        mean_mm=float(off_mm.mean()),
        p95_mm=float(np.percentile(off_mm, 95)),
        raw_mean_mm=float(raw_mm.mean()),
        lost_percent=_percent(limb_errors_mm(found_mm, true_mm) > LOST_MM),
    )


def mark_errors_of(limbs_mm: Floats, marked: Mask) -> MarkErrors:
    """limbs_mm (F, 4) as limb_errors_mm has them; marked (F, 4) as marked_limbs has them."""
    return MarkErrors(
        silent_percent=_percent((limbs_mm > LOST_MM) & ~marked),
        false_percent=_percent((limbs_mm < RIGHT_MM) & marked),
        marked_percent=_percent(marked),
    )


def limb_errors_mm(found_mm: Floats, true_mm: Floats) -> Floats:
    """(F, 4) how far the worse joint of each of LIMBS is off."""
    off_mm = np.linalg.norm(found_mm - true_mm, axis=2)
    return np.stack([off_mm[:, [_INDEX[j] for j in joints]].max(axis=1) for joints in LIMBS.values()], axis=1)


def marked_limbs(marks: Marks | None, n_frames: int) -> Mask:
    """(F, 4) whether each of LIMBS is marked, or the whole body."""
    if marks is None:
        return np.zeros((n_frames, len(LIMBS)), bool)
    return np.asarray(doubtful_parts(marks.distrusted)[:, _LIMB_PARTS], bool)


def limb_confidence(marks: Marks | None, n_frames: int) -> Floats:
    """(F, 4) the confidence of each of LIMBS; NaN where it was not judged."""
    if marks is None:
        return np.full((n_frames, len(LIMBS)), np.nan)
    return marks.confidence[:, _LIMB_PARTS]


def bones_off_percent(found_mm: Floats, true_lengths_m: dict[str, float]) -> dict[str, float]:
    """Bone -> its found length, the median over F frames, over the true one, less one."""
    off = {}
    for bone, (upper, lower) in BONES.items():
        if bone in true_lengths_m:
            lengths_mm = np.linalg.norm(found_mm[:, _INDEX[upper]] - found_mm[:, _INDEX[lower]], axis=1)
            off[bone] = 100.0 * (float(np.median(lengths_mm)) / (1000.0 * true_lengths_m[bone]) - 1.0)
    return off


def without_definition(off_mm: Floats, true_mm: Floats) -> Floats:
    """Offsets (F, 15, 3) of joints; of those on the trunk less their mean in the frame of pelvis or chest."""
    left_out = off_mm.copy()
    for pair, joints in _ON_TRUNK.items():
        R_world_trunk = _trunk_rotations(true_mm, pair)
        for j in (_INDEX[joint] for joint in joints):
            mean_mm = np.einsum("fij,fi->fj", R_world_trunk, off_mm[:, j]).mean(axis=0)
            length_mm = float(np.linalg.norm(mean_mm))
            share = 1.0 if length_mm <= MOST_DEFINITION_MM else MOST_DEFINITION_MM / length_mm
            left_out[:, j] -= R_world_trunk @ (share * mean_mm)
    return left_out


def _trunk_rotations(joints_mm: Floats, pair: str) -> Floats:
    """(F, 3, 3) with the columns left, forward and up, of the trunk at its hips or shoulders."""
    left = joints_mm[:, _INDEX[f"left_{pair}"]] - joints_mm[:, _INDEX[f"right_{pair}"]]
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    up = joints_mm[:, _INDEX["neck"]] - joints_mm[:, _INDEX["pelvis"]]
    up -= left * (up * left).sum(axis=1, keepdims=True)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    return np.stack([left, np.cross(up, left), up], axis=2)


def _percent(found: Mask) -> float:
    return 100.0 * float(found.mean())
