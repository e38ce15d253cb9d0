"""Surfaces of triangles: a segment's closed mesh, as it is or thinned; meshes moved, and several as one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from services.mocap.types import Floats, Ints, Longs

MIRROR: Floats = np.array([1.0, -1.0, 1.0])
"""Takes places to the other side of the body."""
FEWEST_FACES = 4
"""A closed mesh has at least this many faces."""


@dataclass(frozen=True, eq=False)
class Level:
    """A closed mesh of a segment: the full one, or one with fewer faces."""

    vertices_m: Floats
    """(V, 3)"""
    faces: Ints
    """(F, 3) counter-clockwise seen from outside."""
    error_m: float
    """Largest distance of a point of its surface or of the segment's from the other surface."""


def moved(vertices: Floats, T: Floats) -> Floats:
    """Vertices (V, 3) where a transform (4, 4) takes them."""
    return vertices @ T[:3, :3].T + T[:3, 3]


def as_one(meshes: Sequence[tuple[Floats, Ints]]) -> tuple[Floats, Ints]:
    """Vertices (V, 3) and faces (F, 3) of several meshes as those of one."""
    vertices, faces = zip(*meshes, strict=True)
    starts = np.cumsum([0, *map(len, vertices[:-1])], dtype=np.int32)
    return np.concatenate(vertices), np.concatenate([f + s for f, s in zip(faces, starts, strict=True)])


def closed_edges(faces: Ints) -> tuple[Longs, Longs]:
    """The edges (E, 4) of one closed segment and the faces (E, 2) on their sides."""
    start, end, opposite = (np.roll(faces, -k, axis=1).ravel().astype(np.int64) for k in range(3))
    owner = np.arange(len(faces)).repeat(3)
    forward = start < end
    key = np.minimum(start, end) << 32 | np.maximum(start, end)
    along, against = np.flatnonzero(forward), np.flatnonzero(~forward)
    along, against = along[np.argsort(key[along])], against[np.argsort(key[against])]
    if not np.array_equal(key[along], key[against]) or len(np.unique(key)) != len(along):
        raise ValueError(
            "a segment's mesh is not closed: every edge needs exactly two consistently oriented faces"
        )
    edges = np.stack([start[along], end[along], opposite[along], opposite[against]], axis=1)
    return edges, np.stack([owner[along], owner[against]], axis=1)


def is_closed(faces: Ints) -> bool:
    """Whether every edge has exactly two consistently oriented faces."""
    try:
        closed_edges(faces)
    except ValueError:
        return False
    return len(faces) >= FEWEST_FACES


def volume_m3(vertices_m: Floats, faces: Ints) -> float:
    """What a closed mesh encloses; vertices (V, 3), faces (F, 3). Negative if it is inside out."""
    a, b, c = vertices_m[faces].transpose(1, 0, 2)
    return float(np.sum(a * np.cross(b, c)) / 6.0)
