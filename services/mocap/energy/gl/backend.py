"""The `gl` backend: the outlines of whole batches by compute shaders.

No triangle is rasterised. The body's triangles are smaller than a pixel, which is the worst case of a GPU's
rasterisers, and GPUs for data centres have next to none of those. What the `cpu` backend does is instead done
by an invocation per vertex, per edge and per pixel row, over all poses and cameras of a batch at once, with
the same whole-number arithmetic behind the snapping. Snapping itself is done in double precision, in the same
order and without fused operations. So where a division of doubles is rounded correctly, as on llvmpipe, the
energies are the `cpu` backend's (at full detail) to the last bit; GLSL does not promise that it is, and
elsewhere a vertex in a great many may snap one step of 1/256 pixel off.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numba
import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import (
    N_DOF,
    SURFACE_FRAMES,
    frame_transforms,
    moving_frames,
    place_frames,
)
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Energy, Problem
from services.mocap.energy.bitplanes import CAMERAS_PER_PLANE, n_planes
from services.mocap.energy.cpu.collecting import summed_gain
from services.mocap.energy.gl.device import GlDevice, GlLostError
from services.mocap.energy.gl.drawing import Drawer, Drawing, Part
from services.mocap.energy.gl.mesh import GlMesh
from services.mocap.energy.picture import Region
from services.mocap.types import Bytes, Floats, Ints


class Posing:
    """How the drawn segments follow from the parameters that vary; the other joints stay where they are."""

    def __init__(
        self, base_pose: Floats, dofs: tuple[int, ...], segments: tuple[int, ...], offsets_m: Floats
    ) -> None:
        self._dofs = np.array(dofs, np.int32)
        self._moving = moving_frames(dofs, segments)
        self._carriers = SURFACE_FRAMES[list(segments)]
        self._offsets_m = offsets_m
        self._pose = np.array(base_pose, np.float64)
        self._T_world_frame = frame_transforms(self._pose[None], offsets_m)[0]

    def transforms(self, values: Floats) -> Floats:
        """T_world_surface (N, S, 3, 4), the rows that are not constant, of values (N, d)."""
        T_world_surface = np.empty((len(values), len(self._carriers), 3, 4))
        _pose_all(
            np.array(values, np.float64, order="C"), self._dofs, self._moving, self._carriers,
            self._offsets_m, self._pose, self._T_world_frame, T_world_surface,
        )  # fmt: skip
        return T_world_surface


@numba.njit(cache=True, nogil=True)
def _pose_all(
    values: Floats,
    dofs: Ints,
    moving: Ints,
    carriers: Ints,
    offsets_m: Floats,
    pose: Floats,
    T_world_frame: Floats,
    T_world_surface: Floats,
) -> None:
    for n in range(len(values)):
        for k in range(len(dofs)):
            pose[dofs[k]] = values[n, k]
        place_frames(pose, offsets_m, moving, T_world_frame)
        for s in range(len(carriers)):
            T_world_surface[n, s] = T_world_frame[carriers[s], :3]


class GlBackend:
    """Evaluates one body before one camera rig, on a device that several backends of one thread may share.

    What evaluates raises GlLostError once OpenGL fails or is closed. Making a backend and preparing a problem
    raise GlUnavailableError too: where the device's buffers are too small for the body or the pictures.
    """

    name = "gl"

    def __init__(self, device: GlDevice, body: Body, rig: Rig) -> None:
        self._device = device
        self._body = body
        self._rig = rig
        self._closed = False
        with device.current():
            self._mesh = GlMesh(device, body)
            self._drawer = Drawer(device, self._mesh)

    def energy(self, problem: Problem) -> Energy:
        """See Backend.energy. Costs a pass over the picture; every call sends transforms and gets sums."""
        tally = problem.cost.tally(problem.picture)
        gain_sums = np.ascontiguousarray(summed_gain(tally.gain).transpose(0, 2, 1))
        drawing = self._drawing(problem.segments, problem.picture.region, gain_sums)
        posing = Posing(problem.base_pose, problem.dofs, problem.segments, self._body.offsets_m)

        def evaluate(values: Floats) -> Floats:
            per_camera = np.tile(tally.blank, (len(values), 1))
            per_image = per_camera.reshape(-1)
            with self._current():
                for part in self._drawn(drawing, posing, values):
                    per_image[part.first : part.last] += self._drawer.sums(part)
            return tally.energies(per_camera)

        return evaluate

    def coverage(
        self,
        poses: Floats,
        segments: tuple[int, ...],
        region: Region,
        detail_px: float = 0.0,  # noqa: ARG002  (always the full mesh)
    ) -> Bytes:
        """See Backend.coverage; draws the full mesh, whatever detail_px allows."""
        n_cameras, drawing = self._rig.n_cameras, self._drawing(segments, region, None)
        masks: Bytes = np.zeros((len(poses) * n_cameras, region.height_px, region.width_px), np.uint8)
        with self._current():
            posing = Posing(np.zeros(N_DOF), tuple(range(N_DOF)), segments, self._body.offsets_m)
            for part in self._drawn(drawing, posing, poses):
                covered = self._drawer.covered(drawing, part)
                masks[part.first : part.last] = np.unpackbits(
                    covered, axis=2, count=region.width_px, bitorder="little"
                )
        planes: Bytes = np.zeros((len(poses), n_planes(n_cameras), *masks.shape[1:]), np.uint8)
        for c, mask in enumerate(np.moveaxis(masks.reshape(len(poses), n_cameras, *masks.shape[1:]), 1, 0)):
            planes[:, c // CAMERAS_PER_PLANE] |= mask << c % CAMERAS_PER_PLANE
        return planes

    def close(self) -> None:
        """Release the buffers; the device stays."""
        if self._device.is_open and not self._closed:
            with self._device.current():
                self._drawer.release()
                self._mesh.release()
        self._closed = True

    @contextmanager
    def _current(self) -> Iterator[None]:
        if self._closed:
            raise GlLostError("this gl backend is closed: make a new one")
        with self._device.current():
            yield

    def _drawing(self, segments: tuple[int, ...], region: Region, gain_sums: Ints | None) -> Drawing:
        with self._current():
            selection = self._mesh.select(segments)
        P_px_world = region.projections(self._rig)
        drawing = Drawing(selection, P_px_world, region.width_px, region.height_px, gain_sums)
        if segments:
            self._drawer.images_per_part(drawing)
        return drawing

    def _drawn(self, drawing: Drawing, posing: Posing, values: Floats) -> Iterator[Part]:
        """Draw values (N, d), and yield every part once the one after it is under way."""
        before = None
        for part in self._drawer.parts(drawing, len(values)):
            first, last = part.first // drawing.n_cameras, -(-part.last // drawing.n_cameras)
            self._drawer.draw(drawing, part, posing.transforms(values[first:last]))
            if before is not None:
                yield before
            before = part
        if before is not None:
            yield before
