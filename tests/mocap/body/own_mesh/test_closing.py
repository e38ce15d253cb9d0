"""Whatever triangles come in, closed surfaces come out."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from services.mocap.body.own_mesh.character import Piece, cut_where
from services.mocap.body.own_mesh.closing import closed
from services.mocap.body.surface import is_closed
from services.mocap.types import Ints

_RNG = np.random.default_rng(3)
_POINTS = _RNG.normal(size=(12, 3))
_SPHERE = trimesh.creation.icosphere(subdivisions=4, radius=1.0)


def volume(piece: Piece) -> float:
    a, b, c = piece.vertices[piece.faces].transpose(1, 0, 2)
    return float(np.einsum("fi,fi->", a, np.cross(b, c))) / 6.0


def piece(faces: Ints, cut: bool = False) -> Piece:
    vertices = np.asarray(_SPHERE.vertices)
    return Piece(vertices, faces.astype(np.int32), np.full(len(vertices), cut))


@given(
    arrays(np.int32, st.tuples(st.integers(1, 40), st.just(3)), elements=st.integers(0, 11)), st.booleans()
)
def test_any_triangles_become_closed_surfaces(faces: Ints, domed: bool) -> None:
    faces = faces[np.all(faces != np.roll(faces, 1, axis=1), axis=1)]
    if len(faces):
        done = closed(Piece(_POINTS, faces, np.ones(len(_POINTS), bool)), domed)
        assert is_closed(done.faces)
        assert volume(done) >= -1e-9


def test_a_closed_surface_stays_as_it_is() -> None:
    done = closed(piece(_SPHERE.faces), domed=True)
    assert len(done.faces) == len(_SPHERE.faces)
    assert volume(done) == pytest.approx(_SPHERE.volume)


@pytest.mark.parametrize("turn", [slice(None), slice(None, None, 3), slice(0, 0)])
def test_faces_are_turned_outside_out(turn: slice) -> None:
    faces = np.array(_SPHERE.faces)
    faces[turn] = faces[turn, ::-1]
    done = closed(piece(faces), domed=True)
    assert len(done.faces) == len(faces)
    assert volume(done) == pytest.approx(_SPHERE.volume)


def test_a_half_sphere_gets_a_lid_or_a_dome_where_it_was_cut() -> None:
    half = cut_where(
        np.asarray(_SPHERE.vertices), np.asarray(_SPHERE.faces, np.int32), _SPHERE.vertices[:, 2]
    )
    flat, domed = closed(half, domed=False), closed(half, domed=True)
    assert flat.vertices[:, 2].min() > -0.05
    assert domed.vertices[:, 2].min() == pytest.approx(-1.0, abs=0.02)
    assert volume(flat) == pytest.approx(_SPHERE.volume / 2, rel=0.01)
    assert volume(domed) == pytest.approx(_SPHERE.volume, rel=0.06)  # its rings are few


def test_a_hole_that_is_no_cut_is_covered_flat() -> None:
    open_top = piece(_SPHERE.faces[_SPHERE.triangles_center[:, 2] < 0.5])
    assert closed(open_top, domed=True).vertices[:, 2].max() < 0.6


def test_cut_halves_have_the_whole_area() -> None:
    vertices, faces = np.asarray(_SPHERE.vertices), np.asarray(_SPHERE.faces, np.int32)
    field = vertices[:, 0] + 0.3 * vertices[:, 1] - 0.2
    halves = [cut_where(vertices, faces, sign * field) for sign in (1.0, -1.0)]
    areas = [trimesh.Trimesh(half.vertices, half.faces, process=False).area for half in halves]
    assert sum(areas) == pytest.approx(_SPHERE.area, rel=1e-3)
