"""The `cpu` backend: outlines instead of triangles, sums instead of pictures, on one thread."""

import numpy as np
from numpy.typing import NDArray

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import segment_transforms
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Energy, Problem
from services.mocap.energy.bitplanes import n_planes, unpack
from services.mocap.energy.cpu.collecting import empty_winding, summed_gain
from services.mocap.energy.cpu.mesh import FlatMesh
from services.mocap.energy.cpu.outline import outline_coverage, outline_energy, scratch_for
from services.mocap.energy.picture import Picture, Region
from services.mocap.types import Bytes, Floats


class CpuBackend:
    """Evaluates one body before one camera rig; not to be shared between threads."""

    name = "cpu"

    def __init__(self, body: Body, rig: Rig) -> None:
        self._body = body
        self._rig = rig
        mesh = FlatMesh.of(body)
        self._mesh, self._scratch = (*mesh,), scratch_for(mesh)

    def energy(self, problem: Problem) -> Energy:
        """See Backend.energy. Costs a pass over the picture; every call then touches outlines only."""
        segments, region = np.array(problem.segments, np.int32), problem.picture.region
        P_px_world = region.projections(self._rig)
        gain_sums = summed_gain(_gain(problem.picture, self._rig.n_cameras))
        uncovered = problem.picture.n_foreground
        winding = empty_winding(region.height_px, region.width_px)

        def evaluate(values: Floats) -> Floats:
            energies = np.full(len(values), float(uncovered))
            T_world_segment = segment_transforms(problem.poses(values), self._body.offsets_m)
            outline_energy(
                T_world_segment, segments, P_px_world, self._mesh, self._scratch,
                gain_sums, region.width_px, winding, energies,
            )  # fmt: skip
            return energies

        return evaluate

    def coverage(self, poses: Floats, segments: tuple[int, ...], region: Region) -> Bytes:
        """See Backend.coverage."""
        n_cameras = self._rig.n_cameras
        shape = (len(poses), n_planes(n_cameras), region.height_px, region.width_px)
        planes: Bytes = np.zeros(shape, np.uint8)
        T_world_segment = segment_transforms(poses, self._body.offsets_m)
        winding = empty_winding(region.height_px, region.width_px)
        outline_coverage(
            T_world_segment, np.array(segments, np.int32), region.projections(self._rig), self._mesh,
            self._scratch, winding, planes,
        )  # fmt: skip
        return planes

    def close(self) -> None:
        """Nothing is held."""


def _gain(picture: Picture, n_cameras: int) -> NDArray[np.int8]:
    """What a covered pixel adds to the energy of an empty model (C, h, w): -1 on the input, +1 off it."""
    on_input, ignored = unpack(picture.silhouettes, n_cameras), unpack(picture.ignored, n_cameras)
    return np.where(ignored, 0, np.where(on_input, -1, 1)).astype(np.int8)
