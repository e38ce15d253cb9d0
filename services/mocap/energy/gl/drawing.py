"""Drawing outlines into scratch buffers, part by part of a batch, and collecting what they cover.

A batch is a row of images: pose by pose, and within a pose camera by camera. A part is as many of them as the
scratch holds. What travels with a part exists twice, so that one part is filled while another is computed.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import prod
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from services.mocap.energy.gl.device import GROUP, MAX_GROUPS, GlDevice, GlUnavailableError
from services.mocap.energy.gl.mesh import GlMesh, Selection
from services.mocap.types import Bytes, Floats, Ints, Longs

SCRATCH_BYTES = 256 << 20
"""What the scratch buffers that the parts of a batch share hold at most together."""
_PART_IMAGES = 4096  # so that large batches have parts whose preparation and computation overlap
_MATRIX_BYTES = 12 * 8
_FILLING = {"winding": np.zeros(1, np.int32), "spans": np.array([0x7FFFFFFF, 0], np.int32)}
"""What kernels find, and leave behind, in buffers that are not written before they are read."""

_Target = str | moderngl.Buffer


@dataclass(frozen=True, eq=False)
class Drawing:
    """What stays the same over the batches of a problem."""

    selection: Selection
    P_px_world: Floats
    """(C, 3, 4) to pixels of the region."""
    width_px: int
    height_px: int
    gain_sums: Ints | None = None
    """(C, W + 1, H) in each row, what the pixels left of a column gain; None: covered pixels are wanted."""

    @property
    def n_cameras(self) -> int:
        """How many cameras there are."""
        return len(self.P_px_world)

    @property
    def covered_words(self) -> int:
        """Words of a row of covered pixels, 32 to a word."""
        return -(-self.width_px // 32)

    def scratch_bytes(self) -> dict[str, int]:
        """What one image needs of every scratch buffer that parts share."""
        n_slots, height = len(self.selection.segments), self.height_px
        return {
            "views": _MATRIX_BYTES * n_slots,
            "shown": 4 * n_slots,
            "uv": 8 * self.selection.n_vertices,
            "winding": 4 * self.width_px * height,
            "spans": 8 * height,
        }


@dataclass(frozen=True)
class Part:
    """Images first to last of a batch, and which of the two lanes of buffers they travel in."""

    first: int
    last: int
    lane: int


class Drawer:
    """Owns the scratch buffers; every method wants the device's context to be current."""

    def __init__(self, device: GlDevice, mesh: GlMesh) -> None:
        self._device = device
        self._mesh = mesh
        self._buffers: dict[str, moderngl.Buffer] = {}
        self._drawing: Drawing | None = None

    def images_per_part(self, drawing: Drawing) -> int:
        """How many images of a drawing a part has at most; raises GlUnavailableError where not even one fits,
        or what stays the same over all images does not."""
        needs, limit = drawing.scratch_bytes(), self._device.max_buffer_bytes
        most = min(
            SCRATCH_BYTES // sum(needs.values()),
            limit // max(needs.values()),
            MAX_GROUPS * GROUP // drawing.height_px,
            _PART_IMAGES,
        )
        gain_bytes = 0 if drawing.gain_sums is None else drawing.gain_sums.nbytes
        if most < 1 or gain_bytes > limit:
            raise GlUnavailableError(
                f"{drawing.n_cameras} cameras of {drawing.width_px} x {drawing.height_px} pixels are too "
                f"many for the gl backend, whose buffers on {self._device.renderer} hold "
                f"{min(limit, SCRATCH_BYTES) >> 20} MiB"
            )
        return most

    def parts(self, drawing: Drawing, n_poses: int) -> Iterator[Part]:
        """Cut a batch up, into nothing where nothing is drawn."""
        if not drawing.selection.segments:
            return
        most = self.images_per_part(drawing)
        n_images = n_poses * drawing.n_cameras
        for k, first in enumerate(range(0, n_images, most)):
            yield Part(first, min(first + most, n_images), k % 2)

    def draw(self, drawing: Drawing, part: Part, T_world_segment: Floats) -> None:
        """Draw a part's outlines and collect them: as sums of gain, or as covered pixels.

        T_world_segment (N, S, 3, 4): of the drawn segments, from the pose of the part's first image on.
        """
        if self._drawing is not drawing:
            self._write("cameras", drawing.P_px_world)
            if drawing.gain_sums is not None:
                self._write("gains", drawing.gain_sums)
            self._drawing = drawing
        selection, n, lane = drawing.selection, part.last - part.first, part.lane
        for name, n_bytes in drawing.scratch_bytes().items():
            self._reserve(name, n * n_bytes)
        self._reserve(f"sums{lane}", 8 * n)
        self._write(f"transforms{lane}", T_world_segment)
        n_slots = len(selection.segments)
        sizes = (n, part.first % drawing.n_cameras, drawing.n_cameras, n_slots, selection.n_vertices)
        self._write(f"part{lane}", np.array([*sizes, drawing.width_px, drawing.height_px, 0], np.uint32))
        self._buffers[f"part{lane}"].bind_to_uniform_block(0)
        transforms, sums, spheres = f"transforms{lane}", f"sums{lane}", selection.spheres
        vertices, edges = self._mesh.vertices, self._mesh.edges
        vertex_chunks, edge_chunks = selection.vertex_chunks, selection.edge_chunks
        n_views = -(-n * n_slots // GROUP)
        self._run("compose", n_views, 1, transforms, "cameras", spheres, "views", "shown", sums)
        self._run("project", selection.n_vertex_chunks, n, "views", "shown", vertex_chunks, vertices, "uv")
        self._run(
            "outline", selection.n_edge_chunks, n, "shown", edge_chunks, edges, "uv", "winding", "spans"
        )
        rows = -(-n * drawing.height_px // GROUP)
        if drawing.gain_sums is None:
            self._reserve(f"covered{lane}", 4 * n * drawing.height_px * drawing.covered_words)
            self._run("cover", rows, 1, "winding", "spans", f"covered{lane}")
        else:
            self._run("gain", rows, 1, "winding", "spans", "gains", f"sums{lane}")

    def sums(self, part: Part) -> Longs:
        """Wait for a part, and return what the covered pixels of each of its images gain in all."""
        return np.frombuffer(self._buffers[f"sums{part.lane}"].read(8 * (part.last - part.first)), np.int64)

    def covered(self, drawing: Drawing, part: Part) -> Bytes:
        """Wait for a part, and return its images' covered pixels (images, H, 4 words): bit k of byte j of a
        row is pixel 8 j + k."""
        shape = (part.last - part.first, drawing.height_px, 4 * drawing.covered_words)
        return np.frombuffer(self._buffers[f"covered{part.lane}"].read(prod(shape)), np.uint8).reshape(shape)

    def release(self) -> None:
        """Release all buffers."""
        for buffer in self._buffers.values():
            buffer.release()
        self._buffers.clear()

    def _run(self, name: str, x: int, y: int, *buffers: _Target) -> None:
        """Run a kernel on x times y work groups with its buffers in the order of their bindings."""
        program = self._device.program(name)
        for binding, buffer in enumerate(buffers):
            found = self._buffers[buffer] if isinstance(buffer, str) else buffer
            found.bind_to_storage_buffer(binding)
        program.run(x, y)
        self._device.context.memory_barrier()

    def _write(self, name: str, data: NDArray[Any]) -> None:
        self._reserve(name, data.nbytes).write(np.ascontiguousarray(data))

    def _reserve(self, name: str, n_bytes: int) -> moderngl.Buffer:
        """A buffer of at least that size; one that has to grow is replaced."""
        found = self._buffers.get(name)
        if found is None or found.size < n_bytes:
            if found is not None:
                found.release()
            found = self._buffers[name] = self._device.context.buffer(reserve=n_bytes)
            if name in _FILLING:
                filling = _FILLING[name]
                found.write(np.tile(filling, n_bytes // filling.nbytes))
        return found
