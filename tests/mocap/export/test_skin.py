"""The one skin of a body: closed, whole, and moved by neighbouring segments only."""

import numpy as np
import pytest
import trimesh

from characters import bind_pose as t_pose
from characters import write_skinned_glb
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.garments import Skirt
from services.mocap.body.own_mesh.mesh_import import import_mesh
from services.mocap.body.skeleton import SEGMENT_INDEX, SEGMENT_NAMES
from services.mocap.export.skin import Skin, skin_of

STEEPEST_PER_M = 13.0
"""From a half to nothing over 6 cm, gently at both ends."""


@pytest.fixture(scope="module", params=["generic", "in a skirt", "own mesh", "stout and short-armed"])
def skin(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Skin:
    if request.param == "in a skirt":
        actor = Actor(skirt=Skirt(length=0.25, flare=0.1))
    elif request.param == "own mesh":
        path = tmp_path_factory.mktemp("own") / "character.glb"
        write_skinned_glb(path, Actor(height=1.6), t_pose())
        actor = Actor(mesh=import_mesh(path).mesh)
    elif request.param == "generic":
        actor = Actor()
    else:
        wide = {"width": (1.4, 1.5, 1.5), "depth": (1.5, 1.6, 1.6)}
        actor = Actor(profiles={"pelvis": wide, "thigh": wide}, bone_lengths={"upper_arm": 0.24})
    return skin_of(build_body(actor))


def test_it_is_closed_and_in_one_piece_with_a_skirt_about_it(
    skin: Skin, request: pytest.FixtureRequest
) -> None:
    mesh = trimesh.Trimesh(skin.vertices_m, skin.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.03
    assert mesh.body_count == (2 if "in a skirt" in request.node.name else 1)


def test_it_stands_on_the_floor(skin: Skin) -> None:
    assert skin.vertices_m[:, 2].min() == pytest.approx(0.0, abs=1e-3)


def test_every_segment_shows_and_moves_some_of_it_alone(skin: Skin) -> None:
    shown, alone = np.unique(skin.face_segments), np.flatnonzero((skin.weights == 1.0).any(axis=0))
    assert {SEGMENT_NAMES[s] for s in shown} == set(SEGMENT_NAMES)
    assert set(SEGMENT_NAMES) - {SEGMENT_NAMES[s] for s in alone} <= {"neck"}  # which is short


def test_weights_change_gradually_over_the_skin(skin: Skin) -> None:
    """Nearly everywhere: three segments meet at the neck and the hips, and stout thighs may part."""
    np.testing.assert_allclose(skin.weights.sum(axis=1), 1.0, atol=1e-12)
    assert skin.weights.min() >= 0.0
    edges = np.concatenate([skin.faces[:, [0, 1]], skin.faces[:, [1, 2]], skin.faces[:, [2, 0]]])
    lengths_m = np.linalg.norm(np.diff(skin.vertices_m[edges], axis=1)[:, 0], axis=1)
    changes = np.abs(np.diff(skin.weights[edges], axis=1)[:, 0])
    left, right = (SEGMENT_INDEX[f"{side}_thigh"] for side in ("left", "right"))
    changes[(changes[:, left] > 0) & (changes[:, right] > 0)] = 0.0
    too_steep = changes.max(axis=1) > STEEPEST_PER_M * lengths_m + 1e-6
    assert too_steep.mean() < 0.03
