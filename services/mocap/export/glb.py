"""Motion as a binary glTF 2.0 file: one skinned mesh, and an armature that moves.

A node for each segment stands where its joint is; head_top is one, too. Axes are those of motion.bvh: y up,
facing +z at heading zero, as glTF has it. Lengths are metres.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as gltf
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.mocap.atomic import write_file
from services.mocap.body.kinematics import joint_transforms
from services.mocap.body.skeleton import (
    DOFS,
    JOINT_INDEX,
    JOINTS,
    SEGMENT_JOINT,
    SEGMENT_NAMES,
    SEGMENTS,
    TIP_JOINTS,
)
from services.mocap.camera.colour import linear_of
from services.mocap.export.skin import Skin, skin_of
from services.mocap.export.tiles import CENTRE_BGR, LEFT_BGR, RIGHT_BGR
from services.mocap.motion.motion import Motion, rest_rotations, rotations_to_y_up, to_y_up, turns_from_rest
from services.mocap.motion.root import without_flips
from services.mocap.types import Floats, Ints

_COLOURS_BGR = {"centre": CENTRE_BGR, "left": LEFT_BGR, "right": RIGHT_BGR}
_ROUGHNESS = 0.8
_NODE_NAMES = (*SEGMENT_NAMES, *TIP_JOINTS)
_NODE_JOINTS = (*SEGMENT_JOINT.values(), *TIP_JOINTS)
_NODE_PARENTS = [JOINTS[JOINT_INDEX[joint]].parent for joint in _NODE_JOINTS]
_LEAST_NORMAL = 1e-12
_COMPONENTS = {"float32": gltf.FLOAT, "uint16": gltf.UNSIGNED_SHORT, "uint32": gltf.UNSIGNED_INT}


def write_glb(path: Path, motion: Motion) -> None:
    """Write a motion and the body that makes it, completely or not at all; the first frame is at 0 s."""
    file = _File()
    body, R = motion.body, turns_from_rest(motion.T_world_joint, rest_rotations("T"))
    nodes = [JOINT_INDEX[joint] for joint in _NODE_JOINTS]
    turns = Rotation.from_matrix(rotations_to_y_up(R[:, nodes]).reshape(-1, 3, 3))
    quaternions = without_flips(turns.as_quat().reshape(len(R), len(nodes), 4))
    root_m = to_y_up(motion.T_world_joint[:, 0, :3, 3])
    offsets_m = to_y_up(body.offsets_m)
    offsets_m[0], skin = root_m[0], skin_of(body)
    file.add_materials()
    file.add_mesh(skin)
    file.add_skin(joint_transforms(skin.pose[None], body.offsets_m)[0])
    file.add_nodes(offsets_m[nodes], quaternions[0])
    file.add_animation(motion.name, motion.fps, root_m, quaternions)
    write_file(path, file.content())


class _File:
    """A glTF file in the making: its document, and the numbers that this one refers to."""

    def __init__(self) -> None:
        self._document = gltf.GLTF2(
            asset=gltf.Asset(version="2.0", generator="xormocap"),
            scene=0,
            scenes=[gltf.Scene(nodes=[0, len(_NODE_NAMES)])],
            buffers=[gltf.Buffer()],
        )
        self._numbers = bytearray()

    def add_materials(self) -> None:
        """One for the trunk, one for each side, in the order of the colours."""
        for name, bgr in _COLOURS_BGR.items():
            look = gltf.PbrMetallicRoughness(
                baseColorFactor=[*linear_of(np.array(bgr[::-1]) / 255.0).round(4).tolist(), 1.0],
                metallicFactor=0.0,
                roughnessFactor=_ROUGHNESS,
            )
            self._document.materials.append(gltf.Material(name=name, pbrMetallicRoughness=look))

    def add_mesh(self, skin: Skin) -> None:
        """The skin as one mesh, whose triangles have the colours of their segments' sides."""
        joints, weights = _influences(skin.weights)
        vertices: dict[str, tuple[NDArray[Any], str]] = {
            "POSITION": (to_y_up(skin.vertices_m), "VEC3"),
            "NORMAL": (_normals(skin.vertices_m, skin.faces), "VEC3"),
            "JOINTS_0": (joints, "VEC4"),
            "WEIGHTS_0": (weights, "VEC4"),
        }
        attributes = {
            name: self._accessor(values, kind, with_range=name == "POSITION", target=gltf.ARRAY_BUFFER)
            for name, (values, kind) in vertices.items()
        }
        sides, primitives = list(_COLOURS_BGR), list[gltf.Primitive]()
        materials = np.array([sides.index(segment.side or "centre") for segment in SEGMENTS])
        small = len(skin.vertices_m) <= np.iinfo(np.uint16).max  # the largest number itself is reserved
        for material in range(len(sides)):
            faces = skin.faces[materials[skin.face_segments] == material]
            indices = faces.reshape(-1, 1).astype("<u2" if small else "<u4")
            primitive = gltf.Primitive(
                attributes=gltf.Attributes(**attributes),
                indices=self._accessor(indices, "SCALAR", target=gltf.ELEMENT_ARRAY_BUFFER),
                material=material,
            )
            primitives.append(primitive)
        self._document.meshes.append(gltf.Mesh(name="body", primitives=primitives))

    def add_skin(self, T_world_joint: Floats) -> None:
        """What binds the mesh to the nodes: where the joints (J, 4, 4) were when it was made."""
        R = rotations_to_y_up(T_world_joint[:, :3, :3])
        T_joint_world = np.tile(np.eye(4), (len(R), 1, 1))
        T_joint_world[:, :3, :3] = R.transpose(0, 2, 1)
        T_joint_world[:, :3, 3] = -np.einsum("jba,jb->ja", R, to_y_up(T_world_joint[:, :3, 3]))
        by_column = T_joint_world[[JOINT_INDEX[joint] for joint in _NODE_JOINTS]].transpose(0, 2, 1)
        inverses = self._accessor(by_column.reshape(-1, 16), "MAT4")
        nodes = list(range(len(_NODE_NAMES)))
        self._document.skins.append(gltf.Skin(joints=nodes, skeleton=0, inverseBindMatrices=inverses))

    def add_nodes(self, offsets_m: Floats, quaternions: Floats) -> None:
        """The armature in one pose, each node's place (J, 3) and turn (J, 4) against its parent, and the
        skinned mesh."""
        for n, name in enumerate(_NODE_NAMES):
            children = [k for k, parent in enumerate(_NODE_PARENTS) if parent == _NODE_JOINTS[n]]
            node = gltf.Node(name=name, translation=_single(offsets_m[n]), rotation=_single(quaternions[n]))
            node.children = children or None  # an empty list is not glTF
            self._document.nodes.append(node)
        self._document.nodes.append(gltf.Node(name="body", mesh=0, skin=0))

    def add_animation(self, name: str, fps: float, root_m: Floats, quaternions: Floats) -> None:
        """The root's places (N, 3), and the turns (N, J, 4) of all nodes whose joint has parameters."""
        times = self._accessor(np.arange(len(root_m))[:, None] / fps, "SCALAR", with_range=True)
        moving = {dof.joint for dof in DOFS}
        moves = [(0, "translation", self._accessor(root_m, "VEC3"))]
        for n, joint in enumerate(_NODE_JOINTS):
            if joint in moving:
                moves.append((n, "rotation", self._accessor(quaternions[:, n], "VEC4")))
        animation = gltf.Animation(name=name)
        for k, (node, path, values) in enumerate(moves):
            sampler = gltf.AnimationSampler(input=times, output=values, interpolation="LINEAR")
            animation.samplers.append(sampler)
            target = gltf.AnimationChannelTarget(node=node, path=path)
            animation.channels.append(gltf.AnimationChannel(sampler=k, target=target))
        self._document.animations.append(animation)

    def content(self) -> bytes:
        """The bytes of the .glb file."""
        self._document.buffers[0].byteLength = len(self._numbers)
        self._document.set_binary_blob(bytes(self._numbers))
        return b"".join(self._document.save_to_bytes())

    def _accessor(
        self, values: NDArray[Any], kind: str, *, with_range: bool = False, target: int | None = None
    ) -> int:
        """The index of an accessor to values (N, k), which are kept as given, floats in 32 bits."""
        if values.dtype.kind == "f":
            values = values.astype("<f4")
        view = gltf.BufferView(
            buffer=0, byteOffset=len(self._numbers), byteLength=values.nbytes, target=target
        )
        self._document.bufferViews.append(view)
        self._numbers += values.tobytes()
        self._numbers += bytes(-len(self._numbers) % 4)
        accessor = gltf.Accessor(
            bufferView=len(self._document.bufferViews) - 1,
            componentType=_COMPONENTS[values.dtype.name],
            count=len(values),
            type=kind,
            min=values.min(axis=0).tolist() if with_range else None,
            max=values.max(axis=0).tolist() if with_range else None,
        )
        self._document.accessors.append(accessor)
        return len(self._document.accessors) - 1


def _single(values: Floats) -> list[float]:
    """Numbers as 32 bits hold them, as a list."""
    numbers: list[float] = values.astype(np.float32).tolist()
    return numbers


def _influences(weights: Floats) -> tuple[NDArray[np.uint16], Floats]:
    """The four segments (V, 4) that move each vertex most, and how much; weights (V, S)."""
    segments = np.argsort(-weights, axis=1, kind="stable")[:, :4]
    shares = np.take_along_axis(weights, segments, axis=1)
    segments[shares == 0.0] = 0
    return segments.astype("<u2"), shares / shares.sum(axis=1, keepdims=True)


def _normals(vertices_m: Floats, faces: Ints) -> Floats:
    """(V, 3) unit normals in the file's axes; up where no triangle with an area tells one."""
    normals = to_y_up(np.array(trimesh.Trimesh(vertices_m, faces, process=False).vertex_normals))
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    up = np.array([0.0, 1.0, 0.0])
    return np.where(lengths > _LEAST_NORMAL, normals / np.maximum(lengths, _LEAST_NORMAL), up)
