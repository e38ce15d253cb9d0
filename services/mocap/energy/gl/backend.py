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

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Energy, Problem
from services.mocap.energy.bitplanes import CAMERAS_PER_PLANE, n_planes
from services.mocap.energy.cost import Counts
from services.mocap.energy.cpu.collecting import summed_gain
from services.mocap.energy.gl.device import GlDevice, GlLostError
from services.mocap.energy.gl.drawing import Drawer, Part, Scene
from services.mocap.energy.gl.mesh import GlMesh
from services.mocap.energy.gl.posing import ALL_DOFS, Posing
from services.mocap.energy.picture import Region
from services.mocap.types import Bytes, Floats


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
        scene = self._scene(problem.segments, problem.picture.region, _by_column(tally.gain))
        posing = Posing(problem.base_pose, problem.dofs, problem.segments, self._body.offsets_m)

        def evaluate(values: Floats) -> Floats:
            per_camera = np.tile(tally.blank, (len(values), 1))
            per_image = per_camera.reshape(-1)
            with self._current():
                for part in self._drawn(scene, posing, values):
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
        n_cameras, scene = self._rig.n_cameras, self._scene(segments, region, None)
        masks: Bytes = np.zeros((len(poses) * n_cameras, region.height_px, region.width_px), np.uint8)
        with self._current():
            posing = Posing(np.zeros(len(ALL_DOFS)), ALL_DOFS, segments, self._body.offsets_m)
            for part in self._drawn(scene, posing, poses):
                covered = self._drawer.covered(scene, part)
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

    def _scene(self, segments: tuple[int, ...], region: Region, gain_sums: Counts | None) -> Scene:
        with self._current():
            selection = self._mesh.select(segments)
        P_px_world = region.projections(self._rig)
        scene = Scene(selection, P_px_world, region.width_px, region.height_px, gain_sums)
        if segments:
            self._drawer.images_per_part(scene)
        return scene

    def _drawn(self, scene: Scene, posing: Posing, values: Floats) -> Iterator[Part]:
        """Draw values (N, d), and yield every part once the one after it is under way."""
        before = None
        for part in self._drawer.parts(scene, len(values)):
            first, last = part.first // scene.n_cameras, -(-part.last // scene.n_cameras)
            self._drawer.draw(scene, part, posing.transforms(values[first:last]))
            if before is not None:
                yield before
            before = part
        if before is not None:
            yield before


def _by_column(gain: Counts) -> Counts:
    """What the pixels left of each column gain (C, W + 1, H), of gain (C, H, W)."""
    return np.ascontiguousarray(summed_gain(gain).transpose(0, 2, 1))
