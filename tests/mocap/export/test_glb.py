"""motion.glb read back by the rules of glTF 2.0: nodes, mesh, skin and keys, and nothing of our own."""

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import segment_transforms
from services.mocap.body.skeleton import JOINT_INDEX, SEGMENT_JOINT, SEGMENT_NAMES
from services.mocap.export.glb import write_glb
from services.mocap.export.skin import bind_pose
from services.mocap.result.result import Result, load_result
from services.mocap.types import Floats, Ints

WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}
DTYPES = {5123: "<u2", 5125: "<u4", 5126: "<f4"}


class Glb:
    """A file as the specification reads it."""

    def __init__(self, path: Path) -> None:
        content = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", content)
        assert (magic, version, length) == (b"glTF", 2, len(content))
        size, kind = struct.unpack_from("<I4s", content, 12)
        assert kind == b"JSON"
        self.document: dict[str, Any] = json.loads(content[20 : 20 + size])
        binary_size, kind = struct.unpack_from("<I4s", content, 20 + size)
        assert kind == b"BIN\0"
        self.binary = content[28 + size : 28 + size + binary_size]

    def numbers(self, index: int) -> Floats:
        accessor = self.document["accessors"][index]
        view = self.document["bufferViews"][accessor["bufferView"]]
        width = WIDTHS[accessor["type"]]
        dtype = DTYPES[accessor["componentType"]]
        flat = np.frombuffer(self.binary, dtype, accessor["count"] * width, view.get("byteOffset", 0))
        return flat.reshape(-1, width).astype(np.float64)

    def transforms(self) -> tuple[Floats, dict[str, Floats]]:
        """Key times (N,), and T_world_node (N, 4, 4) by node."""
        nodes, animation = self.document["nodes"], self.document["animations"][0]
        keys: dict[tuple[int, str], Floats] = {}
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            times = self.numbers(sampler["input"])[:, 0]
            keys[channel["target"]["node"], channel["target"]["path"]] = self.numbers(sampler["output"])
        found: dict[str, Floats] = {}

        def place(index: int, T_world_parent: Floats) -> None:
            node, T = nodes[index], np.tile(np.eye(4), (len(times), 1, 1))
            turns = keys.get((index, "rotation"), np.tile(node["rotation"], (len(times), 1)))
            T[:, :3, :3] = Rotation.from_quat(turns).as_matrix()
            T[:, :3, 3] = keys.get((index, "translation"), node["translation"])
            found[node["name"]] = T_world_parent @ T
            for child in node.get("children", []):
                place(child, found[node["name"]])

        place(self.skin["skeleton"], np.tile(np.eye(4), (len(times), 1, 1)))
        return times, found

    @property
    def skin(self) -> dict[str, Any]:
        """The only one."""
        (skin,) = self.document["skins"]
        return dict(skin)

    @property
    def attributes(self) -> dict[str, Floats]:
        """Those of the only mesh's vertices, which all its primitives share."""
        (mesh,) = self.document["meshes"]
        shared = [primitive["attributes"] for primitive in mesh["primitives"]]
        assert all(attributes == shared[0] for attributes in shared)
        return {name: self.numbers(index) for name, index in shared[0].items()}

    @property
    def faces(self) -> dict[str, Ints]:
        """Triangles (F, 3) by their material."""
        (mesh,) = self.document["meshes"]
        names = [material["name"] for material in self.document["materials"]]
        return {
            names[primitive["material"]]: self.numbers(primitive["indices"]).astype(np.int32).reshape(-1, 3)
            for primitive in mesh["primitives"]
        }

    def posed(self) -> Floats:
        """The skinned vertices (N, V, 3) in each key frame, by linear blending."""
        _, placed = self.transforms()
        inverses = self.numbers(self.skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        names = [self.document["nodes"][index]["name"] for index in self.skin["joints"]]
        T = np.stack([placed[name] for name in names], axis=1) @ inverses
        attributes = self.attributes
        influences, weights = attributes["JOINTS_0"].astype(int), attributes["WEIGHTS_0"]
        blended = np.einsum("vk,nvkab->nvab", weights, T[:, influences])
        posed = np.einsum("nvab,vb->nva", blended[..., :3, :3], attributes["POSITION"])
        return np.asarray(posed + blended[..., :3, 3])


@pytest.fixture(scope="module")
def result(bare_result: Path) -> Result:
    return load_result(bare_result)


@pytest.fixture(scope="module")
def glb(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Glb:
    path = tmp_path_factory.mktemp("glb") / "motion.glb"
    write_glb(path, result.motion)
    return Glb(path)


def test_joints_are_where_they_are_in_the_world(glb: Glb, result: Result) -> None:
    times_s, placed = glb.transforms()
    np.testing.assert_allclose(times_s, np.arange(16) / 29.97, atol=1e-6)
    T_world_joint = result.motion.T_world_joint
    for name, joint in {**SEGMENT_JOINT, "head_top": "head_top"}.items():
        expected = T_world_joint[:, JOINT_INDEX[joint], :3, 3][:, [1, 2, 0]]
        np.testing.assert_allclose(placed[name][:, :3, 3], expected, rtol=0, atol=1e-5)


def test_the_skin_moves_as_the_segments_do_where_one_alone_moves_it(glb: Glb, result: Result) -> None:
    posed, weights = glb.posed(), glb.attributes["WEIGHTS_0"]
    alone = weights.max(axis=1) == 1.0
    assert alone.mean() > 0.5
    for n, pose in enumerate(result.poses):
        off_m = distances_m(posed[n][alone], result.motion.body, pose)
        assert np.percentile(off_m, 90) < 1e-5
        assert off_m.max() < 0.01  # between fingers there are new vertices


def test_in_its_bind_pose_the_skin_is_the_segments(result: Result, tmp_path: Path) -> None:
    motion, pose = result.motion, bind_pose(result.motion.body)
    one = replace(motion, frames=motion.frames[:1], times_s=motion.times_s[:1], poses=pose[None])
    write_glb(tmp_path / "bind.glb", one)
    glb = Glb(tmp_path / "bind.glb")
    np.testing.assert_allclose(glb.posed()[0], glb.attributes["POSITION"], atol=1e-6)
    off_m = distances_m(glb.posed()[0], motion.body, pose)
    assert np.percentile(off_m, 70) < 1e-5
    assert off_m.max() < 0.015  # new vertices lie at most half an edge from old ones


def distances_m(points_m: Floats, body: Body, pose: Floats) -> Floats:
    """How far points (V, 3) in the file's axes are from the nearest vertices of a body in a pose (D,)."""
    placed = zip(body.shown, segment_transforms(pose[None], body.offsets_m)[0], strict=True)
    tracked_m = np.concatenate(
        [
            vertices_m @ T_world_segment[:3, :3].T + T_world_segment[:3, 3]
            for (vertices_m, _), T_world_segment in placed
        ]
    )
    return np.asarray(cKDTree(tracked_m[:, [1, 2, 0]]).query(points_m)[0])


def test_it_is_one_closed_surface(glb: Glb) -> None:
    vertices_m, faces = glb.attributes["POSITION"], np.concatenate(list(glb.faces.values()))
    skin = trimesh.Trimesh(vertices_m, faces, process=False)
    assert skin.is_watertight
    assert skin.is_winding_consistent
    assert skin.body_count == 1


def test_normals_are_of_length_one_and_point_outwards(glb: Glb) -> None:
    attributes, faces = glb.attributes, np.concatenate(list(glb.faces.values()))
    vertices, normals = attributes["POSITION"], attributes["NORMAL"]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
    grown = trimesh.Trimesh(vertices + 0.001 * normals, faces, process=False)
    skin = trimesh.Trimesh(vertices, faces, process=False)
    assert grown.volume - skin.volume > 0.0009 * skin.area > 0


def test_before_it_plays_the_body_stands_as_in_the_first_frame(glb: Glb) -> None:
    animation = glb.document["animations"][0]
    for channel in animation["channels"]:
        first = glb.numbers(animation["samplers"][channel["sampler"]]["output"])[0]
        node = glb.document["nodes"][channel["target"]["node"]]
        np.testing.assert_allclose(node[channel["target"]["path"]], first, atol=1e-7)


def test_a_joint_for_each_segment_and_its_side_in_its_colour(glb: Glb) -> None:
    nodes = [node["name"] for node in glb.document["nodes"]]
    joints = [nodes[index] for index in glb.skin["joints"]]
    assert joints == [*SEGMENT_NAMES, "head_top"]
    attributes = glb.attributes
    most = attributes["JOINTS_0"][
        np.arange(len(attributes["JOINTS_0"])), attributes["WEIGHTS_0"].argmax(axis=1)
    ]
    for side, faces in glb.faces.items():
        moved_by = {joints[int(joint)] for joint in np.unique(most[faces])}
        ends = {name for name in moved_by if name.endswith(("forearm", "hand", "shank", "foot"))}
        expected = {f"{side}_{name}" for name in ("forearm", "hand", "shank", "foot")}
        assert ends == (set() if side == "centre" else expected)


def test_quaternions_never_change_sides(glb: Glb) -> None:
    animation = glb.document["animations"][0]
    for sampler in animation["samplers"][1:]:
        quaternions = glb.numbers(sampler["output"])
        assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=1) >= 0)
