"""motion.glb read back by the rules of glTF 2.0: nodes, meshes and keys, and nothing of our own."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from services.mocap.body.kinematics import segment_transforms
from services.mocap.body.skeleton import SEGMENT_NAMES
from services.mocap.export.glb import write_glb
from services.mocap.result.result import Result, load_result
from services.mocap.types import Floats

WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
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

        for root in self.document["scenes"][self.document["scene"]]["nodes"]:
            place(root, np.tile(np.eye(4), (len(times), 1, 1)))
        return times, found


@pytest.fixture(scope="module")
def result(bare_result: Path) -> Result:
    return load_result(bare_result)


@pytest.fixture(scope="module")
def glb(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Glb:
    path = tmp_path_factory.mktemp("glb") / "motion.glb"
    write_glb(path, result.motion)
    return Glb(path)


def test_every_point_of_the_body_is_where_it_is_in_the_world(glb: Glb, result: Result) -> None:
    times_s, placed = glb.transforms()
    np.testing.assert_allclose(times_s, np.arange(16) / 29.97, atol=1e-6)
    meshes = {mesh["name"]: mesh["primitives"][0] for mesh in glb.document["meshes"]}
    body = result.motion.body
    T_world_segment = segment_transforms(result.poses, body.offsets_m)
    for s, name in enumerate(SEGMENT_NAMES):
        vertices = glb.numbers(meshes[name]["attributes"]["POSITION"])
        T = placed[name]
        world = np.einsum("nab,vb->nva", T[:, :3, :3], vertices) + T[:, None, :3, 3]
        expected = np.einsum("nab,vb->nva", T_world_segment[:, s, :3, :3], body.vertices_m[s])
        expected += T_world_segment[:, s, None, :3, 3]
        np.testing.assert_allclose(world, expected[..., [1, 2, 0]], rtol=0, atol=1e-5)
        faces = glb.numbers(meshes[name]["indices"]).astype(np.int32).reshape(-1, 3)
        np.testing.assert_array_equal(faces, body.faces[s])
    top = result.joints_world_m[:, 2][:, [1, 2, 0]]
    np.testing.assert_allclose(placed["head_top"][:, :3, 3], top, rtol=0, atol=1e-5)


def test_normals_are_of_length_one_and_point_outwards(glb: Glb) -> None:
    for mesh in glb.document["meshes"]:
        attributes = mesh["primitives"][0]["attributes"]
        vertices, normals = (glb.numbers(attributes[name]) for name in ("POSITION", "NORMAL"))
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
        faces = glb.numbers(mesh["primitives"][0]["indices"]).astype(int).reshape(-1, 3)
        grown = trimesh.Trimesh(vertices + 0.001 * normals, faces, process=False)
        skin = trimesh.Trimesh(vertices, faces, process=False)
        assert grown.volume - skin.volume > 0.0009 * skin.area > 0, mesh["name"]


def test_before_it_plays_the_body_stands_as_in_the_first_frame(glb: Glb) -> None:
    animation = glb.document["animations"][0]
    for channel in animation["channels"]:
        first = glb.numbers(animation["samplers"][channel["sampler"]]["output"])[0]
        node = glb.document["nodes"][channel["target"]["node"]]
        np.testing.assert_allclose(node[channel["target"]["path"]], first, atol=1e-7)


def test_a_node_for_each_segment_and_its_side_in_its_colour(glb: Glb) -> None:
    nodes = {node["name"]: node for node in glb.document["nodes"]}
    assert set(nodes) == {*SEGMENT_NAMES, "head_top"}
    assert "mesh" not in nodes["head_top"]
    materials = [material["name"] for material in glb.document["materials"]]
    for name in SEGMENT_NAMES:
        primitive = glb.document["meshes"][nodes[name]["mesh"]]["primitives"][0]
        side = name.split("_")[0] if name.startswith(("left", "right")) else "centre"
        assert materials[primitive["material"]] == side


def test_quaternions_never_change_sides(glb: Glb) -> None:
    animation = glb.document["animations"][0]
    for sampler in animation["samplers"][1:]:
        quaternions = glb.numbers(sampler["output"])
        assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=1) >= 0)
