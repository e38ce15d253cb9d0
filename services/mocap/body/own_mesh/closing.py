"""Closes surfaces: afterwards every edge has exactly two consistently oriented faces.

Where more than two faces meet in an edge, or two with different orientation, the surface is split; a single
face becomes a sheet with two sides. Holes get flat covers, which is enough for silhouettes; the cut to a
neighbouring limb gets a dome, so that a bent joint shows no gap.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from services.mocap.body.own_mesh.character import Piece
from services.mocap.body.surface import is_closed
from services.mocap.types import Floats, Ints, Longs, Mask

_DOME_RINGS = 3
_ROUNDS = 8


@dataclass(frozen=True, eq=False)
class _HalfEdges:
    """The directed edges of faces: number 3 f + k goes from corner k of face f to the next."""

    start: Longs
    end: Longs
    twins: Longs
    """(P, 2) pairs of opposite edges between two vertices without further edges."""
    open: Longs
    """The others."""
    crowded: Longs
    """Those of them that another one runs along."""

    @classmethod
    def of(cls, faces: Ints) -> "_HalfEdges":
        """All of some faces."""
        start, end = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel().astype(np.int64)
        along, back = start << 32 | end, end << 32 | start
        _, place, counts = np.unique(along, return_inverse=True, return_counts=True)
        single = counts[place.reshape(-1)] == 1
        order = np.argsort(along)
        found = np.minimum(np.searchsorted(along, back, sorter=order), len(order) - 1)
        other = order[found]
        paired = (along[other] == back) & single & single[other]
        first = np.flatnonzero(paired & (start < end))
        return cls(
            start,
            end,
            np.column_stack([first, other[first]]),
            np.flatnonzero(~paired),
            np.flatnonzero(~single),
        )


def closed(piece: Piece, domed: bool) -> Piece:
    """The same surface, closed and oriented outwards; vertices without a face are removed.

    domed: whether cuts get domes; otherwise they get flat covers too.
    """
    faces, origin = _split_where_tangled(_consistently_wound(piece), len(piece.vertices))
    vertices, cut = piece.vertices[origin], piece.cut[origin]
    new_vertices, new_faces, n_vertices = [vertices], [faces], len(vertices)
    for loop in _loops(_HalfEdges.of(faces)):
        rings = _DOME_RINGS if domed and cut[loop].mean() > 0.5 else 0
        cap_vertices, cap_faces = _cap(vertices[loop], loop, n_vertices, rings)
        new_vertices.append(cap_vertices)
        new_faces.append(cap_faces)
        n_vertices += len(cap_vertices)
    vertices, faces = np.concatenate(new_vertices), np.concatenate(new_faces).astype(np.int32)
    if not is_closed(faces):
        raise AssertionError("a surface that was closed is open")
    return Piece(vertices, _oriented_outwards(vertices, faces), np.zeros(len(vertices), bool))


def _consistently_wound(piece: Piece) -> Ints:
    """The faces without duplicates, flipped where they are wound against their neighbours."""
    _, first = np.unique(np.sort(piece.faces, axis=1), axis=0, return_index=True)
    faces = piece.faces[np.sort(first)]
    start, end = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    edges = np.minimum(start, end) << 32 | np.maximum(start, end)
    order = np.argsort(edges, kind="stable")
    _, at, counts = np.unique(edges[order], return_index=True, return_counts=True)
    one, other = order[at[counts == 2]], order[at[counts == 2] + 1]
    alike = start[one] != start[other]
    # Every face stands for two, one turned round; of neighbours those are linked that are wound alike.
    n, f, g = len(faces), one // 3, other // 3
    links = np.column_stack([np.concatenate([f, f + n]), np.concatenate([g + n * ~alike, g + n * alike])])
    _, label = connected_components(
        coo_array((np.ones(len(links)), links.T), shape=(2 * n, 2 * n)), directed=False
    )
    return np.where((label[:n] > label[n:])[:, None], faces[:, ::-1], faces)


def _split_where_tangled(faces: Ints, n_vertices: int) -> tuple[Ints, Longs]:
    """Faces whose vertices are duplicated until the surface around each is a disc or half a disc.

    Returns the faces, and which original vertex each vertex was.
    """
    origin: Longs = np.arange(n_vertices)
    alone = np.zeros(len(faces), bool)
    for round_ in range(_ROUNDS):
        edges = _HalfEdges.of(faces)
        if round_ >= _ROUNDS // 2:  # what is still tangled will not be split by more rounds
            alone[edges.crowded // 3] = True
        kept = edges.twins[~alone[edges.twins // 3].any(axis=1)]
        one, other = kept[:, 0], kept[:, 1]
        corners = np.concatenate([np.column_stack([one, _next(other)]), np.column_stack([_next(one), other])])
        links = coo_array((np.ones(len(corners)), corners.T), shape=(faces.size, faces.size))
        n, label = connected_components(links, directed=False)
        moved_from = np.zeros(n, np.int64)
        moved_from[label] = faces.ravel()
        before, faces, origin = faces, label.reshape(-1, 3).astype(np.int32), origin[moved_from]
        if len(edges.crowded) == 0 and n == before.max(initial=-1) + 1 and round_ > 0:
            break
    return faces, origin


def _next(half_edge: Longs) -> Longs:
    """The corner at the end of half-edges, which is where the next ones of their faces begin."""
    return half_edge // 3 * 3 + (half_edge + 1) % 3


def _loops(edges: _HalfEdges) -> list[Longs]:
    """The borders of a surface, each as its vertices in the order in which its faces run along it."""
    following = dict(zip(edges.start[edges.open].tolist(), edges.end[edges.open].tolist(), strict=True))
    loops = []
    while following:
        first, vertex = following.popitem()
        loop = [first]
        while vertex != first:
            loop.append(vertex)
            vertex = following.pop(vertex)
        loops.append(np.array(loop))
    return loops


def _cap(ring: Floats, loop: Longs, first: int, n_rings: int) -> tuple[Floats, Ints]:
    """Vertices, numbered from first on, and faces over a border ring (n, 3): flat, or a dome of rings."""
    n, middle = len(ring), ring.mean(axis=0)
    # Seen from outside the cap the border runs the other way round.
    area = 0.5 * np.cross(ring - middle, np.roll(ring, -1, axis=0) - middle).sum(axis=0)
    size = float(np.linalg.norm(area))
    outward = -area / size if size > 0.0 else np.zeros(3)
    height = np.sqrt(size / np.pi) if n_rings else 0.0
    angles = np.arange(1, n_rings + 1) / (n_rings + 1) * np.pi / 2
    rings = [middle + np.cos(t) * (ring - middle) + np.sin(t) * height * outward for t in angles]
    rows = np.vstack([loop, first + np.arange(n_rings * n).reshape(n_rings, n)])
    faces = []
    for outer, inner in pairwise(rows):
        outer_next, inner_next = np.roll(outer, -1), np.roll(inner, -1)
        faces += [
            np.column_stack([outer_next, outer, inner]),
            np.column_stack([outer_next, inner, inner_next]),
        ]
    tip = np.full(n, first + n_rings * n)
    faces.append(np.column_stack([np.roll(rows[-1], -1), rows[-1], tip]))
    return np.vstack([*rings, middle + height * outward]), np.concatenate(faces)


def _oriented_outwards(vertices: Floats, faces: Ints) -> Ints:
    """Faces of closed surfaces, flipped where a surface is inside out."""
    links = coo_array((np.ones(len(faces) * 2), (faces[:, [0, 0]].ravel(), faces[:, [1, 2]].ravel())),
                      shape=(len(vertices), len(vertices)))  # fmt: skip
    n, label = connected_components(links, directed=False)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    part = label[faces[:, 0]]
    middle = np.stack([np.bincount(part, a[:, k], n) / np.maximum(np.bincount(part, minlength=n), 1)
                       for k in range(3)], axis=1)[part]  # fmt: skip
    volumes = np.bincount(part, np.einsum("fi,fi->f", a - middle, np.cross(b - middle, c - middle)), n)
    inside_out: Mask = volumes[part] < 0.0
    return np.where(inside_out[:, None], faces[:, ::-1], faces)
