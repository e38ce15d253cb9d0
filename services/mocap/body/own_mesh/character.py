"""What any file is made into first: pieces of surface about named joints, in the file's own frame."""

from dataclasses import dataclass

import numpy as np

from services.mocap.body.skeleton import SEGMENTS
from services.mocap.types import Floats, Ints, Mask

_NEAREST_END = 0.02
"""A cut keeps this share of an edge away from its ends, which avoids slivers."""


@dataclass(frozen=True, eq=False)
class Piece:
    """The surface of one segment, which may be open."""

    vertices: Floats
    """(V, 3)"""
    faces: Ints
    """(F, 3) counter-clockwise seen from outside."""
    cut: Mask
    """(V,) whether a vertex is at a cut to a neighbour."""


@dataclass(frozen=True, eq=False)
class Character:
    """A body in a file's coordinates: any unit, any axes, any pose between A and T."""

    joints: dict[str, Floats]
    """Positions (3,) of our joints except pelvis, waist and head_top, which follow from the others."""
    pieces: dict[str, Piece]
    """By segment."""


NEEDED_JOINTS = tuple(segment.joint for segment in SEGMENTS if segment.part != "torso")


def welded(vertices: Floats, faces: Ints) -> tuple[Floats, Ints, Ints]:
    """Merge vertices (V, 3) at equal positions: returns the vertices, the faces, and each vertex's original.

    Files hold a vertex several times where their texture has a seam. Faces without area are left out.
    """
    step = max(float(np.ptp(vertices, axis=0).max()), 1e-12) * 1e-6
    _, first, place = np.unique(np.rint(vertices / step), axis=0, return_index=True, return_inverse=True)
    joined = place.reshape(-1)[faces]
    whole = np.all(joined != np.roll(joined, 1, axis=1), axis=1)
    return vertices[first], joined[whole].astype(np.int32), first.astype(np.int32)


def cut_where(vertices: Floats, faces: Ints, field: Floats) -> Piece:
    """The part of a surface where a field (V,), linear on each triangle, is not negative."""
    inside = field >= 0.0
    n_inside = inside[faces].sum(axis=1)
    one = _turned(faces[n_inside == 1], inside)
    two = _turned(faces[n_inside == 2], ~inside)
    edges = np.concatenate([one[:, [0, 1]], one[:, [0, 2]], two[:, [0, 1]], two[:, [0, 2]]]).astype(np.int64)
    low, high = edges.min(axis=1), edges.max(axis=1)
    keys, place = np.unique(low * len(vertices) + high, return_inverse=True)
    a, b = keys // len(vertices), keys % len(vertices)
    share = np.clip(field[a] / (field[a] - field[b]), _NEAREST_END, 1.0 - _NEAREST_END)[:, None]
    crossings = vertices[a] + share * (vertices[b] - vertices[a])
    n, m = len(one), len(two)
    on_edge = place.reshape(-1) + len(vertices)
    ab, ac, cd, ce = np.split(on_edge, [n, 2 * n, 2 * n + m])
    kept = np.concatenate(
        [
            faces[n_inside == 3],
            np.column_stack([one[:, 0], ab, ac]),
            np.column_stack([cd, two[:, 1], two[:, 2]]),
            np.column_stack([cd, two[:, 2], ce]),
        ]
    )
    used, compact = np.unique(kept, return_inverse=True)
    return Piece(
        np.concatenate([vertices, crossings])[used],
        compact.reshape(-1, 3).astype(np.int32),
        used >= len(vertices),
    )


def _turned(faces: Ints, chosen: Mask) -> Ints:
    """Faces (F, 3), one corner of each chosen, turned so that it comes first."""
    first = chosen[faces].argmax(axis=1)
    return np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
