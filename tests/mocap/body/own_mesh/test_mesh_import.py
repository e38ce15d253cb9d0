"""Own meshes: what was put in comes out, in our rest pose, closed, whatever the file calls its bones."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from characters import MIXAMO, PERSON, bind_pose, write_parts_obj, write_skinned_glb
from services.mocap.body.actor import MESH_FILE, Actor, Body, build_body
from services.mocap.body.body_mesh import MeshContentError, OwnMesh
from services.mocap.body.own_mesh import mesh_import
from services.mocap.body.own_mesh.mesh_import import Imported, import_mesh
from services.mocap.body.shape_space import PARAMETERS, actor_of, vector_of
from services.mocap.body.skeleton import JOINTS, SEGMENT_NAMES
from services.mocap.body.surface import is_closed
from services.mocap.errors import UserError

VRM = {
    "pelvis": "hips", "waist": "spine", "neck": "neck", "head": "head",
    **{f"{side}_{joint}": f"{side}{bone}" for side in ("left", "right") for joint, bone in (
        ("shoulder", "UpperArm"), ("elbow", "LowerArm"), ("wrist", "Hand"),
        ("hip", "UpperLeg"), ("knee", "LowerLeg"), ("ankle", "Foot"))},
}  # fmt: skip
UNREAL = {
    "pelvis": "pelvis", "waist": "spine_01", "neck": "neck_01", "head": "head",
    **{f"{side}_{joint}": f"{bone}_{side[0]}" for side in ("left", "right") for joint, bone in (
        ("shoulder", "upperarm"), ("elbow", "lowerarm"), ("wrist", "hand"),
        ("hip", "thigh"), ("knee", "calf"), ("ankle", "foot"))},
}  # fmt: skip


def as_person(mesh: OwnMesh, person: Body) -> Body:
    return build_body(Actor(height=person.standing_height_m, mesh=mesh))


def joint_errors_m(body: Body, person: Body) -> np.ndarray:
    return np.linalg.norm(body.offsets_m - person.offsets_m, axis=1)


def test_an_a_pose_becomes_our_rest_pose(imported: Imported, person: Body) -> None:
    body = as_person(imported.mesh, person)
    assert joint_errors_m(body, person).max() < 0.002
    assert body.standing_height_m == pytest.approx(person.standing_height_m, abs=1e-4)
    for name, ours, theirs in zip(SEGMENT_NAMES, body.vertices_m, person.vertices_m, strict=True):
        across = (0, 2) if "arm" in name else (0, 1)
        if name.endswith(("arm", "shank")):  # the others are cut elsewhere, where they are wide
            ours, theirs = (above_instep(v) if name.endswith("shank") else v for v in (ours, theirs))
            np.testing.assert_allclose(extent(ours)[[*across]], extent(theirs)[[*across]], atol=0.012)


def above_instep(shank_m: np.ndarray) -> np.ndarray:
    """The vertices of a shank over what a cut at the ankle leaves of the foot."""
    return shank_m[shank_m[:, 2] > 0.75 * shank_m[:, 2].min()]


def extent(vertices_m: np.ndarray) -> np.ndarray:
    return np.ptp(vertices_m, axis=0)


def test_every_segment_is_closed_and_outside_out(imported: Imported) -> None:
    for segment in imported.mesh.segments:
        assert is_closed(segment.faces)
        assert trimesh.Trimesh(segment.vertices_heights, segment.faces, process=False).volume > 0


def test_large_meshes_are_thinned_and_that_is_said(
    imported: Imported, a_pose_glb: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert imported.remarks == ()
    monkeypatch.setattr(mesh_import, "_MOST_FACES", 7000)
    monkeypatch.setattr(mesh_import, "_THINNED_FACES", 6000)
    thinned = import_mesh(a_pose_glb)
    assert sum(map(len, thinned.mesh.faces)) < 7000
    (remark,) = thinned.remarks
    assert remark.startswith(f"{a_pose_glb}: its ")
    assert "triangles were thinned to " in remark
    for ours, theirs in zip(thinned.mesh.segments, imported.mesh.segments, strict=True):
        assert is_closed(ours.faces)
        np.testing.assert_allclose(extent(ours.vertices_heights), extent(theirs.vertices_heights), atol=0.01)


@pytest.mark.parametrize(("names", "prefix"), [(MIXAMO, ""), (VRM, ""), (VRM, "J_Bip_"), (UNREAL, "")])
def test_bones_are_known_by_many_names(
    names: dict[str, str], prefix: str, person: Body, tmp_path: Path
) -> None:
    path, pose = tmp_path / "character.glb", bind_pose(0.8, 0.15)
    write_skinned_glb(path, PERSON, pose, names=names, prefix=prefix, unit_m=1.0)
    body = as_person(import_mesh(path).mesh, person)
    assert joint_errors_m(body, person)[[j.name != "head_top" for j in JOINTS]].max() < 0.002


def test_parts_are_joined_where_they_touch(person: Body, tmp_path: Path) -> None:
    names = {"left_upper_arm": "UpperArm.L", "right_shank": "right calf", "torso": "Chest"}
    write_parts_obj(tmp_path / "parts.obj", PERSON, bind_pose(), names)
    body = as_person(import_mesh(tmp_path / "parts.obj").mesh, person)
    assert joint_errors_m(body, person).max() < 0.025
    for ours, theirs in zip(body.faces, person.faces, strict=True):
        assert len(ours) == len(theirs)


def test_faces_may_count_vertices_back_from_where_they_stand(tmp_path: Path) -> None:
    ahead, back = tmp_path / "ahead.obj", tmp_path / "back.obj"
    write_parts_obj(ahead, PERSON, bind_pose())
    lines, n_before = [], 0
    for line in ahead.read_text().splitlines():
        n_before += line.startswith("v ")
        if line.startswith("f "):
            line = "f " + " ".join(str(int(v) - n_before - 1) for v in line.split()[1:])
        lines.append(line)
    back.write_text("\n".join(lines))
    assert import_mesh(back).mesh == import_mesh(ahead).mesh


def test_the_fit_shapes_an_own_mesh_as_it_does_the_generic_one(imported: Imported) -> None:
    zero = np.zeros(len(PARAMETERS))
    plain = Actor(height=1.72, mesh=imported.mesh)
    np.testing.assert_allclose(vector_of(plain), zero, atol=1e-12)
    same, own = build_body(actor_of(zero, plain)), build_body(plain)
    np.testing.assert_allclose(np.vstack(same.vertices_m), np.vstack(own.vertices_m), atol=1e-12)
    x = np.linspace(-0.05, 0.05, len(PARAMETERS))
    np.testing.assert_allclose(vector_of(actor_of(x, plain)), x, atol=1e-12)
    longer = build_body(Actor(height=1.72, mesh=imported.mesh, bone_lengths={"forearm": 0.3}))
    moved = np.abs(longer.offsets_m - own.offsets_m).max(axis=1) > 1e-9
    assert {joint.name for joint, m in zip(JOINTS, moved, strict=True) if m} == {"left_wrist", "right_wrist"}


def test_its_file_holds_the_mesh(imported: Imported) -> None:
    again = OwnMesh.from_bytes(imported.mesh.content)
    assert again == imported.mesh
    actor = Actor(height=1.7, mesh=imported.mesh)
    text = actor.to_toml()
    assert MESH_FILE in text
    assert imported.mesh.content_hash in text
    assert Actor.from_toml(text, lambda _: again) == actor
    assert actor.content_hash != Actor(height=1.7).content_hash


@pytest.mark.parametrize("damage", [b"", b"PK", lambda c: c[: len(c) // 2], lambda c: c[:500] + c[600:]])
def test_a_damaged_file_is_refused(imported: Imported, damage) -> None:
    with pytest.raises(MeshContentError):
        OwnMesh.from_bytes(damage(imported.mesh.content) if callable(damage) else damage)


def refusal(path: Path) -> str:
    with pytest.raises(UserError) as refused:
        import_mesh(path)
    sentence = str(refused.value)
    assert sentence.startswith(f"{path}: ")
    assert "\n" not in sentence
    return sentence.removeprefix(f"{path}: ")


def test_missing_bones_are_named(tmp_path: Path) -> None:
    some = {joint: bone for joint, bone in MIXAMO.items() if joint not in ("left_shoulder", "left_elbow")}
    write_skinned_glb(tmp_path / "c.glb", PERSON, bind_pose(), names=some)
    assert refusal(tmp_path / "c.glb").startswith(
        "has no bone that rotates at the left shoulder, left elbow:"
    )


def test_bones_with_other_names_are_not_human(tmp_path: Path) -> None:
    robot = {joint: f"servo{k}" for k, joint in enumerate(MIXAMO)}
    write_skinned_glb(tmp_path / "c.glb", PERSON, bind_pose(), names=robot, prefix="")
    assert "has a human name" in refusal(tmp_path / "c.glb")


def test_missing_parts_are_named(tmp_path: Path) -> None:
    write_parts_obj(tmp_path / "c.obj", PERSON, bind_pose(), {"left_hand": "gripper"})
    assert refusal(tmp_path / "c.obj").startswith("has no part named left_hand:")


def test_a_mesh_without_names_says_what_is_needed(tmp_path: Path) -> None:
    trimesh.creation.icosphere().export(tmp_path / "scan.ply")
    assert refusal(tmp_path / "scan.ply").startswith("has neither bones nor parts with human names: expected")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.glb", b"glTF"),
        ("a.glb", b"{}"),
        ("a.gltf", b'{"skins": [{"joints": [7]}]}'),
        ("a.glb", b'{"meshes": [{"primitives": [{"attributes": {"POSITION": 3}}]}], "nodes": [{"mesh": 0}]}'),
        ("a.obj", b"f 1 2 3\n"),
        ("a.obj", b"\x00\xff"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex x\nend_header\n"),
        ("a.fbx", b"Kaydara"),
        ("missing.glb", None),
    ],
)
def test_what_is_no_mesh_ends_in_one_sentence(tmp_path: Path, name: str, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    assert "expected" in (sentence := refusal(tmp_path / name)) or "export it again" in sentence
