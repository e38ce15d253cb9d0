"""The `cpu` backend: outlines instead of triangles, sums instead of pictures."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import frame_transforms, moving_frames
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Energy, Problem
from services.mocap.energy.bitplanes import n_planes
from services.mocap.energy.cpu.collecting import empty_canvas, summed_gain
from services.mocap.energy.cpu.facing import cameras_of
from services.mocap.energy.cpu.outline import cover, evaluate, prepared
from services.mocap.energy.picture import Region
from services.mocap.side_by_side import N_CORES
from services.mocap.types import Bytes, Floats


class CpuBackend:
    """Evaluates one body in one camera rig; only one thread at a time may call it.

    threads: how many cores a batch is spread over; 0 for all that this process may use.
    """

    name = "cpu"

    def __init__(self, body: Body, rig: Rig, threads: int = 1) -> None:
        self._body = body
        self._rig = rig
        self._n_threads = threads or N_CORES
        self._pool = ThreadPoolExecutor(self._n_threads, "energy") if self._n_threads > 1 else None
        self._prepared = cache(partial(prepared, body, n=self._n_threads))

    def energy(self, problem: Problem) -> Energy:
        """See Backend.energy. Costs a pass over the picture; every call then touches outlines only."""
        region, tally, base = problem.picture.region, problem.cost.tally(problem.picture), problem.base_pose
        frames = moving_frames(problem.dofs, problem.segments)
        plan = (np.array(problem.dofs, np.int32), frames, np.array(problem.segments, np.int32))
        T_world_frame = frame_transforms(base[None], self._body.offsets_m)[0]
        mesh, scratches = self._prepared(problem.detail_px > 0)
        cameras, gain_sums = cameras_of(self._rig, region), summed_gain(tally.gain)
        costs = np.array([tally.blank, tally.weights])
        lanes = [
            (base.copy(), T_world_frame.copy(), scratch, empty_canvas(region.height_px, region.width_px))
            for scratch in scratches
        ]

        def run(lane: int, values: Floats, energies: Floats) -> None:
            pose, transforms, scratch, canvas = lanes[lane]
            evaluate(
                values, plan, pose, transforms, self._body.offsets_m, cameras, problem.detail_px,
                mesh, scratch, gain_sums, costs, canvas, energies,
            )  # fmt: skip

        def evaluate_all(values: Floats) -> Floats:
            if not (values.flags.c_contiguous and values.flags.writeable):
                values = values.copy()  # to Numba the others are types of their own, to compile for
            energies = np.empty(len(values))
            if self._pool is None or len(values) < len(lanes):
                run(0, values, energies)
            else:
                shares = np.array_split(values, len(lanes)), np.array_split(energies, len(lanes))
                list(self._pool.map(run, range(len(lanes)), *shares))
            return energies

        return evaluate_all

    def coverage(
        self, poses: Floats, segments: tuple[int, ...], region: Region, detail_px: float = 0.0
    ) -> Bytes:
        """See Backend.coverage."""
        shape = (len(poses), n_planes(self._rig.n_cameras), region.height_px, region.width_px)
        planes: Bytes = np.zeros(shape, np.uint8)
        mesh, scratches = self._prepared(detail_px > 0)
        T_world_frame = frame_transforms(poses, self._body.offsets_m)
        cover(
            T_world_frame, np.array(segments, np.int32), cameras_of(self._rig, region), detail_px,
            mesh, scratches[0], empty_canvas(region.height_px, region.width_px), planes,
        )  # fmt: skip
        return planes

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
