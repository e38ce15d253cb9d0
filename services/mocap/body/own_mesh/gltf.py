"""glTF 2.0 files as far as a body needs them: meshes, nodes and skins (trimesh reads no skins)."""

import base64
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pygltflib
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.mocap.errors import UserError
from services.mocap.types import Floats, Ints, Longs

_DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_PACKED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")


@dataclass(frozen=True, eq=False)
class Node:
    """A node of the scene: a bone, or the node of a mesh."""

    name: str
    parent: int | None
    T_world_node: Floats
    """(4, 4) as the file has it posed."""
    mesh: int | None
    skin: int | None


@dataclass(frozen=True, eq=False)
class Primitive:
    """Triangles of a mesh."""

    vertices: Floats
    """(V, 3) in the mesh's frame."""
    faces: Ints
    """(F, 3)"""
    bones: Longs
    """(V, k) the joints of the skin that move a vertex; k is 0 without a skin."""
    weights: Floats
    """(V, k) their weights."""


@dataclass(frozen=True, eq=False)
class Skin:
    """Bones, and their transforms when the mesh was bound to them."""

    joints: tuple[int, ...]
    """Nodes."""
    T_joint_mesh: Floats
    """(J, 4, 4) inverse bind matrices."""


@dataclass(frozen=True, eq=False)
class Gltf:
    """The content of a file."""

    nodes: tuple[Node, ...]
    mesh_names: tuple[str, ...]
    meshes: tuple[tuple[Primitive, ...], ...]
    skins: tuple[Skin, ...]


def read_gltf(path: Path) -> Gltf:
    """Read a .glb, .vrm or .gltf file; raises UserError if it cannot be read."""
    try:
        content = path.read_bytes()
        if content.startswith(b"glTF"):
            document = pygltflib.GLTF2.load_from_bytes(content)
        else:
            document = pygltflib.GLTF2.gltf_from_json(content.decode("utf-8"))
        packed = [name for name in _PACKED if name in document.extensionsRequired]
        if packed:
            raise UserError(f"{path}: is compressed by {packed[0]}: export it again without compression")
        return _checked(_Reader(path.parent, document).read())
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}): expected a glTF file") from None
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, struct.error, RecursionError):
        raise UserError(f"{path}: is damaged, or is not glTF 2.0: export it again as .glb") from None


def _checked(gltf: Gltf) -> Gltf:
    """The same; raises ValueError for invalid references or numbers."""
    for skin in gltf.skins:
        if not skin.joints or min(skin.joints) < 0 or max(skin.joints) >= len(gltf.nodes):
            raise ValueError("a skin names joints that do not exist")
        if len(skin.T_joint_mesh) != len(skin.joints) or not np.all(
            np.abs(_scales(skin.T_joint_mesh)) > 1e-30
        ):
            raise ValueError("a skin's bind matrices are invalid")
    for node in gltf.nodes:
        if not abs(_scales(node.T_world_node)) > 1e-30:
            raise ValueError("a node's transform is invalid")
        n_bones = 0 if node.skin is None else len(gltf.skins[node.skin].joints)
        for primitive in () if node.mesh is None else gltf.meshes[node.mesh]:
            if node.skin is not None and primitive.bones.max(initial=-1) >= n_bones:
                raise ValueError("a vertex is moved by a bone that does not exist")
    return gltf


def _scales(T: Floats) -> Floats:
    """(…,) of transforms (…, 4, 4); not a number where they hold one."""
    return np.asarray(np.linalg.det(T[..., :3, :3]) + 0.0 * T.sum(axis=(-2, -1)), np.float64)


class _Reader:
    """Parses a document; raises KeyError and similar errors if it is inconsistent."""

    def __init__(self, folder: Path, document: pygltflib.GLTF2) -> None:
        self._folder, self._document = folder, document
        self._buffers = [self._buffer(buffer.uri) for buffer in document.buffers]

    def read(self) -> Gltf:
        meshes = [
            tuple(self._primitive(p) for p in mesh.primitives if p.mode == pygltflib.TRIANGLES)
            for mesh in self._document.meshes
        ]
        return Gltf(
            nodes=self._nodes(),
            mesh_names=tuple(mesh.name or "" for mesh in self._document.meshes),
            meshes=tuple(meshes),
            skins=tuple(self._skin(skin) for skin in self._document.skins),
        )

    def _buffer(self, uri: str | None) -> bytes:
        if uri is None:
            return self._document.binary_blob() or b""
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        return (self._folder / Path(unquote(uri)).name).read_bytes()  # only in the file's folder

    def _accessor(self, index: int) -> NDArray[Any]:
        """(N, k) an accessor's elements; whole numbers that stand for 0 to 1 as such."""
        accessor = self._document.accessors[index]
        dtype = np.dtype(_DTYPES[accessor.componentType])
        values = np.zeros((accessor.count, _WIDTHS[accessor.type]), dtype)
        if accessor.bufferView is not None:
            values = self._view(accessor, accessor.count, values.shape[1], dtype)
        if accessor.sparse is not None:
            where, count = accessor.sparse.indices, accessor.sparse.count
            rows = self._view(where, count, 1, np.dtype(_DTYPES[where.componentType]))[:, 0]
            values = values.copy()
            values[rows] = self._view(accessor.sparse.values, count, values.shape[1], dtype)
        if accessor.normalized:
            return np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values

    def _view(self, place: Any, count: int, width: int, dtype: np.dtype[Any]) -> NDArray[Any]:
        """(count, width) numbers at the bufferView and byteOffset of a place."""
        view = self._document.bufferViews[place.bufferView]
        size = width * dtype.itemsize
        stride, start = view.byteStride or size, (view.byteOffset or 0) + (place.byteOffset or 0)
        data = np.frombuffer(self._buffers[view.buffer], np.uint8)
        if start < 0 or stride < size or count < 0 or start + (count - 1) * stride + size > len(data):
            raise ValueError("an accessor exceeds its buffer")
        rows = np.lib.stride_tricks.as_strided(data[start:], (count, size), (stride, 1), writeable=False)
        return np.ascontiguousarray(rows).view(dtype).reshape(count, width)

    def _primitive(self, primitive: pygltflib.Primitive) -> Primitive:
        attributes = vars(primitive.attributes)
        vertices = self._accessor(attributes["POSITION"]).astype(np.float64)
        if primitive.indices is not None:
            corners = self._accessor(primitive.indices)[:, 0].astype(np.int64)
        else:
            corners = np.arange(len(vertices))
        faces = corners[: len(corners) // 3 * 3].reshape(-1, 3)
        if not np.isfinite(vertices).all() or (faces.size and faces.max() >= len(vertices)):
            raise ValueError("broken triangles")
        bones, weights = [np.zeros((len(vertices), 0), np.int64)], [np.zeros((len(vertices), 0))]
        for name, index in sorted(attributes.items()):  # JOINTS_1 where more than four bones move a vertex
            if name.startswith("JOINTS_") and index is not None:
                bones.append(self._accessor(index).astype(np.int64))
                weights.append(self._accessor(attributes[name.replace("JOINTS", "WEIGHTS")]).astype(float))
        moved = np.hstack(bones), np.hstack(weights)
        if moved[0].shape != moved[1].shape or not np.isfinite(moved[1]).all():
            raise ValueError("broken weights")
        return Primitive(vertices, faces.astype(np.int32), *moved)

    def _skin(self, skin: pygltflib.Skin) -> Skin:
        joints = tuple(skin.joints)
        if skin.inverseBindMatrices is None:
            return Skin(joints, np.tile(np.eye(4), (len(joints), 1, 1)))
        matrices = self._accessor(skin.inverseBindMatrices).astype(np.float64)
        return Skin(joints, matrices.reshape(-1, 4, 4).transpose(0, 2, 1)[: len(joints)])

    def _nodes(self) -> tuple[Node, ...]:
        nodes = self._document.nodes
        parents = {child: n for n, node in enumerate(nodes) for child in node.children}
        names = self._vrm_bones()
        placed: dict[int, Floats] = {}

        def place(n: int) -> Floats:
            """(4, 4) a node in the world; nodes that are their own parents end in RecursionError."""
            if n not in placed:
                placed[n] = place(parents[n]) @ _local(nodes[n]) if n in parents else _local(nodes[n])
            return placed[n]

        return tuple(
            Node(names.get(n, node.name or ""), parents.get(n), place(n), node.mesh, node.skin)
            for n, node in enumerate(nodes)
        )

    def _vrm_bones(self) -> dict[int, str]:
        """Node -> its bone according to a VRM file, whatever its name is."""
        extensions = self._document.extensions or {}
        bones = extensions.get("VRMC_vrm", {}).get("humanoid", {}).get("humanBones", {})
        if bones:
            return {int(bone["node"]): str(name) for name, bone in bones.items()}
        older = extensions.get("VRM", {}).get("humanoid", {}).get("humanBones", [])
        return {int(bone["node"]): str(bone["bone"]) for bone in older}


def _local(node: pygltflib.Node) -> Floats:
    """(4, 4) a node in its parent."""
    if node.matrix is not None:
        return np.array(node.matrix, np.float64).reshape(4, 4).T
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(node.rotation or (0, 0, 0, 1)).as_matrix() * (node.scale or (1, 1, 1))
    T[:3, 3] = node.translation or (0, 0, 0)
    return T
