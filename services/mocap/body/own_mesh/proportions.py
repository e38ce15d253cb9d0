"""Brings a character into our skeleton's rest pose, and to the common proportions of all meshes."""

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.body.body_mesh import BodyMesh, SegmentMesh
from services.mocap.body.bones import BONES, scales_across, stretched_offsets, trunk_ratios, trunk_widening
from services.mocap.body.own_mesh.character import Character, Piece
from services.mocap.body.skeleton import (
    JOINT_INDEX,
    JOINTS,
    SEGMENT_JOINT,
    SEGMENT_NAMES,
    SEGMENTS,
    SIDES,
    bare,
)
from services.mocap.body.skeleton_table import ROWS
from services.mocap.body.surface import MIRROR
from services.mocap.errors import UserError
from services.mocap.types import Floats

_WAIST_SHARE = BONES["pelvis"].length_heights / (
    BONES["pelvis"].length_heights + BONES["torso"].length_heights
)
"""Where the waist is on the way from the hips to the neck."""
_SNAP_COS = np.cos(np.radians(25.0))
"""An axis of the file this near to the body's axis is used instead of it: people lean slightly."""
_RATIO_RANGE = (0.25, 4.0)
"""Allowed bone lengths over the generic ones: outside, it is not a human, or a bone has a wrong name."""


def in_rest_pose(character: Character) -> Character:
    """The character upright, facing x, in a T pose with straight limbs; the hips' middle is the origin."""
    R = _into_body_axes(character.joints)
    at = {name: R @ position for name, position in character.joints.items()}
    middle = (at["left_hip"] + at["right_hip"]) / 2
    at = {name: position - middle for name, position in at.items()}
    turned: dict[str, Floats] = {name: np.eye(3) for name in SEGMENT_NAMES}
    joints = {name: at[name] for name in ("neck", "head")} | {"pelvis": np.zeros(3)}
    joints["waist"] = _WAIST_SHARE * at["neck"]
    pieces = {
        name: Piece(piece.vertices @ R.T - middle, piece.faces, piece.cut)
        for name, piece in character.pieces.items()
    }
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        for limb, along in ((_ARM, (0.0, sign, 0.0)), (_LEG, (0.0, 0.0, -1.0))):
            _straighten(side, limb, np.array(along), at, joints, turned)
        turned[f"{side}_foot"] = _toes_forward(pieces[f"{side}_foot"].vertices - at[f"{side}_ankle"])
    at |= {"pelvis": joints["pelvis"], "waist": joints["waist"]}
    placed = {}
    for name, piece in pieces.items():
        joint = SEGMENT_JOINT[name]
        vertices = (piece.vertices - at[joint]) @ turned[name].T + joints[joint]
        placed[name] = Piece(vertices, piece.faces, piece.cut)
    return Character(joints, placed)


_ARM, _LEG = (tuple((row.joint, row.name) for row in ROWS if row.part == part) for part in ("arm", "leg"))


def _straighten(
    side: str,
    limb: tuple[tuple[str, str], ...],
    along: Floats,
    at: dict[str, Floats],
    joints: dict[str, Floats],
    turned: dict[str, Floats],
) -> None:
    """Straighten a limb along a direction, rotating its segments by the shortest rotations."""
    R = np.eye(3)
    joints[f"{side}_{limb[0][0]}"] = at[f"{side}_{limb[0][0]}"]
    for (joint, segment), (following, _) in pairwise(limb):
        bone = at[f"{side}_{following}"] - at[f"{side}_{joint}"]
        R = np.asarray(Rotation.align_vectors(along[None], (R @ bone)[None])[0].as_matrix()) @ R
        turned[f"{side}_{segment}"] = R
        joints[f"{side}_{following}"] = joints[f"{side}_{joint}"] + np.linalg.norm(bone) * along
    turned[f"{side}_{limb[-1][1]}"] = R  # a hand continues straight; feet get their own


def _toes_forward(foot: Floats) -> Floats:
    """(3, 3) the rotation about z that makes a foot (V, 3) point forward and keeps it level."""
    farthest = np.argsort(np.linalg.norm(foot[:, :2], axis=1))[-max(len(foot) // 20, 1) :]
    toes = foot[farthest, :2].mean(axis=0)
    return np.asarray(Rotation.from_euler("z", -np.arctan2(toes[1], toes[0])).as_matrix(), np.float64)


def _into_body_axes(joints: dict[str, Floats]) -> Floats:
    """(3, 3) from the file's axes to ours, from the positions of head, hips, left and right."""
    hips = (joints["left_hip"] + joints["right_hip"]) / 2
    up = _snapped(joints["head"] - hips)
    across = sum((joints[f"left_{j}"] - joints[f"right_{j}"] for j in ("shoulder", "hip")), np.zeros(3))
    left = _snapped(across - (across @ up) * up)
    left -= (left @ up) * up  # an axis next to it need not be at a right angle to up
    left /= np.linalg.norm(left)
    return np.array([np.cross(left, up), left, up])


def _snapped(direction: Floats) -> Floats:
    """The unit vector of a direction, or the axis next to it."""
    unit: Floats = direction / max(float(np.linalg.norm(direction)), 1e-12)
    axis = int(np.abs(unit).argmax())
    return np.sign(unit[axis]) * np.eye(3)[axis] if abs(unit[axis]) > _SNAP_COS else unit


def body_mesh(character: Character, where: str) -> BodyMesh:
    """The mesh of a character in the rest pose with closed pieces; where: the file, for errors."""
    pieces, joints = character.pieces, dict(character.joints)
    bottom = min(float(piece.vertices[:, 2].min()) for piece in pieces.values())
    top = float(pieces["head"].vertices[:, 2].max())
    height = top - bottom
    forward = JOINTS[JOINT_INDEX["head_top"]].offset_heights[0] * height
    joints["head_top"] = joints["head"] + (forward, 0.0, 0.0)
    joints["head_top"][2] = top
    unit = max(height, 1e-12)
    offsets = _symmetric(np.array([joints[j.name] - joints[j.parent or "pelvis"] for j in JOINTS]) / unit)
    vertices = {name: (piece.vertices - joints[SEGMENT_JOINT[name]]) / unit for name, piece in pieces.items()}
    lengths = _lengths(offsets, vertices)
    ratios = {name: length / BONES[name].length_heights for name, length in lengths.items()}
    for name, ratio in ratios.items():
        if not _RATIO_RANGE[0] <= ratio <= _RATIO_RANGE[1]:
            raise UserError(
                f"{where}: its {name.replace('_', ' ')} is {ratio:.2f} times as long as a person's of that "
                "height: expected a whole human body with correct names of parts or bones"
            )
    inverse = {name: 1.0 / ratio for name, ratio in ratios.items()}
    segments = []
    for segment in SEGMENTS:
        name = segment.row.name
        stretched = vertices[segment.name] * scales_across(name, inverse)
        stretched[:, 1] /= trunk_widening(name, stretched[:, 2], *trunk_ratios(name, ratios))
        segments.append(SegmentMesh(segment.name, stretched, pieces[segment.name].faces))
    return BodyMesh(tuple(segments), stretched_offsets(offsets, inverse), lengths)


def _symmetric(offsets: Floats) -> Floats:
    """(J, 3) with left and right joints the mean of both sides."""
    both = offsets.copy()
    for j, joint in enumerate(JOINTS):
        if joint.name.startswith("left_"):
            other = JOINT_INDEX[joint.name.replace("left", "right", 1)]
            both[j] = (offsets[j] + offsets[other] * MIRROR) / 2
            both[other] = both[j] * MIRROR
    return both


def _lengths(offsets: Floats, vertices: dict[str, Floats]) -> dict[str, float]:
    """How long the bones are, for offsets (J, 3) and segments in their frames."""
    at = {bare(joint.name): np.abs(offset) for joint, offset in zip(JOINTS, offsets, strict=True)}
    lengths: dict[str, float] = {}
    for name, bone in BONES.items():
        if bone.joints:
            joint, axis = next(iter(bone.joints.items()))
            lengths[name] = float(at[joint][axis]) * (1.0 if bone.segments else 2.0)  # a width: of both sides
    both = {name: [vertices[f"{side}_{name}"] for side in SIDES] for name in ("hand", "foot")}
    lengths["hand"] = float(np.mean([np.abs(hand[:, 1]).max() for hand in both["hand"]]))
    lengths["foot"] = float(np.mean([np.ptp(foot[:, 0]) for foot in both["foot"]]))
    return {name: lengths[name] for name in BONES}
