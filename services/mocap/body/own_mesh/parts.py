"""A body in parts, each named as one of our segments; joints are where neighbouring parts meet."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from services.mocap.body.humanoid_names import matched_joints
from services.mocap.body.own_mesh.character import NEEDED_JOINTS, Character, Piece, welded
from services.mocap.body.own_mesh.gltf import Gltf
from services.mocap.body.skeleton import SEGMENT_JOINT, SEGMENT_NAMES, SEGMENT_PARENTS
from services.mocap.body.surface import as_one, moved
from services.mocap.errors import UserError
from services.mocap.types import Floats, Ints, Mask

_TOUCHING = 0.003
"""Parts touch where their distance is below this, in body heights, or within this of their smallest
distance."""
_FARTHEST = 0.06
"""Parts that are farther apart than this do not belong to one body."""
_MEETINGS = {
    joint: (parent, name)
    for name, joint in SEGMENT_JOINT.items()
    if joint in NEEDED_JOINTS and (parent := SEGMENT_PARENTS[name])
}
"""Joint -> the parts that meet there."""


@dataclass(frozen=True, eq=False)
class Part:
    """A named part of a file."""

    name: str
    vertices: Floats
    """(V, 3)"""
    faces: Ints
    """(F, 3)"""
    pivot: Floats | None = None
    """(3,) its pivot, if the file has one."""


def load_parts(path: Path) -> list[Part]:
    """The objects or groups of an .obj file, or the one nameless part of a .ply file."""
    try:
        if path.suffix.lower() == ".obj":
            return _parts_of_obj(path.read_text(encoding="utf-8", errors="replace"))
        mesh = trimesh.load_mesh(path, process=False)
        return [Part("", np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32))]
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}): expected a mesh") from None
    except Exception:  # trimesh's readers raise any kind of exception for a broken file
        raise UserError(f"{path}: is damaged or not a mesh: export it again, best as .glb") from None


def _parts_of_obj(text: str) -> list[Part]:
    """By object where there are several, else by group; trimesh names neither."""
    parts: dict[str, list[str]] = {}
    lines = [line for line in text.splitlines() if line[:2] in ("v ", "f ", "o ", "g ")]
    key = "o" if len({line for line in lines if line[0] == "o"}) > 1 else "g"
    vertices = [line for line in lines if line[0] == "v"]
    name, n_before = "", 0
    for line in lines:
        if line[0] == key:
            name = line[2:].strip()
        elif line[0] == "v":
            n_before += 1
        elif line[0] == "f":
            parts.setdefault(name, []).append(_counted_from_first(line, n_before))
    # All vertices are repeated before each part's faces, so that their numbers stay right.
    found = []
    for name, faces in parts.items():
        part = trimesh.util.wrap_as_stream("\n".join([*vertices, *faces]))
        mesh = trimesh.load_mesh(part, file_type="obj", process=False)
        found.append(Part(name, np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32)))
    return found


def _counted_from_first(face: str, n_before: int) -> str:
    """A face whose corners name vertices from the first on; negative numbers count back from it."""
    corners = [int(corner.split("/")[0]) for corner in face.split()[1:]]
    return "f " + " ".join(str(v if v >= 0 else n_before + 1 + v) for v in corners)


def parts_of_gltf(gltf: Gltf) -> list[Part]:
    """Every node's mesh in the scene; if fewer positions of nodes differ than there are segments, they give
    no pivots."""
    parts = []
    for node in gltf.nodes:
        for primitive in gltf.meshes[node.mesh] if node.mesh is not None else ():
            name = node.name if matched_joints([node.name]) else gltf.mesh_names[node.mesh or 0]
            T = node.T_world_node
            faces = primitive.faces if np.linalg.det(T[:3, :3]) > 0 else primitive.faces[:, ::-1]
            parts.append(Part(name, moved(primitive.vertices, T), faces, T[:3, 3]))
    pivots = {tuple(np.round(part.pivot, 6)) for part in parts if part.pivot is not None}
    if len(pivots) < len(SEGMENT_NAMES):
        return [Part(part.name, part.vertices, part.faces) for part in parts]
    return parts


def character_of_parts(path: Path, parts: list[Part]) -> Character:
    """The character of named parts; raises UserError if one is missing."""
    by_segment = _by_segment(path, parts)
    height = float(np.ptp(np.concatenate([p.vertices for p in by_segment.values()]), axis=0).max())
    joints = {joint: _joint(path, joint, by_segment, height) for joint in _MEETINGS}
    pieces = {}
    for segment, part in by_segment.items():
        vertices, faces, _ = welded(part.vertices, part.faces)
        pieces[segment] = Piece(vertices, faces, np.zeros(len(vertices), bool))
    return Character(joints, pieces)


def _by_segment(path: Path, parts: list[Part]) -> dict[str, Part]:
    """Parts with the same name, such as one per material, are merged."""
    names = list(dict.fromkeys(part.name for part in parts if len(part.faces)))
    named = matched_joints(names)
    if len(named) < len(SEGMENT_NAMES) // 4:
        raise UserError(
            f"{path}: has neither bones nor parts with human names: expected a skinned character (.glb) with "
            f"bones such as LeftArm, or {len(SEGMENT_NAMES)} objects or groups named "
            f"{', '.join(SEGMENT_NAMES)}"
        )
    missing = [segment for segment in SEGMENT_NAMES if SEGMENT_JOINT[segment] not in named]
    if missing:
        raise UserError(
            f"{path}: has no part named {', '.join(missing)}: expected all {len(SEGMENT_NAMES)} segments of "
            "a body"
        )
    found = {}
    for segment in SEGMENT_NAMES:
        own = [part for part in parts if part.name == named[SEGMENT_JOINT[segment]]]
        found[segment] = Part(segment, *as_one([(p.vertices, p.faces) for p in own]), own[0].pivot)
    return found


def _joint(path: Path, joint: str, parts: dict[str, Part], height: float) -> Floats:
    """Where two parts touch: the middle of what they have near each other."""
    near, far = (parts[name] for name in _MEETINGS[joint])
    if far.pivot is not None:
        return far.pivot
    one, other = (trimesh.Trimesh(*welded(p.vertices, p.faces)[:2], process=False) for p in (near, far))
    (one_off, one_inside), (other_off, other_inside) = _off(one, other), _off(other, one)
    least = float(other_off.min())
    if least > _FARTHEST * height:
        names = " and ".join(_MEETINGS[joint])
        raise UserError(f"{path}: {names} do not touch: expected parts in their places in one body")
    reach = least + _TOUCHING * height
    shared = np.concatenate(
        [one.vertices[(one_off <= reach) | one_inside], other.vertices[(other_off <= reach) | other_inside]]
    )
    middle: Floats = (shared.min(axis=0) + shared.max(axis=0)) / 2
    return middle


def _off(mesh: trimesh.Trimesh, other: trimesh.Trimesh) -> tuple[Floats, Mask]:
    """(V,) distance of a mesh's vertices from another's, and which of them are inside it, by its normals."""
    distance, nearest = cKDTree(other.vertices).query(mesh.vertices)
    towards = mesh.vertices - other.vertices[nearest]
    return distance, np.einsum("vi,vi->v", towards, other.vertex_normals[nearest]) < 0.0
