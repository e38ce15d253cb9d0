"""The flat mesh holds every edge once, in blocks whose bounds hold."""

from dataclasses import replace

import numpy as np
import pytest

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_RIGID
from services.mocap.energy.cpu.mesh import BLOCK, FlatMesh
from services.mocap.energy.cpu.outline import mesh_of
from services.mocap.types import Ints


def _with_faces(body: Body, faces: Ints) -> Body:
    return Body(body.offsets_m, body.vertices_m, (faces, *body.faces[1:]), body.height_m)


def test_an_open_mesh_is_refused(coarse_body: Body) -> None:
    with pytest.raises(ValueError, match="not closed"):
        FlatMesh.of(_with_faces(coarse_body, coarse_body.faces[0][1:]))


def test_a_face_wound_the_other_way_is_refused(coarse_body: Body) -> None:
    faces = coarse_body.faces[0].copy()
    faces[0] = faces[0, ::-1]
    with pytest.raises(ValueError, match="not closed"):
        FlatMesh.of(_with_faces(coarse_body, faces))


def test_an_edge_with_four_faces_is_refused(coarse_body: Body) -> None:
    faces = coarse_body.faces[0]
    with pytest.raises(ValueError, match="not closed"):
        FlatMesh.of(_with_faces(coarse_body, np.concatenate([faces, faces])))


def test_every_edge_is_there_once_with_its_two_faces(real_body: Body) -> None:
    mesh = FlatMesh.of(real_body)
    for s, faces in enumerate(real_body.faces):
        edges = mesh.edges[BLOCK * mesh.starts[1, s] : BLOCK * mesh.starts[1, s + 1]].astype(np.int64)
        edges = edges[edges[:, 0] != edges[:, 1]] - mesh.starts[0, s]
        a, b, c, d = edges.T
        halves = {tuple(half) for half in np.concatenate([edges[:, [0, 1, 2]], np.stack([b, a, d], axis=1)])}
        expected = {tuple(np.roll(face, -k)) for face in faces for k in range(3)}
        assert len(edges) * 2 == len(halves) == 3 * len(faces)
        assert halves == expected
        assert (c != d).all()


def test_blocks_bound_their_planes(real_body: Body) -> None:
    mesh = FlatMesh.of(real_body)
    planes = (
        mesh.planes.reshape(len(mesh.planes), 2, 4, BLOCK).transpose(0, 1, 3, 2).reshape(-1, 2 * BLOCK, 4)
    )
    real = np.any(planes[..., :3] != 0, axis=2)
    lengths = np.linalg.norm(planes[..., :3], axis=2)
    unit = planes / np.where(real, lengths, 1.0)[..., None]
    middle, off, lengthening = mesh.block_planes[:4].T, mesh.block_planes[4:8].T, mesh.block_planes[8]
    within = np.abs(unit - middle[:, None]) <= off[:, None] + 1e-6
    assert np.all(within | ~real[..., None])
    assert np.all((lengths * lengthening[:, None] >= 1 - 1e-6) | ~real)


def test_spheres_hold_their_segments(real_body: Body) -> None:
    mesh = FlatMesh.of(real_body)
    assert not mesh.spheres_m[len(real_body.vertices_m) :].any()  # of a skirt that nobody wears
    for vertices, sphere in zip(real_body.vertices_m, mesh.spheres_m, strict=False):
        distance = np.linalg.norm(vertices - sphere[:3], axis=1).max()
        assert distance <= sphere[3] <= distance * 1.001


def test_everything_that_draws_a_body_shares_its_mesh(coarse_body: Body) -> None:
    assert mesh_of(coarse_body, True) is mesh_of(coarse_body, True)
    assert len(mesh_of(coarse_body, False).errors_m) == 1 < len(mesh_of(coarse_body, True).errors_m)
    assert mesh_of(replace(coarse_body), True) is not mesh_of(coarse_body, True)


def test_spheres_of_webs_hold_everything(skirted_body: Body) -> None:
    assert FlatMesh.of(skirted_body).spheres_m[N_RIGID:, 3].tolist() == [np.inf] * 4
