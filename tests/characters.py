"""Characters as users bring them: the generic body written as a skinned .glb, and as named parts."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, joint_transforms, segment_transforms
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, JOINTS, SEGMENT_JOINT, SEGMENT_NAMES
from services.mocap.types import Floats

MIXAMO = {
    "pelvis": "Hips",
    "waist": "Spine",
    "neck": "Neck",
    "head": "Head",
    "head_top": "HeadTop_End",
    **{
        f"{side}_{joint}": side.title() + bone
        for side in ("left", "right")
        for joint, bone in (
            ("shoulder", "Arm"),
            ("elbow", "ForeArm"),
            ("wrist", "Hand"),
            ("hip", "UpLeg"),
            ("knee", "Leg"),
            ("ankle", "Foot"),
        )
    },
}
"""Our joint -> what Mixamo calls the bone that turns there."""
PERSON = Actor(height=1.8, bone_lengths={"thigh": 0.46, "upper_arm": 0.28, "shoulder_width": 0.40})
"""Somebody who is not the generic body."""
_BLEND_HEIGHTS = 0.03
_GLTF_FROM_OURS = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""glTF is y-up and faces +z."""


def bind_pose(arms_down_rad: float = 0.0, legs_apart_rad: float = 0.0) -> Floats:
    """A T pose (D,), or an A pose."""
    pose = np.zeros(N_DOF)
    for side in ("left", "right"):
        pose[DOF_INDEX[f"{side}_shoulder_elevation"]] = -arms_down_rad
        pose[DOF_INDEX[f"{side}_elbow_flexion"]] = 0.4 * arms_down_rad
        pose[DOF_INDEX[f"{side}_hip_abduction"]] = legs_apart_rad
        pose[DOF_INDEX[f"{side}_ankle_inversion"]] = legs_apart_rad
    return pose


def write_skinned_glb(
    path: Path,
    actor: Actor,
    pose: Floats,
    *,
    names: dict[str, str] = MIXAMO,
    prefix: str = "mixamorig:",
    unit_m: float = 0.01,
) -> None:
    """Write an actor bound in a pose (D,) as one skin, with weights that blend over the joints.

    Bones that names lacks are left out. There is one bone more in the hand and one in the trunk, and the
    whole stands on a scaled armature, as exporters write them.
    """
    body = build_body(actor)
    T_joint = joint_transforms(pose[None], body.offsets_m)[0]
    T_segment = segment_transforms(pose[None], body.offsets_m)[0]
    bones = [joint.name for joint in JOINTS if joint.name in names]
    vertices, faces, rows, count = [], [], [], 0
    for s, segment in enumerate(SEGMENT_NAMES):
        local = body.vertices_m[s]
        vertices.append(local @ T_segment[s, :3, :3].T + T_segment[s, :3, 3])
        faces.append(body.faces[s] + count)
        rows.append(_weights(segment, local / body.height_m, bones))
        count += len(local)
    to_file = _GLTF_FROM_OURS / unit_m
    skeleton = [_bone(T_joint[JOINT_INDEX[name]], to_file) for name in bones]
    nodes: list[dict[str, Any]] = [{"name": "Armature", "scale": [unit_m] * 3, "children": [1]}]
    placed = {name: 1 + k for k, name in enumerate(bones)}
    for name, T in zip(bones, skeleton, strict=True):
        above = _parent(name, bones)
        local_T = T if above is None else np.linalg.inv(skeleton[bones.index(above)]) @ T
        nodes.append(
            {
                "name": prefix + names[name],
                "matrix": local_T.T.ravel().tolist(),
                "children": [placed[n] for n in bones if _parent(n, bones) == name],
            }
        )
    nodes[placed["left_wrist"]]["children"].append(len(nodes))
    nodes.append({"name": prefix + "LeftHandIndex1", "translation": [0, 8, 0]})
    nodes.append({"name": "Body", "mesh": 0, "skin": 0})
    weights = np.vstack(rows)
    finger = np.zeros((len(weights), 1))
    hand = bones.index("left_wrist")
    finger[weights[:, hand] > 0.9] = 0.7
    weights = np.hstack([weights, finger])
    weights[:, hand] -= finger[:, 0]
    top = np.argsort(-weights, axis=1)[:, :4]
    inverse = [np.linalg.inv(T) for T in [*skeleton, skeleton[hand]]]
    _write_glb(
        path,
        nodes=nodes,
        arrays=[
            ("VEC3", 5126, (np.vstack(vertices) @ to_file.T).astype("<f4")),
            ("SCALAR", 5125, np.vstack(faces).astype("<u4").reshape(-1, 1)),
            ("VEC4", 5123, top.astype("<u2")),
            ("VEC4", 5126, np.take_along_axis(weights, top, axis=1).astype("<f4")),
            ("MAT4", 5126, np.array([T.T.ravel() for T in inverse], "<f4")),
        ],
        meshes=[
            {"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}, "indices": 1}]}
        ],
        skins=[{"joints": [*placed.values(), len(nodes) - 2], "inverseBindMatrices": 4}],
    )


def write_parts_obj(path: Path, actor: Actor, pose: Floats, names: dict[str, str] | None = None) -> None:
    """Write an actor in a pose (D,) as one object per segment, z-up, in metres; names: segment -> other."""
    body = build_body(actor)
    T_segment = segment_transforms(pose[None], body.offsets_m)[0]
    lines, count = [], 1
    for s, segment in enumerate(SEGMENT_NAMES):
        lines.append(f"o {(names or {}).get(segment, segment)}")
        placed = body.vertices_m[s] @ T_segment[s, :3, :3].T + T_segment[s, :3, 3]
        lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in placed]
        lines += [f"f {a} {b} {c}" for a, b, c in body.faces[s] + count]
        count += len(placed)
    path.write_text("\n".join(lines) + "\n")


def _parent(joint: str, bones: list[str]) -> str | None:
    above = JOINTS[JOINT_INDEX[joint]].parent
    while above is not None and above not in bones:
        above = JOINTS[JOINT_INDEX[above]].parent
    return above


def _bone(T_world_joint: Floats, to_file: Floats) -> Floats:
    """(4, 4) a bone in the file's frame, with axes of its own, as exporters have them."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", (0.3, -1.1, 0.7)).as_matrix()
    T[:3, 3] = to_file @ T_world_joint[:3, 3]
    return T


def _weights(segment: str, heights: Floats, bones: list[str]) -> Floats:
    """(V, bones): a segment's own, and near its joint its parent's."""
    own = SEGMENT_JOINT[segment]
    above = _parent(own, bones)
    weights = np.zeros((len(heights), len(bones)))
    axis = 1 if any(part in segment for part in ("arm", "hand")) else 2
    sign = (-1.0 if axis == 2 and any(p in segment for p in ("thigh", "shank", "foot")) else 1.0) * (
        -1.0 if axis == 1 and segment.startswith("right") else 1.0
    )
    share = np.clip(0.5 + sign * heights[:, axis] / _BLEND_HEIGHTS, 0.0, 1.0) if above else 1.0
    owner = own if own in bones else above
    weights[:, bones.index(owner or bones[0])] = share
    if above:
        weights[:, bones.index(above)] += 1.0 - share
    return weights


def _write_glb(path: Path, *, arrays: list[tuple[str, int, Any]], **document: Any) -> None:
    binary, views, accessors = b"", [], []
    for kind, component, array in arrays:
        content = array.tobytes()
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(content)})
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": component, "type": kind, "count": len(array)}
        )
        binary += content + b"\0" * (-len(content) % 4)
    document |= {
        "asset": {"version": "2.0"},
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    path.write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks)
