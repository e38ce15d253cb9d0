"""A body's meshes in buffers, and which parts of them the work groups take when some segments are drawn."""

from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from services.mocap.body.actor import Body
from services.mocap.body.surface import closed_edges
from services.mocap.energy.cpu.mesh import spheres_of
from services.mocap.energy.gl.device import GROUP, MAX_GROUPS, GlDevice, GlUnavailableError

_VERTEX_BYTES, _EDGE_BYTES = 3 * 8, 4 * 4


@dataclass(frozen=True, eq=False)
class Selection:
    """The segments of one problem, cut into chunks of at most one work group each."""

    segments: tuple[int, ...]
    n_vertices: int
    n_vertex_chunks: int
    n_edge_chunks: int
    vertex_chunks: moderngl.Buffer
    """uvec4: place among the segments, first vertex, how many, first place in an image's drawn vertices."""
    edge_chunks: moderngl.Buffer
    """uvec4: place among the segments, first edge, how many, the segment's first drawn vertex."""
    spheres: moderngl.Buffer
    """(S, 4) double: centre, in the segment's frame, and radius of a sphere that holds it."""


class GlMesh:
    """All segments' vertices and edges, uploaded once.

    Raises ValueError where a segment's mesh is not closed, GlUnavailableError where the body is too large for
    the device.
    """

    def __init__(self, device: GlDevice, body: Body) -> None:
        self._context = context = device.context
        edges = [closed_edges(faces)[0].astype(np.uint32) for _, faces in body.surfaces]
        vertices_m = [vertices_m for vertices_m, _ in body.surfaces]
        self._first_vertices = [0, *accumulate(map(len, vertices_m))]
        self._first_edges = [0, *accumulate(map(len, edges))]
        self._spheres_m = spheres_of(vertices_m)
        n_vertices, n_edges = self._first_vertices[-1], self._first_edges[-1]
        most = min(MAX_GROUPS - len(edges), device.max_buffer_bytes // (_EDGE_BYTES * GROUP)) * GROUP
        if n_edges > most or n_vertices > device.max_buffer_bytes // _VERTEX_BYTES:
            raise GlUnavailableError(
                f"the body has {n_vertices} vertices and {n_edges} edges: too many for the gl backend on "
                f"{device.renderer}"
            )
        self.vertices = context.buffer(np.concatenate(vertices_m).astype(np.float64))
        """(V, 3) double, in their segment's frame."""
        ends, corners = np.hsplit(np.concatenate(edges), 2)
        self.edges = context.buffer(np.concatenate([ends, corners]))
        """(2, E) uvec2: a and b of closed_edges, then c and d, counted from their segment's first vertex."""
        self._selections: dict[tuple[int, ...], Selection] = {}

    def select(self, segments: tuple[int, ...]) -> Selection:
        """What to draw of these segments, made once for each choice of them."""
        if segments not in self._selections:
            self._selections[segments] = self._make(segments)
        return self._selections[segments]

    def release(self) -> None:
        """Release all buffers."""
        for selection in self._selections.values():
            for chunks in (selection.vertex_chunks, selection.edge_chunks, selection.spheres):
                chunks.release()
        self._selections.clear()
        self.vertices.release()
        self.edges.release()

    def _make(self, segments: tuple[int, ...]) -> Selection:
        none = np.zeros((0, 4), np.uint32)
        vertex_chunks, edge_chunks, n_vertices = [none], [none], 0
        for slot, s in enumerate(segments):
            first, last = self._first_vertices[s], self._first_vertices[s + 1]
            vertex_chunks.append(_chunks(slot, first, last, n_vertices, GROUP))
            edge_chunks.append(_chunks(slot, self._first_edges[s], self._first_edges[s + 1], n_vertices, 0))
            n_vertices += last - first
        vertices, edges = np.concatenate(vertex_chunks), np.concatenate(edge_chunks)
        return Selection(
            segments=segments,
            n_vertices=n_vertices,
            n_vertex_chunks=len(vertices),
            n_edge_chunks=len(edges),
            vertex_chunks=self._upload(vertices),
            edge_chunks=self._upload(edges),
            spheres=self._upload(self._spheres_m[list(segments)]),
        )

    def _upload(self, data: NDArray[Any]) -> moderngl.Buffer:
        """A buffer with data; buffers cannot be empty, and where no segments are drawn nothing reads them."""
        return self._context.buffer(data) if data.size else self._context.buffer(reserve=4)


def _chunks(slot: int, first: int, last: int, target: int, target_step: int) -> NDArray[np.uint32]:
    """Chunks (K, 4) of first to last; the fourth column starts at target and grows by target_step."""
    starts = np.arange(first, last, GROUP)
    targets = target + target_step * np.arange(len(starts))
    counts = np.minimum(last - starts, GROUP)
    return np.stack([np.full(len(starts), slot), starts, counts, targets], axis=1).astype(np.uint32)
