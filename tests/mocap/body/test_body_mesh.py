"""The generic actor's shape: closed, even, symmetric meshes of a person's size that never leave a gap."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from services.mocap.body.body_mesh import SegmentMesh, generic_segments
from services.mocap.body.kinematics import N_DOF, segment_transforms
from services.mocap.body.shape_loft import Loft, loft_mesh
from services.mocap.body.skeleton import JOINT_INDEX, JOINTS, SEGMENT_JOINT, SEGMENT_NAMES
from services.mocap.types import Floats

PELVIS_HEIGHT = 0.513  # of the hip centres over the soles, in body heights
OFFSETS_HEIGHTS = np.array([joint.offset_heights for joint in JOINTS])
CENTRE_SEGMENTS = ("pelvis", "torso", "neck", "head")
# Radius, in body heights, of the ball about a segment's joint that both it and its parent segment fill.
JOINT_BALLS = {
    "torso": 0.030,
    "neck": 0.020,
    "head": 0.018,
    "left_upper_arm": 0.007,
    "left_forearm": 0.017,
    "left_hand": 0.009,
    "left_thigh": 0.032,
    "left_shank": 0.025,
    "left_foot": 0.014,
}
# (what, segment, axis of the cut, where along it, lowest and highest girth): ranges, in body heights,
# about what the survey named in shape_profiles.py finds, reaching lower as its soldiers are heavy.
GIRTHS = [
    ("head over the brow", "head", 2, 0.050, 0.305, 0.355),
    ("neck", "neck", 2, 0.030, 0.195, 0.230),
    ("chest", "torso", 2, 0.130, 0.480, 0.580),
    ("waist", "pelvis", 2, 0.080, 0.420, 0.540),
    ("buttocks", "pelvis", 2, -0.010, 0.520, 0.620),
    ("thigh", "left_thigh", 2, -0.050, 0.320, 0.380),
    ("above the knee", "left_thigh", 2, -0.215, 0.205, 0.240),
    ("calf", "left_shank", 2, -0.075, 0.205, 0.240),
    ("ankle", "left_shank", 2, -0.215, 0.120, 0.140),
    ("upper arm", "left_upper_arm", 1, 0.090, 0.155, 0.205),
    ("forearm", "left_forearm", 1, 0.035, 0.140, 0.180),
    ("wrist", "left_forearm", 1, 0.148, 0.090, 0.105),
]


def in_body(*names: str) -> Floats:
    """Vertices of the named segments in the rest pose, (V, 3) in body heights from the pelvis joint."""
    T_body_segment = segment_transforms(np.zeros((1, N_DOF)), OFFSETS_HEIGHTS)[0]
    placed = []
    for segment, T in zip(generic_segments(), T_body_segment, strict=True):
        if segment.name in names:
            placed.append(segment.vertices_heights @ T[:3, :3].T + T[:3, 3])
    return np.vstack(placed)


def winding_numbers(segment: SegmentMesh, points: Floats) -> Floats:
    """How often the surface wraps each point (P, 3): 0 outside, 1 inside, more where components overlap."""
    corners = segment.vertices_heights[segment.faces][None] - points[:, None, None]
    a, b, c = np.moveaxis(corners, 2, 0)
    la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
    triple = np.einsum("pfi,pfi->pf", a, np.cross(b, c))
    pairs = (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    half_solid_angles = np.arctan2(triple, la * lb * lc + pairs)
    wraps: Floats = half_solid_angles.sum(axis=1) / (2.0 * np.pi)
    return wraps


def by_name(name: str) -> SegmentMesh:
    return generic_segments()[SEGMENT_NAMES.index(name)]


def as_trimesh(segment: SegmentMesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(segment.vertices_heights, segment.faces, process=False)


def parent_segment(name: str) -> str:
    parent_joint = JOINTS[JOINT_INDEX[SEGMENT_JOINT[name]]].parent
    return next(segment for segment, joint in SEGMENT_JOINT.items() if joint == parent_joint)


def test_segments_come_in_order_and_are_shared_read_only() -> None:
    assert tuple(segment.name for segment in generic_segments()) == SEGMENT_NAMES
    assert generic_segments() is generic_segments()
    for segment in generic_segments():
        assert segment.vertices_heights.dtype == np.float64
        assert segment.faces.dtype == np.int32
        assert not segment.vertices_heights.flags.writeable
        assert not segment.faces.flags.writeable


@pytest.mark.parametrize("name", SEGMENT_NAMES)
def test_every_component_is_closed_and_faces_outwards(name: str) -> None:
    mesh = as_trimesh(by_name(name))
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert np.array_equal(np.unique(mesh.faces), np.arange(len(mesh.vertices)))
    for component in mesh.split(only_watertight=False):
        assert component.is_watertight
        assert component.euler_number == 2
        assert component.volume > 0.0


def test_as_many_triangles_as_the_papers_model() -> None:
    assert 21_000 <= sum(len(segment.faces) for segment in generic_segments()) <= 21_800


@pytest.mark.parametrize("name", SEGMENT_NAMES)
def test_triangles_are_even_and_none_is_a_sliver(name: str) -> None:
    mesh = as_trimesh(by_name(name))
    corners = mesh.vertices[mesh.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    assert (longest**2 / (2.0 * mesh.area_faces)).max() < 4.0  # longest edge over the height on it
    assert longest.max() < 0.025
    if not name.endswith("hand"):  # fingers need finer triangles than the palm
        inner_half = np.quantile(mesh.area_faces, [0.05, 0.95])
        assert inner_half[1] < 2.0 * inner_half[0]


@pytest.mark.parametrize("name", [name for name in SEGMENT_NAMES if name.startswith("left_")])
def test_right_is_the_exact_mirror_of_left(name: str) -> None:
    left, right = by_name(name), by_name(name.replace("left_", "right_"))
    assert np.array_equal(right.vertices_heights, left.vertices_heights * (1.0, -1.0, 1.0))
    assert np.array_equal(right.faces, left.faces[:, ::-1])


@pytest.mark.parametrize("name", CENTRE_SEGMENTS)
def test_segments_of_the_plane_of_symmetry_are_their_own_mirror(name: str) -> None:
    segment = by_name(name)
    mirrored = segment.vertices_heights * (1.0, -1.0, 1.0)
    distance, twin = cKDTree(segment.vertices_heights).query(mirrored)
    assert distance.max() < 1e-9
    assert {frozenset(face) for face in segment.faces} == {frozenset(face) for face in twin[segment.faces]}


def test_stands_one_body_height_tall_on_its_soles() -> None:
    z = in_body(*SEGMENT_NAMES)[:, 2]
    assert z.min() == pytest.approx(-PELVIS_HEIGHT, abs=0.001)
    assert np.ptp(z) == pytest.approx(1.0, abs=0.002)


@pytest.mark.parametrize("name", SEGMENT_NAMES)
def test_encloses_its_joint(name: str) -> None:
    assert winding_numbers(by_name(name), np.zeros((1, 3)))[0] > 0.5


@pytest.mark.parametrize(("name", "radius"), JOINT_BALLS.items())
def test_no_turn_of_a_joint_opens_a_gap(name: str, radius: float) -> None:
    """A ball about the joint stays put however it turns, so filling it from both sides shuts the joint."""
    ball = radius * np.asarray(trimesh.creation.icosphere(subdivisions=2).vertices)
    in_parent = OFFSETS_HEIGHTS[JOINT_INDEX[SEGMENT_JOINT[name]]]
    assert winding_numbers(by_name(name), ball).min() > 0.5
    assert winding_numbers(by_name(parent_segment(name)), ball + in_parent).min() > 0.5


@pytest.mark.parametrize(("what", "name", "axis", "at", "low", "high"), GIRTHS)
def test_girths_are_a_persons(what: str, name: str, axis: int, at: float, low: float, high: float) -> None:
    normal = np.eye(3)[axis]
    outline = as_trimesh(by_name(name)).section(normal, normal * at)
    assert outline is not None
    assert low < outline.length < high, what


@pytest.mark.parametrize(
    ("names", "axis", "low", "high"),
    [
        (("head",), 0, 0.110, 0.130),  # head length with the nose
        (("head",), 1, 0.085, 0.105),  # head breadth with the ears
        (("head",), 2, 0.125, 0.138),  # chin to top
        (("torso",), 0, 0.125, 0.160),  # chest depth
        (("pelvis", "left_thigh", "right_thigh"), 1, 0.185, 0.215),  # hip breadth
        (("pelvis",), 0, 0.130, 0.160),  # buttock depth
        (("left_hand",), 0, 0.050, 0.075),  # hand breadth with the thumb
        (("left_foot",), 0, 0.148, 0.156),  # foot length
        (("left_foot",), 1, 0.054, 0.062),  # foot breadth
        (("left_upper_arm", "left_forearm", "left_hand", "right_hand"), 1, 0.97, 1.08),  # span
    ],
)
def test_breadths_and_lengths_are_a_persons(
    names: tuple[str, ...], axis: int, low: float, high: float
) -> None:
    assert low < np.ptp(in_body(*names)[:, axis]) < high


def test_hand_and_heel_reach_as_far_as_they_should() -> None:
    assert by_name("left_hand").vertices_heights[:, 1].max() == pytest.approx(0.108, abs=0.001)
    foot = by_name("left_foot").vertices_heights
    assert -0.033 <= foot[:, 0].min() <= -0.029  # 49 mm in a person of 1.8 m, and the skin
    assert foot[:, 2].min() == pytest.approx(-0.040, abs=0.0005)


widths = st.floats(0.01, 0.1)
squarenesses = st.floats(2.0, 4.0)


@st.composite
def lofts(draw: st.DrawFn) -> Loft:
    """Lofts of three to six random stations, in any order of axes."""
    count = draw(st.integers(3, 6))
    stations = tuple(
        (
            0.1 * k,
            -draw(widths),
            draw(widths),
            -draw(widths),
            draw(widths),
            draw(squarenesses),
            draw(squarenesses),
        )
        for k in range(count)
    )
    axes = draw(st.permutations("xyz").map("".join))
    return Loft(
        axes, stations, 0.0, 0.1 * (count - 1), draw(st.floats(0.01, 0.1)), draw(st.floats(0.01, 0.1))
    )


@settings(max_examples=25, deadline=None)
@given(lofts(), st.floats(0.008, 0.05))
def test_any_loft_is_one_closed_surface_within_its_stations(loft: Loft, edge_heights: float) -> None:
    vertices, faces = loft_mesh(loft, edge_heights)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    assert mesh.volume > 0.0
    table = np.array(loft.stations)
    in_loft_order = vertices[:, ["xyz".index(axis) for axis in loft.axes]]
    low = [loft.start, table[:, 1].min(), table[:, 3].min()]
    high = [loft.end, table[:, 2].max(), table[:, 4].max()]
    assert np.all(in_loft_order >= np.array(low) - 1e-12)
    assert np.all(in_loft_order <= np.array(high) + 1e-12)


def test_a_finer_edge_gives_more_triangles() -> None:
    stations = tuple((z, -0.05, 0.05, -0.05, 0.05, 2.0, 2.0) for z in (0.0, 0.1, 0.2))
    loft = Loft("zyx", stations, 0.0, 0.2, 0.05, 0.05)
    counts = [len(loft_mesh(loft, edge)[1]) for edge in (0.02, 0.01, 0.005)]
    assert all(3.0 < finer / coarser < 5.0 for coarser, finer in pairwise(counts))
