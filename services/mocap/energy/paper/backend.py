"""The `paper` backend: at every evaluation one pose is drawn, read back whole and counted on the CPU."""

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import surface_transforms
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Energy, Problem
from services.mocap.energy.bitplanes import n_planes, pack
from services.mocap.energy.gl.device import GlDevice
from services.mocap.energy.paper.rasteriser import Rasteriser
from services.mocap.energy.picture import Region
from services.mocap.types import Bytes, Floats, Words

_WORD_BYTES = 8


class PaperBackend:
    """Evaluates one body before one camera rig, one pose at a time, in the thread of the device.

    What evaluates raises GlLostError once OpenGL fails or is closed.

    Its pictures differ from the other backends' in single pixels of the boundary: vertices are posed in
    single precision, and whom a pixel centre on an edge belongs to is the driver's choice.
    """

    name = "paper"

    def __init__(self, device: GlDevice, body: Body, rig: Rig) -> None:
        self._body, self._rig = body, rig
        self._rasteriser = Rasteriser(device, body, rig.n_cameras)

    def energy(self, problem: Problem) -> Energy:
        """See Backend.energy; raises ValueError unless each camera counts as a whole, or not at all."""
        if not problem.cost.is_plain:
            raise ValueError(
                "the paper backend knows only the camera_weights 0 and 1: leave them empty, or choose "
                "another backend"
            )
        counts = problem.cost.weights(self._rig.n_cameras) > 0
        region = problem.picture.region
        counting = np.ones((region.height_px, region.width_px), bool) & counts[:, None, None]
        silhouettes = _words(problem.picture.silhouettes)
        counted = _words(pack(counting) & ~problem.picture.ignored)
        T_clip_world = self._clip_projections(region)
        planes, drawn = _planes_in_words(problem.picture.silhouettes.shape)

        def count(T_world_segment: Floats) -> int:
            self._rasteriser.draw(_composed(T_clip_world, T_world_segment), problem.segments, planes)
            return int(np.bitwise_count((drawn ^ silhouettes) & counted).sum())

        def evaluate(values: Floats) -> Floats:
            T_world_segment = surface_transforms(problem.poses(values), self._body.offsets_m)
            with self._rasteriser.ready():
                return np.array([count(T) for T in T_world_segment], np.float64)

        return evaluate

    def coverage(
        self,
        poses: Floats,
        segments: tuple[int, ...],
        region: Region,
        detail_px: float = 0.0,  # noqa: ARG002  (always the full mesh)
    ) -> Bytes:
        """See Backend.coverage; draws the full mesh, whatever detail_px allows."""
        shape = (len(poses), n_planes(self._rig.n_cameras), region.height_px, region.width_px)
        planes: Bytes = np.zeros(shape, np.uint8)
        T_clip_world = self._clip_projections(region)
        with self._rasteriser.ready():
            for T, planes_of_pose in zip(
                surface_transforms(poses, self._body.offsets_m), planes, strict=True
            ):
                self._rasteriser.draw(_composed(T_clip_world, T), segments, planes_of_pose)
        return planes

    def close(self) -> None:
        """Release what the backend holds on the GPU."""
        self._rasteriser.close()

    def _clip_projections(self, region: Region) -> Floats:
        """(C, 3, 4) of world metres to clip x, y and depth: pixel u, at whole coordinates, has its centre at
        (u + 0.5) 2 / width - 1, and row 0 is the lowest."""
        clip = np.diag([2.0 / region.width_px, 2.0 / region.height_px, 1.0])
        clip[:2, 2] = 1.0 / region.width_px - 1.0, 1.0 / region.height_px - 1.0
        return clip @ region.projections(self._rig)


def _composed(T_clip_world: Floats, T_world_segment: Floats) -> Floats:
    """(C, S, 3, 4) of all pairs of (C, 3, 4) and (S, 4, 4)."""
    return T_clip_world[:, None] @ T_world_segment


def _planes_in_words(shape: tuple[int, ...]) -> tuple[Bytes, Words]:
    """Zeroed bytes of a shape, and the same memory as words, the last one filled up with zeros."""
    n_bytes = int(np.prod(shape))
    words = np.zeros(-(-n_bytes // _WORD_BYTES), np.uint64)
    return words.view(np.uint8)[:n_bytes].reshape(shape), words


def _words(planes: Bytes) -> Words:
    """Planes as words, of which eight bytes at a time are compared and counted."""
    copy, words = _planes_in_words(planes.shape)
    copy[:] = planes
    return words
