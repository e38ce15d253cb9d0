"""A body's meshes as flat arrays: what the outline is found with and what it walks along."""

from collections.abc import Sequence
from itertools import accumulate
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from services.mocap.body.actor import Body
from services.mocap.energy.cpu.arrays import Indices, Singles
from services.mocap.types import Floats, Ints

BLOCK = 16
"""Edges a block; as many planes are looked at at once."""
_SHORTEST_NORMAL = 1e-12  # of faces without area: their block is always looked into
_SHORTEST_SIDE_M = 1e-12  # of faces that are a point
_NO_OFFSET = 1e9  # of the planes of edges that fill a block up: every camera is on the same side of both

_Number = TypeVar("_Number", np.float32, np.int64)


class FlatMesh(NamedTuple):
    """All segments one behind the other; edges in B blocks, each of neighbours that face the same way."""

    xyz_m: Floats
    """(3, V) vertices in their segment's frame."""
    edges: Indices
    """(B * BLOCK, 4) vertices a, b, c, d of the faces (a, b, c) and (b, a, d), counter-clockwise seen from
    outside, on the two sides of an edge. One that only fills a block up has the same vertex four times."""
    planes: Singles
    """(B, 8, BLOCK): normal and offset (n, d) of the face along and then of the one against, such that
    n · x - d is twice the area times the height of x over the face, divided by its longest side; x counts
    from the centre of the segment's sphere."""
    block_planes: Singles
    """(9, B): the middle (n, d) of a block's planes once all n are of unit length, how far off it any
    component is, and by how much the planes have been lengthened for that at most."""
    starts: Ints
    """(2, S + 1) where each segment's vertices and its blocks begin."""
    spheres_m: Floats
    """(S, 4) centre, in the segment's frame, and radius of a sphere that holds the segment."""

    @classmethod
    def of(cls, body: Body) -> "FlatMesh":
        """Flatten a body; raises ValueError where a segment's mesh is not closed."""
        spheres_m = np.array([_sphere(vertices) for vertices in body.vertices_m])
        edges, planes, bounds, n_vertices = [], [], [], 0
        for vertices, faces, sphere in zip(body.vertices_m, body.faces, spheres_m, strict=True):
            segment_edges, sides = closed_edges(faces)
            segment_planes = _planes(vertices - sphere[:3], faces)[sides]
            order = _in_blocks(segment_planes[:, 0, :3] + segment_planes[:, 1, :3])
            edges.append(_filled(segment_edges[order] + n_vertices, np.full(4, n_vertices)))
            planes.append(
                _filled(segment_planes[order].reshape(-1, 8), np.array([0.0, 0, 0, _NO_OFFSET] * 2))
            )
            bounds.append(_bounds(segment_planes[order]))
            n_vertices += len(vertices)
        return cls(
            xyz_m=np.ascontiguousarray(np.concatenate(body.vertices_m).T, np.float64),
            edges=np.concatenate(edges).reshape(-1, 4).astype(np.uint32),
            planes=np.ascontiguousarray(np.concatenate(planes).transpose(0, 2, 1)),
            block_planes=np.ascontiguousarray(np.concatenate(bounds).T),
            starts=np.array([_starts(body.vertices_m), _starts(bounds)], np.int32),
            spheres_m=spheres_m,
        )


def _starts(parts: Sequence[NDArray[Any]]) -> list[int]:
    return [0, *accumulate(map(len, parts))]


def _sphere(vertices_m: Floats) -> Floats:
    """Centre and radius (4,) of a sphere about the middle of the bounding box."""
    centre = (vertices_m.min(axis=0) + vertices_m.max(axis=0)) / 2
    return np.append(centre, np.linalg.norm(vertices_m - centre, axis=1).max() * (1.0 + 1e-9))


def _planes(vertices_m: Floats, faces: Ints) -> Singles:
    """The (F, 4) planes of one segment's faces."""
    corners = vertices_m[faces]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    longest_m = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    normals = np.cross(b - a, c - a) / np.maximum(longest_m, _SHORTEST_SIDE_M)[:, None]
    return np.column_stack([normals, np.sum(normals * a, axis=1)]).astype(np.float32)


def closed_edges(faces: Ints) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The edges (E, 4) of one closed segment and the faces (E, 2) on their sides."""
    start, end, opposite = (np.roll(faces, -k, axis=1).ravel().astype(np.int64) for k in range(3))
    owner = np.arange(len(faces)).repeat(3)
    forward = start < end
    key = np.minimum(start, end) << 32 | np.maximum(start, end)
    along, against = np.flatnonzero(forward), np.flatnonzero(~forward)
    along, against = along[np.argsort(key[along])], against[np.argsort(key[against])]
    if not np.array_equal(key[along], key[against]) or len(np.unique(key)) != len(along):
        raise ValueError("a segment's mesh is not closed: every edge needs exactly two faces, wound alike")
    edges = np.stack([start[along], end[along], opposite[along], opposite[against]], axis=1)
    return edges, np.stack([owner[along], owner[against]], axis=1)


def _in_blocks(directions: Singles) -> NDArray[np.int64]:
    """An order (E,) of edges that puts those of like direction (E, 3) into the same block."""
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    return _split(directions / np.maximum(lengths, _SHORTEST_NORMAL), np.arange(len(directions)))


def _split(directions: Singles, members: NDArray[np.int64]) -> NDArray[np.int64]:
    """Order members by halving them across their widest spread until they fit into a block."""
    if len(members) <= BLOCK:
        return members
    mine = directions[members]
    members = members[np.argsort(mine[:, np.ptp(mine, axis=0).argmax()], kind="stable")]
    n_blocks = -(-len(members) // BLOCK)
    half = n_blocks // 2 * BLOCK
    return np.concatenate([_split(directions, members[:half]), _split(directions, members[half:])])


def _filled(rows: NDArray[_Number], filler: NDArray[Any]) -> NDArray[_Number]:
    """Rows (E, k) as blocks (B, BLOCK, k), the last one filled up."""
    n_blocks = -(-len(rows) // BLOCK)
    blocks = np.empty((n_blocks * BLOCK, rows.shape[1]), rows.dtype)
    blocks[: len(rows)], blocks[len(rows) :] = rows, filler
    return blocks.reshape(n_blocks, BLOCK, -1)


def _bounds(planes: Singles) -> Singles:
    """The block_planes (B, 9) of one segment's planes (E, 2, 4) in their final order."""
    singles = _filled(planes.reshape(-1, 8), planes[-1].ravel())
    filled = singles.reshape(-1, 2 * BLOCK, 4).astype(np.float64)
    lengthening = 1.0 / np.maximum(np.linalg.norm(filled[..., :3], axis=2), _SHORTEST_NORMAL)
    filled *= lengthening[..., None]
    low, high = filled.min(axis=1), filled.max(axis=1)
    return np.column_stack([(low + high) / 2, (high - low) / 2, lengthening.max(axis=1)]).astype(np.float32)
