"""A body's meshes as flat arrays: what the outline is found with and what it walks along."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import accumulate
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_RIGID
from services.mocap.body.surface import Level, closed_edges
from services.mocap.types import Floats, Indices, Ints, Longs, Singles

BLOCK = 32
"""Edges a block; as many planes are looked at at once."""
_SHORTEST_NORMAL = 1e-12  # of faces without area: their block is always looked into
_SHORTEST_SIDE_M = 1e-12  # of faces that are a point
_NO_OFFSET = 1e9  # of the planes of edges that fill a block up: every camera is on the same side of both

_Number = TypeVar("_Number", np.float32, np.int64)


class FlatMesh(NamedTuple):
    """Every segment's levels of detail one behind the other; edges in B blocks that face the same way.

    Level l of segment s is part l S + s; level 0 is the segment as it is.
    """

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
    """(2, L S + 1) where each part's vertices and its blocks begin."""
    spheres_m: Floats
    """(S, 4) centre, in the segment's frame, and radius of a sphere that holds the segment."""
    errors_m: Floats
    """(L, S) how far a level's surface is off level 0's at most; infinite where there is no such level."""

    @classmethod
    def of(cls, body: Body, thinned: Sequence[Sequence[Level]] = ()) -> "FlatMesh":
        """Flatten a body and each segment's thinned levels, fine to coarse.

        Raises ValueError where a mesh is not closed.
        """
        ladders = [
            [Level(vertices_m, faces, 0.0), *coarser]
            for (vertices_m, faces), coarser in zip(
                body.surfaces, thinned or [()] * len(body.surfaces), strict=True
            )
        ]
        spheres_m = spheres_of([np.concatenate([level.vertices_m for level in ladder]) for ladder in ladders])
        n_levels = max(map(len, ladders))
        levels = [
            [ladder[k] if k < len(ladder) else _NO_LEVEL for ladder in ladders] for k in range(n_levels)
        ]
        parts = [level for row in levels for level in row]
        first_vertices = _starts([level.vertices_m for level in parts])
        pieces = [
            _blocks(level, spheres_m[k % len(ladders)], first_vertices[k]) for k, level in enumerate(parts)
        ]
        edges, planes, bounds = zip(*pieces, strict=True)
        return cls(
            xyz_m=np.ascontiguousarray(np.concatenate([level.vertices_m for level in parts]).T, np.float64),
            edges=np.concatenate(edges).reshape(-1, 4).astype(np.uint32),
            planes=np.ascontiguousarray(np.concatenate(planes).transpose(0, 2, 1), np.float32),
            block_planes=np.ascontiguousarray(np.concatenate(bounds).T, np.float32),
            starts=np.array([first_vertices, _starts(bounds)], np.int32),
            spheres_m=spheres_m,
            errors_m=np.array([[level.error_m for level in row] for row in levels]),
        )


_NO_LEVEL = Level(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.inf)


def _blocks(level: Level, sphere_m: Floats, first_vertex: int) -> tuple[NDArray[Any], ...]:
    """One part's edges (B, BLOCK, 4), planes (B, BLOCK, 8) and block_planes (B, 9)."""
    if not len(level.faces):
        return tuple(np.zeros(shape) for shape in ((0, BLOCK, 4), (0, BLOCK, 8), (0, 9)))
    from_centre_m = level.vertices_m - sphere_m[:3]
    edges, planes, bounds = _own_blocks(from_centre_m.tobytes(), level.faces.tobytes(), level.faces.dtype)
    return edges + first_vertex, planes, bounds


@lru_cache(maxsize=128)  # bodies that only differ in a skirt or a hat share most parts
def _own_blocks(vertices_m: bytes, faces: bytes, dtype: np.dtype[Any]) -> tuple[NDArray[Any], ...]:
    """The same of a part's vertices (V, 3), float64, and faces (F, 3), with the part's own vertex numbers."""
    own_faces = np.frombuffer(faces, dtype).reshape(-1, 3)
    edges, sides = closed_edges(own_faces)
    planes = _planes(np.frombuffer(vertices_m).reshape(-1, 3), own_faces)[sides]
    directions = planes[:, 0, :3] + planes[:, 1, :3]
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    order = _in_blocks(directions / np.maximum(lengths, _SHORTEST_NORMAL), np.arange(len(directions)))
    return (
        _filled(edges[order], np.zeros(4)),
        _filled(planes[order].reshape(-1, 8), np.array([0.0, 0, 0, _NO_OFFSET] * 2)),
        _bounds(planes[order]),
    )


def _starts(parts: Sequence[NDArray[Any]]) -> list[int]:
    return [0, *accumulate(map(len, parts))]


def spheres_of(vertices_m: Sequence[Floats]) -> Floats:
    """(S + 5, 4) centres and radii of spheres that hold each surface's vertices (V, 3), in its frame.

    Those of webs, which their frames stretch, hold everything.
    """
    spheres_m = np.array([_sphere_of(of_one) for of_one in vertices_m])
    spheres_m[N_RIGID:, 3] = np.where([len(of_one) > 0 for of_one in vertices_m[N_RIGID:]], np.inf, 0.0)
    return spheres_m


def _sphere_of(vertices_m: Floats) -> Floats:
    """Centre and radius (4,) of a sphere about the middle of the bounding box of vertices (V, 3), zeros for
    none."""
    if not len(vertices_m):
        return np.zeros(4)
    centre = (vertices_m.min(axis=0) + vertices_m.max(axis=0)) / 2
    return np.append(centre, np.linalg.norm(vertices_m - centre, axis=1).max() * (1.0 + 1e-9))


def _planes(vertices_m: Floats, faces: Ints) -> Singles:
    """The (F, 4) planes of one segment's faces."""
    corners = vertices_m[faces]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    longest_m = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    normals = np.cross(b - a, c - a) / np.maximum(longest_m, _SHORTEST_SIDE_M)[:, None]
    return np.column_stack([normals, np.sum(normals * a, axis=1)]).astype(np.float32)


def _in_blocks(directions: Singles, members: Longs) -> Longs:
    """An order of edges that puts those of like unit direction (E, 3) into the same block.

    Members are halved across their widest spread until they fit into a block.
    """
    if len(members) <= BLOCK:
        return members
    mine = directions[members]
    members = members[np.argsort(mine[:, np.ptp(mine, axis=0).argmax()], kind="stable")]
    n_blocks = -(-len(members) // BLOCK)
    half = n_blocks // 2 * BLOCK
    return np.concatenate([_in_blocks(directions, members[:half]), _in_blocks(directions, members[half:])])


def _filled(rows: NDArray[_Number], filler: NDArray[Any]) -> NDArray[_Number]:
    """Rows (E, k) as blocks (B, BLOCK, k), the last one filled up."""
    n_blocks = -(-len(rows) // BLOCK)
    blocks = np.empty((n_blocks * BLOCK, rows.shape[1]), rows.dtype)
    blocks[: len(rows)], blocks[len(rows) :] = rows, filler
    return blocks.reshape(n_blocks, BLOCK, -1)


def _bounds(planes: Singles) -> Singles:
    """The block_planes (B, 9) of one segment's planes (E, 2, 4) in their final order."""
    singles = _filled(planes.reshape(-1, 8), planes[-1:].ravel())
    filled = singles.reshape(-1, 2 * BLOCK, 4).astype(np.float64)
    lengthening = 1.0 / np.maximum(np.linalg.norm(filled[..., :3], axis=2), _SHORTEST_NORMAL)
    filled *= lengthening[..., None]
    low, high = filled.min(axis=1), filled.max(axis=1)
    return np.column_stack([(low + high) / 2, (high - low) / 2, lengthening.max(axis=1)]).astype(np.float32)
