"""A skinned character: its skeleton is identified by bone names, its surface is cut by the largest bone
weight."""

from pathlib import Path

import numpy as np

from services.mocap.body.humanoid_names import matched_joints
from services.mocap.body.own_mesh.character import NEEDED_JOINTS, Character, Piece, cut_where, welded
from services.mocap.body.own_mesh.gltf import Gltf, Node, Primitive, Skin
from services.mocap.body.skeleton import SEGMENT_AT, SEGMENT_INDEX, SEGMENT_NAMES
from services.mocap.body.surface import as_one, moved
from services.mocap.errors import UserError
from services.mocap.types import Floats, Ints

_OVERLAP = 0.05
"""Neighbouring segments are cut where their weights differ by this, each on the other's side, so that they
overlap."""
_FEWEST_BONES = 4
"""A skeleton with fewer known bones is not human."""


def character_of_skin(path: Path, gltf: Gltf) -> Character:
    """The character of a file with skins; raises UserError if bones or surfaces are missing."""
    placed = _bind_pose(gltf)
    bones = sorted(placed, key=lambda bone: len(_ancestors(gltf.nodes, bone)))  # parents first
    turning = _bones_by_joint(path, gltf.nodes, bones)
    segments = _segments(path, gltf.nodes, turning)
    return Character(
        joints={joint: placed[turning[joint]][:3, 3] for joint in NEEDED_JOINTS},
        pieces=_pieces(path, *_surface(gltf, placed, segments)),
    )


def _ancestors(nodes: tuple[Node, ...], node: int) -> list[int]:
    """A node, its parent, and so on up to the root."""
    chain = [node]
    while (parent := nodes[chain[-1]].parent) is not None:
        chain.append(parent)
    return chain


def _bones_by_joint(path: Path, nodes: tuple[Node, ...], bones: list[int]) -> dict[str, int]:
    """Our joint -> the bone that turns there."""
    by_name: dict[str, int] = {}
    for bone in bones:
        by_name.setdefault(nodes[bone].name, bone)
    found = {joint: by_name[name] for joint, name in matched_joints(by_name).items()}
    if len(found) < _FEWEST_BONES:
        shown = ", ".join(list(by_name)[:5])
        raise UserError(
            f"{path}: none of its {len(bones)} bones ({shown}, …) has a human name: expected names "
            "such as those of Mixamo (LeftArm, LeftForeArm), VRM (leftUpperArm) or Unreal (upperarm_l)"
        )
    missing = [joint.replace("_", " ") for joint in NEEDED_JOINTS if joint not in found]
    if missing:
        raise UserError(
            f"{path}: has no bone that rotates at the {', '.join(missing)}: expected names such as those of "
            "Mixamo (LeftArm, LeftForeArm), VRM (leftUpperArm) or Unreal (upperarm_l)"
        )
    return found


def _segments(path: Path, nodes: tuple[Node, ...], turning: dict[str, int]) -> dict[int, str]:
    """Bone -> the segment that it moves. Bones that we do not know belong to their nearest known ancestor.

    The pelvis is where the paths from legs and neck meet; the torso is the next bone towards the neck.
    """
    neck, left, right = (_ancestors(nodes, turning[joint]) for joint in ("neck", "left_hip", "right_hip"))
    shared = [node for node in neck if node in left and node in right]
    if not shared or neck.index(shared[0]) < 2:
        raise UserError(f"{path}: expected a skeleton in which legs and spine have a common parent")
    named = {turning[joint]: SEGMENT_AT[joint] for joint in NEEDED_JOINTS}
    named |= {shared[0]: "pelvis", neck[neck.index(shared[0]) - 1]: "torso"}
    return {
        node: next((named[above] for above in _ancestors(nodes, node) if above in named), "pelvis")
        for node in range(len(nodes))
    }


def _bind_pose(gltf: Gltf) -> dict[int, Floats]:
    """Bone -> its transform (4, 4) when the first skin was bound, in the frame of that skin's mesh."""
    placed: dict[int, Floats] = {}
    for skin in gltf.skins:
        T_first_mesh = _into_first(skin, placed)
        for joint, T in zip(skin.joints, skin.T_joint_mesh, strict=True):
            placed.setdefault(joint, T_first_mesh @ np.linalg.inv(T))
    return placed


def _into_first(skin: Skin, placed: dict[int, Floats]) -> Floats:
    """(4, 4) from a skin's mesh to the first skin's, by a common bone; the identity if there is none."""
    for joint, T_joint_mesh in zip(skin.joints, skin.T_joint_mesh, strict=True):
        if joint in placed:
            return np.asarray(placed[joint] @ T_joint_mesh, np.float64)
    return np.eye(4)


def _surface(gltf: Gltf, placed: dict[int, Floats], segments: dict[int, str]) -> tuple[Floats, Ints, Floats]:
    """All that bones move, in one frame: vertices (V, 3), faces (F, 3), and how much of each vertex moves
    with each segment (V, S)."""
    meshes, weights = list[tuple[Floats, Ints]](), []
    for n, node in enumerate(gltf.nodes):
        for primitive in gltf.meshes[node.mesh] if node.mesh is not None else ():
            moved_by = _moved(gltf, n, primitive, placed, segments)
            if moved_by is not None:
                meshes.append((moved_by[0], primitive.faces))
                weights.append(moved_by[1])
    if not meshes:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros((0, len(SEGMENT_NAMES)))
    joined, joined_faces, origin = welded(*as_one(meshes))
    return joined, joined_faces, np.concatenate(weights)[origin]


def _moved(
    gltf: Gltf, node: int, primitive: Primitive, placed: dict[int, Floats], segments: dict[int, str]
) -> tuple[Floats, Floats] | None:
    """Vertices (V, 3) in the common frame and their weights (V, S); None for vertices that no bone moves."""
    weights, of_node = np.zeros((len(primitive.vertices), len(SEGMENT_NAMES))), gltf.nodes[node]
    if of_node.skin is not None and primitive.bones.shape[1]:
        skin = gltf.skins[of_node.skin]
        of_bone = np.array([SEGMENT_INDEX[segments[joint]] for joint in skin.joints])
        for bones, shares in zip(primitive.bones.T, primitive.weights.T, strict=True):
            np.add.at(weights, (np.arange(len(weights)), of_bone[bones]), shares)
        T = _into_first(skin, placed)
    else:
        bone = next((above for above in _ancestors(gltf.nodes, node) if above in placed), None)
        if bone is None:
            return None
        T = placed[bone] @ np.linalg.inv(gltf.nodes[bone].T_world_node) @ of_node.T_world_node
        weights[:, SEGMENT_INDEX[segments[bone]]] = 1.0
    total = weights.sum(axis=1, keepdims=True)
    return moved(primitive.vertices, T), weights / np.maximum(total, 1e-9)


def _pieces(path: Path, vertices: Floats, faces: Ints, weights: Floats) -> dict[str, Piece]:
    pieces = {}
    for s, segment in enumerate(SEGMENT_NAMES):
        others = np.delete(weights, s, axis=1).max(axis=1, initial=0.0)
        pieces[segment] = cut_where(vertices, faces, weights[:, s] - others + _OVERLAP)
    missing = [segment.replace("_", " ") for segment, piece in pieces.items() if len(piece.faces) == 0]
    if missing:
        raise UserError(f"{path}: has no surface for the {', '.join(missing)}: expected a whole body")
    return pieces
