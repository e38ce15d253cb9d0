"""The GL side: a body's triangles drawn for every camera into its bit, and the whole buffer read back.

Every camera's geometry is flattened to one depth, which decreases from camera to camera. The depth test
(less) then lets each pixel take each camera's bit exactly once, and additive blending puts it beside the
others: the paper's stencil trick with what moderngl offers, and with no clear between cameras.

The vertex shader poses vertices and flattens them to their camera's depth; the fragment shader carries its
bit. Corners are divided by their depth in the shader and not by the rasteriser: with w = 1 and the same z at
all three corners every fragment of a camera has exactly that z, so that the depth test lets one of them pass
and no second one.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, TypeVar

import moderngl
import numpy as np

from services.mocap.body.actor import Body
from services.mocap.energy.bitplanes import CAMERAS_PER_PLANE, n_planes
from services.mocap.energy.gl.device import GlDevice
from services.mocap.energy.snapping import NEAR_M
from services.mocap.types import Bytes, Floats

_MOST_MESHES = 32
_MOST_TARGETS = 16
_BYTES_PER_ROW = 16
_ROWS_PER_MATRIX = 3
_FRAGMENT_SHADER = """#version 430
flat in float bit;
layout(location = 0) out float plane;

void main() {
    plane = bit;
}
"""

Key = TypeVar("Key")
Value = TypeVar("Value")


@dataclass(frozen=True, eq=False)
class _Mesh:
    """The triangles of some segments; none where the segments have none."""

    indices: moderngl.Buffer
    array: moderngl.VertexArray

    def release(self) -> None:
        self.array.release()
        self.indices.release()


class _Target:
    """One plane: a byte of bits and a depth for every pixel."""

    def __init__(self, context: moderngl.Context, size_px: tuple[int, int]) -> None:
        self._bits, self._depth = context.renderbuffer(size_px, 1), context.depth_renderbuffer(size_px)
        self.framebuffer = context.framebuffer([self._bits], self._depth)

    def release(self) -> None:
        self.framebuffer.release()
        self._bits.release()
        self._depth.release()


class Kept(Generic[Key, Value]):
    """Values by key, at most `most` of them: the one that was asked for longest ago goes first."""

    def __init__(self, make: Callable[[Key], Value], release: Callable[[Value], None], most: int) -> None:
        self._make, self._release, self._most = make, release, most
        self._values: dict[Key, Value] = {}

    def __getitem__(self, key: Key) -> Value:
        """The key's value, which holds until the next one is asked for."""
        value = self._values.pop(key, None)
        if value is None:
            value = self._make(key)
        self._values[key] = value  # the last one now
        if len(self._values) > self._most:
            self._release(self._values.pop(next(iter(self._values))))
        return value

    def clear(self) -> None:
        """Release all of them."""
        while self._values:
            self._release(self._values.popitem()[1])


class Rasteriser:
    """Draws one body for a number of cameras; every GL object that it makes is released by close."""

    def __init__(self, device: GlDevice, body: Body, n_cameras: int) -> None:
        vertices_m, self._faces = zip(*body.surfaces, strict=True)
        self._device = device
        self._first_vertex = np.cumsum([0, *map(len, vertices_m)])
        n_segments = len(vertices_m)
        self._plane_bytes = CAMERAS_PER_PLANE * n_segments * _ROWS_PER_MATRIX * _BYTES_PER_ROW
        with device.current() as context:
            self._program = context.program(_vertex_shader(n_segments), _FRAGMENT_SHADER)
            self._nothing = context.detect_framebuffer(0)
            self._vertices = context.buffer(_interleaved(vertices_m))
            # A block may start only at a multiple of this step: 16 bytes with Mesa, 256 with NVIDIA.
            step = int(context.info["GL_UNIFORM_BUFFER_OFFSET_ALIGNMENT"])
            self._plane_stride = -(-self._plane_bytes // step) * step
            self._matrices = context.buffer(reserve=n_planes(n_cameras) * self._plane_stride)
        self._meshes: Kept[tuple[int, ...], _Mesh] = Kept(self._mesh, _Mesh.release, _MOST_MESHES)
        self._targets: Kept[tuple[int, int, int], _Target] = Kept(
            lambda key: _Target(device.context, key[:2]),
            _Target.release,
            max(_MOST_TARGETS, n_planes(n_cameras)),
        )

    @contextmanager
    def ready(self) -> Iterator[None]:
        """Make the device's context current and set the state that draw relies on: others share both.

        Raises GlLostError where OpenGL fails or is closed.
        """
        with self._device.current() as context:
            context.enable_only(moderngl.BLEND | moderngl.DEPTH_TEST | moderngl.CULL_FACE)
            context.blend_func = moderngl.ONE, moderngl.ONE
            context.blend_equation = moderngl.FUNC_ADD, moderngl.FUNC_ADD
            context.depth_func, context.cull_face = "<", "back"
            context.front_face = "cw"  # the picture's first row is the buffer's lowest: seen mirrored
            context.wireframe = False
            try:
                yield
            finally:
                self._nothing.use()  # moderngl goes back to what is bound, even once that is released

    def draw(self, M_clip_segment: Floats, segments: tuple[int, ...], planes: Bytes) -> None:
        """Draw segments by matrices (C, S, 3, 4) and read the bits back into planes (P, h, w), contiguous.

        A matrix takes homogeneous segment metres to clip x, y and depth in metres, row 0 of the picture at
        clip y = -1. Only within ready.
        """
        matrices = M_clip_segment.astype(np.float32)
        targets = [self._targets[planes.shape[2], planes.shape[1], p].framebuffer for p in range(len(planes))]
        for p, target in enumerate(targets):
            target.clear(depth=1.0)
            target.use()
            if segments:
                of_plane = matrices[CAMERAS_PER_PLANE * p : CAMERAS_PER_PLANE * (p + 1)]
                self._matrices.write(of_plane, offset=p * self._plane_stride)
                self._matrices.bind_to_uniform_block(0, p * self._plane_stride, self._plane_bytes)
                self._meshes[segments].array.render(instances=len(of_plane))
        for target, plane in zip(targets, planes, strict=True):
            target.read_into(plane, components=1, alignment=1)

    def close(self) -> None:
        """Release every GL object; with the device gone there is none left."""
        if self._device.is_open:
            with self._device.current():
                self._meshes.clear()
                self._targets.clear()
                for thing in (self._matrices, self._vertices, self._program):
                    thing.release()

    def _mesh(self, segments: tuple[int, ...]) -> _Mesh:
        faces = [self._faces[s] + self._first_vertex[s] for s in segments]
        indices = self._device.context.buffer(np.concatenate(faces).astype(np.uint32))
        content = [(self._vertices, "3f 1i", "xyz_m", "segment")]
        return _Mesh(indices, self._device.context.vertex_array(self._program, content, indices))


def _vertex_shader(n_segments: int) -> str:
    """Poses a segment's vertices before the camera that gl_InstanceID counts.

    A corner nearer than NEAR_M goes so far out of the clip volume that clipping cuts its triangle off at the
    corners that stay: nothing of it is left.
    """
    return f"""#version 430
in vec3 xyz_m;
in int segment;
layout(std140, binding = 0) uniform Matrices {{
    vec4 rows[{CAMERAS_PER_PLANE * n_segments * _ROWS_PER_MATRIX}];
}};
flat out float bit;

void main() {{
    int first = {_ROWS_PER_MATRIX} * ({n_segments} * gl_InstanceID + segment);
    vec4 point = vec4(xyz_m, 1.0);
    float depth_m = dot(rows[first + 2], point);
    vec2 place = vec2(dot(rows[first], point), dot(rows[first + 1], point)) / max(depth_m, {NEAR_M});
    float camera_z = 1.0 - float(gl_InstanceID + 1) / {CAMERAS_PER_PLANE}.0;
    gl_Position = vec4(place, depth_m < {NEAR_M} ? -1e20 : camera_z, 1.0);
    bit = float(1 << gl_InstanceID) / 255.0;
}}
"""


def _interleaved(vertices_m: Sequence[Floats]) -> bytes:
    """All vertices with the index of their segment, as the vertex array reads them."""
    layout = np.dtype([("xyz_m", np.float32, 3), ("segment", np.int32)])
    rows = np.empty(sum(map(len, vertices_m)), layout)
    rows["xyz_m"] = np.concatenate(vertices_m)
    rows["segment"] = np.arange(len(vertices_m)).repeat([*map(len, vertices_m)])
    return rows.tobytes()
