"""The space of shapes: every vector within the bounds is a sound body, and zero is the generic one."""

from itertools import product

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mocap.body.actor import DEFAULT_HEIGHT_M, Actor, build_body
from services.mocap.body.body_mesh import generic_segments
from services.mocap.body.bones import BONES
from services.mocap.body.kinematics import N_DOF, joint_positions
from services.mocap.body.profiles import SECTIONS, Profile
from services.mocap.body.shape_space import (
    DEVIATIONS,
    INDEX,
    LOWER,
    PARAMETERS,
    UPPER,
    ShapeParameter,
    actor_of,
    body_of,
    clip_to_bounds,
    of_kind,
    vector_of,
)
from services.mocap.body.skeleton import JOINT_INDEX, SEGMENT_NAMES
from services.mocap.types import Floats, Ints

GENERIC = np.zeros(len(PARAMETERS))


def within_bounds(seed: int) -> Floats:
    """Half of the parameters anywhere, the others at one of their bounds."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(0.0, 1.0, len(PARAMETERS))
    return LOWER + (UPPER - LOWER) * np.where(rng.random(len(at)) < 0.5, at, np.rint(at))


SHAPES = st.integers(0, 2**32 - 1).map(within_bounds)


def test_zero_is_the_generic_body_to_the_last_bit() -> None:
    body = body_of(GENERIC)
    np.testing.assert_array_equal(body.offsets_m, build_body(Actor()).offsets_m)
    for vertices_m, mesh in zip(body.vertices_m, generic_segments(), strict=True):
        np.testing.assert_array_equal(vertices_m, mesh.vertices_heights * DEFAULT_HEIGHT_M)


def test_parameters_are_well_formed() -> None:
    assert len(INDEX) == len(PARAMETERS)
    assert {PARAMETERS[i].name for i in of_kind("bone")} == set(BONES)
    assert of_kind("height", "bone", "joint", "profile") == tuple(range(len(PARAMETERS)))
    assert np.all(LOWER < -2 * DEVIATIONS)
    assert np.all(UPPER > 2 * DEVIATIONS)


@given(SHAPES)
@settings(max_examples=50, deadline=None)
def test_an_actor_has_its_vector_and_its_file(x: Floats) -> None:
    actor = actor_of(x)
    np.testing.assert_allclose(vector_of(actor), x, atol=1e-12)
    assert Actor.from_toml(actor.to_toml()) == actor


def test_other_actors_get_a_vector_near_them() -> None:
    assert np.all(vector_of(Actor()) == 0.0)
    x = vector_of(Actor(height=1.8, profiles={"thigh": Profile(width=(1.2,), depth=(1.2,))}))
    assert x[INDEX["height"]] == pytest.approx(np.log(1.8 / DEFAULT_HEIGHT_M))
    assert x[INDEX["leg_girth_thigh"]] == pytest.approx(np.log(1.2))
    assert x[INDEX["leg_girth_ankle"]] == 0.0
    vast = vector_of(Actor(profiles={"head": Profile(width=(3.0,))}))
    np.testing.assert_array_equal(vast, clip_to_bounds(vast))


@pytest.mark.parametrize("parameter", PARAMETERS, ids=lambda parameter: parameter.name)
def test_every_parameter_shows(parameter: ShapeParameter) -> None:
    x = GENERIC.copy()
    x[INDEX[parameter.name]] = parameter.deviation
    body, generic = body_of(x), body_of(GENERIC)
    moved_m = max(
        float(np.abs(a - b).max()) for a, b in zip(body.vertices_m, generic.vertices_m, strict=True)
    )
    offsets_m = np.abs(body.offsets_m - generic.offsets_m).max()
    assert max(moved_m, offsets_m) > 1e-3


@given(SHAPES)
@settings(max_examples=15, deadline=None)
def test_every_mesh_stays_closed_and_wound_outwards(x: Floats) -> None:
    body = body_of(x)
    for name, vertices_m, faces in zip(SEGMENT_NAMES, body.vertices_m, body.faces, strict=True):
        shell = trimesh.Trimesh(vertices_m, faces, process=False)
        assert shell.is_watertight, name
        assert shell.is_winding_consistent, name
        assert all(part.volume > 0 for part in shell.split(only_watertight=False)), name


@given(SHAPES)
@settings(max_examples=15, deadline=None)
def test_no_face_turns_round(x: Floats) -> None:
    """A shape stretches space, one to one, as all its factors are positive; every face follows its normal.

    Only the hips' depth does more: it shears the thighs, by at most 10 degrees.
    """
    stretching = np.where(np.arange(len(x)) == INDEX["hip_depth"], 0.0, x)
    for name, mesh, vertices_m in zip(
        SEGMENT_NAMES, generic_segments(), body_of(stretching).vertices_m, strict=True
    ):
        axes = ["xyz".index(axis) for axis in SECTIONS[bare(name)].axes]
        generic, shaped = mesh.vertices_heights[:, axes], vertices_m[:, axes]
        factors = shaped[generic != 0] / generic[generic != 0]
        assert np.all(np.isfinite(factors) & (factors > 0)), name
        if bare(name) == "foot":
            stretched = stretched_foot_normals(generic, shaped, mesh.faces)
        else:
            stretched = stretched_normals(generic, shaped, mesh.faces)
        cosines = np.sum(stretched * normals(shaped, mesh.faces), axis=1)
        cosines /= np.linalg.norm(stretched, axis=1) * np.linalg.norm(normals(shaped, mesh.faces), axis=1)
        assert cosines.min() > 0.8, name


def bare(name: str) -> str:
    return name.removeprefix("left_").removeprefix("right_")


def normals(vertices: Floats, faces: Ints) -> Floats:
    """(F, 3) of any length."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def stretched_normals(generic: Floats, shaped: Floats, faces: Ints) -> Floats:
    """Normals (F, 3) where the faces lie, by the derivative of the map from generic to shaped points.

    Both (V, 3) as (along, width, depth); the map scales along by one number, width and depth by functions
    of along, which may differ on the two sides of the bone.
    """
    centres = generic[faces].mean(axis=1)
    J = np.zeros((len(faces), 3, 3))
    for k, side in product(range(3), (-1.0, 1.0)):
        away, here = side * generic[:, k] > 1e-4, side * centres[:, k] >= 0
        if not here.any():
            continue
        at, first = np.unique(generic[away, 0], return_index=True)
        factors = (shaped[away, k] / generic[away, k])[first]
        J[here, k, k] = np.interp(centres[here, 0], at, factors)
        if k > 0:
            slopes = [np.interp(centres[here, 0] + step, at, factors) for step in (1e-3, -1e-3)]
            J[here, k, 0] = centres[here, k] * (slopes[0] - slopes[1]) / 2e-3
    turned: Floats = np.linalg.solve(J.transpose(0, 2, 1), normals(generic, faces)[..., None])[..., 0]
    return turned


def stretched_foot_normals(generic: Floats, shaped: Floats, faces: Ints) -> Floats:
    """As stretched_normals; a foot's depth grows from the ankle to the sole, and its width is one number."""
    along, across, height = shaped.max(axis=0) / generic.max(axis=0)
    centres, at = (points[faces].mean(axis=1)[:, 2] for points in (generic, shaped))
    deep = np.where(centres < 0, 2 * at / centres - height, height)  # d at / d centres: at is quadratic
    factors = np.stack([np.full_like(deep, along), np.full_like(deep, across), deep], axis=1)
    turned: Floats = normals(generic, faces) / factors
    return turned


@given(SHAPES)
@settings(max_examples=15, deadline=None)
def test_left_and_right_are_mirror_images(x: Floats) -> None:
    body = body_of(x)
    by_name = dict(zip(SEGMENT_NAMES, body.vertices_m, strict=True))
    for name, vertices_m in by_name.items():
        if name.startswith("left_"):
            right = by_name[name.replace("left", "right")]
            np.testing.assert_array_equal(right * (1.0, -1.0, 1.0), vertices_m)
    joints_m = joint_positions(np.zeros((1, N_DOF)), body.offsets_m)[0]
    for name, j in JOINT_INDEX.items():
        if name.startswith("left_"):
            mirrored = JOINT_INDEX[name.replace("left", "right")]
            np.testing.assert_array_equal(joints_m[mirrored] * (1.0, -1.0, 1.0), joints_m[j])
