"""One closed skin for a body whose segments overlap, with weights that blend at the joints.

The segments are united in a bind pose with limbs apart. Each vertex moves with the segment that it comes
from. About the seam of two neighbouring segments it moves with both: half with each at the seam, and less
with the other one the farther away it is. Posed by linear blending, the skin differs from the segments only
there. The cone of a skirt is a piece of its own that moves with the pelvis.
"""

from dataclasses import dataclass

import manifold3d
import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from services.mocap.body.actor import Body
from services.mocap.body.bones import smoothstep
from services.mocap.body.kinematics import segment_transforms
from services.mocap.body.skeleton import (
    DOF_INDEX,
    JOINT_INDEX,
    SEGMENT_INDEX,
    SEGMENT_PARENTS,
    SEGMENTS,
    SIDES,
)
from services.mocap.body.surface import moved
from services.mocap.motion.motion import rest_pose
from services.mocap.types import Floats, Ints, Mask

_LEGS_APART_RAD = 0.2
_BLEND_M = 0.06
"""How far from a seam a vertex moves with both segments."""
_INSET_PER_M, _MOST_INSET_M = 0.2, 0.004
"""Where one segment continues another, both have the same surface about the joint. Beyond the joint each is
drawn in a little, so that the seam is one line and not a ragged band."""
_CLOTH = len(SEGMENTS)
"""The number of the cloth's vertices."""
_NEIGHBOURS = [(SEGMENT_INDEX[parent], SEGMENT_INDEX[s]) for s, parent in SEGMENT_PARENTS.items() if parent]
"""Segments that a joint connects, the parent first."""
_CONTINUED = [(p, c) for p, c in _NEIGHBOURS if SEGMENTS[p].row.continued_by == SEGMENTS[c].row.name]
"""Those of which the second one's surface continues the first one's."""


@dataclass(frozen=True, eq=False)
class Skin:
    """A closed surface, and how it moves with the segments."""

    vertices_m: Floats
    """(V, 3) in the bind pose, in the world's axes."""
    faces: Ints
    """(F, 3)"""
    face_segments: Ints
    """(F,) the segment that each triangle comes from."""
    weights: Floats
    """(V, S) how much each vertex moves with each segment; rows sum to one."""
    pose: Floats
    """(D,) the bind pose."""


def bind_pose(body: Body) -> Floats:
    """The pose (D,) in which a skin is made: on the floor, legs apart, arms half way down."""
    pose = rest_pose("A")
    for side in SIDES:
        pose[DOF_INDEX[f"{side}_hip_abduction"]] = _LEGS_APART_RAD
    pose[DOF_INDEX["root_z"]] = -body.lowest_point_m(pose)
    return pose


def skin_of(body: Body) -> Skin:
    """The skin of a body; in several pieces if it wears a skirt or the segments do not all hang together."""
    pose = bind_pose(body)
    T_world_segment = segment_transforms(pose[None], body.offsets_m)[0]
    pieces = [
        piece
        for s, (vertices_m, faces) in enumerate(zip(body.vertices_m, body.faces, strict=True))
        for piece in _solids(_drawn_in(s, vertices_m, faces, body), faces, T_world_segment[s], s)
    ]
    united = manifold3d.Manifold.batch_boolean(pieces, manifold3d.OpType.Add)
    shown = [surface for surface in united.decompose() if surface.volume() > 0.0]  # without hollows
    pelvis, cone_m = SEGMENT_INDEX["pelvis"], body.cloth_m[0]
    if len(cone_m):
        shown += _solids(cone_m, body.mesh.cloth[0].faces, T_world_segment[pelvis], _CLOTH)
    meshes = [surface.to_mesh() for surface in shown]
    firsts = np.cumsum([0, *(len(mesh.vert_properties) for mesh in meshes[:-1])])
    rows = np.concatenate([mesh.vert_properties for mesh in meshes]).astype(np.float64)
    faces = np.concatenate([mesh.tri_verts + k for mesh, k in zip(meshes, firsts, strict=True)])
    segments = np.rint(rows[:, 3]).astype(np.int32)
    # Along a seam there is a vertex for either side, in the same place.
    twins = [np.array([mesh.merge_from_vert, mesh.merge_to_vert]) for mesh in meshes]
    pairs = np.concatenate([pair + k for pair, k in zip(twins, firsts, strict=True)], axis=1)
    joined = coo_array((np.ones(len(pairs[0])), tuple(pairs)), shape=(len(rows), len(rows)))
    n_places, places = connected_components(joined, directed=False)  # (rows,) int32
    vertices_m: Floats = np.empty((n_places, 3))
    vertices_m[places] = rows[:, :3]
    comes_from = np.zeros((n_places, len(SEGMENTS) + 1), bool)
    comes_from[places, segments] = True
    weights = _weights(vertices_m, comes_from)
    weights[:, pelvis] += weights[:, _CLOTH]
    face_segments = np.where(segments == _CLOTH, pelvis, segments)[faces[:, 0]]
    return Skin(vertices_m, places[faces], face_segments, weights[:, :_CLOTH], pose)


def _solids(
    vertices_m: Floats, faces: Ints, T_world_segment: Floats, segment: int
) -> list[manifold3d.Manifold]:
    """The closed pieces of a segment's mesh, such as fingers, in the bind pose.

    Each vertex has its segment's number after its place.
    """
    world_m = moved(vertices_m, T_world_segment)
    rows = np.column_stack([world_m, np.full(len(world_m), segment)]).astype(np.float32)
    solid = manifold3d.Manifold(manifold3d.Mesh(rows, faces.astype(np.uint32)))
    return list(solid.decompose())


def _drawn_in(segment: int, vertices_m: Floats, faces: Ints, body: Body) -> Floats:
    """(V, 3) a segment's vertices, drawn in beyond the joints at which it continues another segment or
    another one continues it."""
    beyond_m = np.zeros(len(vertices_m))
    for parent, child in _CONTINUED:
        joint_m = body.offsets_m[JOINT_INDEX[SEGMENTS[child].joint]]
        along = joint_m / np.linalg.norm(joint_m)
        if segment == parent:
            beyond_m = np.maximum(beyond_m, (vertices_m - joint_m) @ along)
        elif segment == child:
            beyond_m = np.maximum(beyond_m, vertices_m @ -along)
    if not beyond_m.any():
        return vertices_m
    inset_m = np.minimum(_INSET_PER_M * beyond_m, _MOST_INSET_M)
    normals: Floats = trimesh.Trimesh(vertices_m, faces, process=False).vertex_normals
    return np.asarray(vertices_m - inset_m[:, None] * normals)


def _weights(vertices_m: Floats, comes_from: Mask) -> Floats:
    """(V, S + 1) of vertices (V, 3) that come from segments or cloth (V, S + 1); from several at a seam."""
    weights = comes_from.astype(np.float64)
    for pair in _NEIGHBOURS:
        at_seam = comes_from[:, pair].all(axis=1)
        if not at_seam.any():
            continue
        to_seam = cKDTree(vertices_m[at_seam])
        for own, other in (pair, pair[::-1]):
            rows = np.flatnonzero(comes_from[:, own])
            near = smoothstep(1.0 - to_seam.query(vertices_m[rows])[0] / _BLEND_M)
            weights[rows, other] = np.maximum(weights[rows, other], near)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
