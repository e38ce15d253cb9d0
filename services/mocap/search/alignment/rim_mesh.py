"""A body's edges as flat arrays: the candidates for the rim of its silhouette."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.surface import Level, closed_edges
from services.mocap.energy.cpu.arrays import Singles
from services.mocap.types import Floats, Ints


class RimMesh(NamedTuple):
    """Every segment's edges, concatenated, in the segment's frame."""

    planes: Singles
    """(8, E): normal and offset (n, d) of the faces on both sides; n . x > d in front of a face."""
    middles_m: Floats
    """(3, E)"""
    halves_m: Floats
    """(3, E) from the middle to an end."""
    outward: Floats
    """(3, E) the sum of both faces' unit normals."""
    starts: Ints
    """(segments + 1,) where each segment's edges begin, and their number."""

    @classmethod
    def of(cls, body: Body, thinned: Sequence[Sequence[Level]] = (), most_m: float = 0.0) -> "RimMesh":
        """The edges of a body, from each segment's coarsest thinned mesh with an error of at most most_m, or
        its full mesh."""
        ladders = thinned or [()] * len(body.surfaces)
        levels = [_coarsest(body, s, ladder, most_m) for s, ladder in enumerate(ladders)]
        pieces = [_edges(level) for level in levels]
        starts = np.cumsum([0] + [len(piece[0]) for piece in pieces])
        arrays = (np.ascontiguousarray(np.concatenate(column).T) for column in zip(*pieces, strict=True))
        planes, middles_m, halves_m, outward = arrays
        return cls(planes.astype(np.float32), middles_m, halves_m, outward, starts.astype(np.int32))


def _coarsest(body: Body, surface: int, ladder: Sequence[Level], most_m: float) -> Level:
    full = Level(*body.surfaces[surface], 0.0)
    return max([full, *(lv for lv in ladder if lv.error_m <= most_m)], key=lambda level: level.error_m)


def _edges(level: Level) -> tuple[Floats, Floats, Floats, Floats]:
    """(E, 8) planes, (E, 3) middles, halves and outward directions of one segment."""
    edges, sides = closed_edges(level.faces)
    a, b, c = (level.vertices_m[corner] for corner in level.faces.T)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    planes = np.column_stack([normals, np.sum(normals * a, axis=1)])[sides].reshape(-1, 8)
    ends = level.vertices_m[edges[:, :2]]
    return planes, ends.mean(axis=1), (ends[:, 1] - ends[:, 0]) / 2, normals[sides].sum(axis=1)
