"""A body's meshes as flat arrays: what the outline is found with and what it walks along."""

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from services.mocap.body.actor import Body
from services.mocap.types import Floats, Ints

Indices: TypeAlias = NDArray[np.uint32]
"""Unsigned, so that compiled code does not test every index for being counted from the end."""
SMALL_PERIMETER_M = 1e-3
"""Added to a face's perimeter, which its plane is divided by: keeps planes of tiny faces finite."""


class FlatMesh(NamedTuple):
    """All segments one behind the other; `*_start` (S + 1,) holds where each segment's part begins."""

    xyz_m: Floats
    """(V, 3) vertices in their segment's frame."""
    faces: Indices
    """(F, 3) vertex indices, counter-clockwise seen from outside."""
    edges: Indices
    """(E, 4): two vertices, the face that runs along them in that order, the face that runs against it."""
    planes: NDArray[np.float32]
    """(8, E): for the face along and then for the one against, normal and offset (n, d) such that n · x - d
    is twice the area times the height of x over the face, divided by its perimeter and SMALL_PERIMETER_M;
    x counts from the centre of the segment's sphere."""
    spheres_m: Floats
    """(S, 4) centre, in the segment's frame, and radius of a sphere that holds the segment."""
    face_start: Indices
    edge_start: Indices

    @classmethod
    def of(cls, body: Body) -> "FlatMesh":
        """Flatten a body; raises ValueError where a segment's mesh is not closed."""
        vertex_start = _starts([len(v) for v in body.vertices_m])
        face_start = _starts([len(f) for f in body.faces])
        faces = [f + start for f, start in zip(body.faces, vertex_start[:-1], strict=True)]
        edges = [_edges(f, int(start)) for f, start in zip(faces, face_start[:-1], strict=True)]
        spheres_m = np.array([_sphere(vertices) for vertices in body.vertices_m])
        planes = np.concatenate(
            [_planes(v - s[:3], f) for v, f, s in zip(body.vertices_m, body.faces, spheres_m, strict=True)]
        )
        all_edges = np.concatenate(edges).astype(np.uint32)
        return cls(
            xyz_m=np.concatenate(body.vertices_m).astype(np.float64),
            faces=np.concatenate(faces).astype(np.uint32),
            edges=all_edges,
            planes=np.ascontiguousarray(np.hstack([planes[all_edges[:, 2]], planes[all_edges[:, 3]]]).T),
            spheres_m=spheres_m,
            face_start=face_start.astype(np.uint32),
            edge_start=_starts([len(e) for e in edges]).astype(np.uint32),
        )


def _starts(counts: list[int]) -> Ints:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)


def _sphere(vertices_m: Floats) -> Floats:
    """Centre and radius (4,) of a sphere about the middle of the bounding box."""
    centre = (vertices_m.min(axis=0) + vertices_m.max(axis=0)) / 2
    return np.append(centre, np.linalg.norm(vertices_m - centre, axis=1).max())


def _planes(vertices_m: Floats, faces: Ints) -> NDArray[np.float32]:
    """The (F, 4) planes of one segment's faces."""
    corners = vertices_m[faces]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    perimeters_m = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).sum(axis=1)
    normals = np.cross(b - a, c - a) / (perimeters_m + SMALL_PERIMETER_M)[:, None]
    return np.column_stack([normals, np.sum(normals * a, axis=1)]).astype(np.float32)


def _edges(faces: Ints, first_face: int) -> Ints:
    """The (E, 4) edges of one closed segment, whose faces are numbered from first_face."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    owner = first_face + np.arange(len(faces)).repeat(3)
    forward = start < end
    key = np.minimum(start, end).astype(np.int64) << 32 | np.maximum(start, end)
    along, against = np.flatnonzero(forward), np.flatnonzero(~forward)
    along, against = along[np.argsort(key[along])], against[np.argsort(key[against])]
    if not np.array_equal(key[along], key[against]) or len(np.unique(key)) != len(along):
        raise ValueError("a segment's mesh is not closed: every edge needs exactly two faces, wound alike")
    return np.stack([start[along], end[along], owner[along], owner[against]], axis=1)
