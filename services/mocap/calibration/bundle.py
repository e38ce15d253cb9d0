"""The bundle adjustment: fits all lenses, cameras and boards at once to the detected corners."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

from services.mocap.calibration.board import Board
from services.mocap.calibration.lens import N_COEFFICIENTS, N_INTRINSICS, Intrinsics, project
from services.mocap.calibration.rigid_transform import RigidTransform
from services.mocap.calibration.sightings import Sightings
from services.mocap.types import Floats, Ints, Mask

_N_POSE = 6
_N_CAMERA = N_INTRINSICS + _N_POSE
_ROBUST_PX = 1.5
"""Residual from which corners count linearly, while some may still be wrong."""
_ROUGH, _EXACT = 1e-4, 1e-8
"""Tolerances of the cost before and after wrong corners are removed."""
_INNER = {"atol": 1e-8, "btol": 1e-8}
"""With coarser inner steps the solver zigzags: many cheap steps take far longer than a few exact ones."""
_MOST_EVALUATIONS = 40
_STEP = 1e-6
_RIDGE = 1e-9


@dataclass(frozen=True, eq=False)
class Corners:
    """All corners that were seen, one row each."""

    camera: Ints
    """(N,)"""
    frame: Ints
    """(N,) index of its moment in Estimate.boards."""
    board_m: Floats
    """(N, 3) in the board frame."""
    points_px: Floats
    """(N, 2) in the raw picture."""

    def only(self, keep: Mask) -> "Corners":
        """Those rows that are to be kept."""
        return Corners(self.camera[keep], self.frame[keep], self.board_m[keep], self.points_px[keep])


@dataclass(frozen=True, eq=False)
class Estimate:
    """The present estimate; the rig frame is that of the first camera."""

    lenses: list[Intrinsics]
    cameras: list[RigidTransform]
    """T_camera_rig."""
    frames: list[int]
    """The number of each moment."""
    boards: list[RigidTransform]
    """T_rig_board in each moment."""


def corners_of(seen: list[Sightings], frames: list[int], board: Board) -> Corners:
    """Every corner that any camera saw in some frames."""
    views = [
        (c, f, sightings.by_frame[frame])
        for c, sightings in enumerate(seen)
        for f, frame in enumerate(frames)
        if frame in sightings.by_frame
    ]
    counts = [len(view.corners) for _, _, view in views]
    return Corners(
        np.repeat([c for c, _, _ in views], counts).astype(np.int32),
        np.repeat([f for _, f, _ in views], counts).astype(np.int32),
        board.corners_m[np.concatenate([view.corners for _, _, view in views])],
        np.concatenate([view.points_px for _, _, view in views]),
    )


def residuals_px(estimate: Estimate, corners: Corners) -> Floats:
    """(N, 2) detected minus predicted corners."""
    return _Problem(estimate, corners).off_px(*_no_change(estimate)).reshape(-1, 2)


def adjust(estimate: Estimate, corners: Corners, robust: bool) -> Estimate:
    """The estimate that fits the corners best; robust: if wrong ones may be among them."""
    problem, tolerance = _Problem(estimate, corners), _ROUGH if robust else _EXACT
    solution = least_squares(
        problem.residuals,
        np.zeros(problem.n_parameters),
        jac_sparsity=problem.sparsity(),
        loss="huber" if robust else "linear",
        f_scale=_ROBUST_PX,
        ftol=tolerance,
        xtol=tolerance,
        gtol=None,
        max_nfev=_MOST_EVALUATIONS,
        tr_options=_INNER,
    )
    return problem.estimate(solution.x)


def _no_change(estimate: Estimate) -> tuple[Floats, Floats]:
    return np.zeros((len(estimate.cameras), _N_CAMERA)), np.zeros((len(estimate.boards), _N_POSE))


class _Problem:
    """Residuals by changes to an estimate.

    Rotations are parametrised by small rotations about the estimate, far from any ambiguity. The parameters
    of each camera and board are scaled to equal influence (see _units): without that the inner solver needs a
    hundred times as long.
    """

    def __init__(self, estimate: Estimate, corners: Corners) -> None:
        self._start, self._corners = estimate, corners
        self._values = np.array([lens.values for lens in estimate.lenses])
        self._R = np.array([pose.R for pose in (*estimate.cameras, *estimate.boards)])
        self._t_m = np.array([pose.t_m for pose in (*estimate.cameras, *estimate.boards)])
        self._fisheye = estimate.lenses[0].is_fisheye
        self._free = np.array(
            [
                lens.free or [i < 4 + N_COEFFICIENTS[lens.lens] for i in range(N_INTRINSICS)]
                for lens in estimate.lenses
            ]
        )
        self._one_focal = self._free[:, 0] & ~self._free[:, 1]
        self.n_parameters = _N_CAMERA * len(estimate.cameras) + _N_POSE * len(estimate.boards)

    def off_px(self, of_cameras: Floats, of_boards: Floats) -> Floats:
        """(2 N,) residuals after changes of cameras (C, 15), lens then pose, and of boards (F, 6)."""
        values, R, t_m = self._changed(of_cameras, of_boards)
        corners, n_cameras = self._corners, len(values)
        board, camera = n_cameras + corners.frame, corners.camera
        rig_m = np.einsum("nij,nj->ni", R[board], corners.board_m) + t_m[board]
        camera_m = np.einsum("nij,nj->ni", R[camera], rig_m) + t_m[camera]
        off_px: Floats = project(camera_m, values[camera], self._fisheye) - corners.points_px
        return off_px.ravel()

    def residuals(self, x: Floats) -> Floats:
        """(2 N,) by the minimiser's parameters."""
        return self.off_px(*self._changes(x))

    def estimate(self, x: Floats) -> Estimate:
        """The estimate of the minimiser's parameters."""
        values, R, t_m = self._changed(*self._changes(x))
        poses = [RigidTransform(*pose) for pose in zip(R, t_m, strict=True)]
        lenses = [replace(lens, values=v) for lens, v in zip(self._start.lenses, values, strict=True)]
        return replace(self._start, lenses=lenses, cameras=poses[: len(values)], boards=poses[len(values) :])

    def sparsity(self) -> csr_matrix:
        """(2 N, parameters) which residual depends on which parameter: one camera's and one board's."""
        camera, board = (
            np.repeat(which, 2)[:, None] for which in (self._corners.camera, self._corners.frame)
        )
        of_camera = _N_CAMERA * camera + np.arange(_N_CAMERA)
        of_board = _N_CAMERA * len(self._values) + _N_POSE * board + np.arange(_N_POSE)
        columns = np.hstack([of_camera, of_board])
        starts = np.arange(len(columns) + 1) * columns.shape[1]
        pattern = (np.ones(columns.size, np.int8), columns.ravel(), starts)
        return csr_matrix(pattern, shape=(len(columns), self.n_parameters))

    @cached_property
    def _units(self) -> tuple[Floats, Floats]:
        """What a parameter of 1 changes: (C, 15, 15) in cameras, (F, 6, 6) in boards.

        Each block of the problem is whitened, so that a step of some length changes the residuals by as much,
        whatever its direction in the block; a step of 1 may undo all that is off now.
        """
        of_cameras, of_boards = _no_change(self._start)
        now_px = self.off_px(of_cameras, of_boards)
        slopes = []
        for changes in (of_cameras, of_boards):
            slope = np.empty((len(now_px), changes.shape[1]))
            for i in range(changes.shape[1]):
                changes[:, i] = _STEP  # of all blocks at once, since a residual depends on one of each kind
                slope[:, i] = (self.off_px(of_cameras, of_boards) - now_px) / _STEP
                changes[:, i] = 0.0
            slopes.append(slope)
        reach_px = float(np.linalg.norm(now_px))
        kinds = ((self._corners.camera, len(of_cameras)), (self._corners.frame, len(of_boards)))
        whitened = [
            _whitening(slope, np.repeat(block, 2), n) for slope, (block, n) in zip(slopes, kinds, strict=True)
        ]
        return reach_px * whitened[0], reach_px * whitened[1]

    def _changes(self, x: Floats) -> tuple[Floats, Floats]:
        split = _N_CAMERA * len(self._values)
        of_cameras, of_boards = self._units
        return (
            np.einsum("cij,cj->ci", of_cameras, x[:split].reshape(-1, _N_CAMERA)),
            np.einsum("fij,fj->fi", of_boards, x[split:].reshape(-1, _N_POSE)),
        )

    def _changed(self, of_cameras: Floats, of_boards: Floats) -> tuple[Floats, Floats, Floats]:
        """Lens values (C, 9), and R (C + F, 3, 3) and t_m (C + F, 3) of cameras and boards.

        Coefficients that a lens lacks and the first camera's place, which is the rig's, never change.
        """
        scale = np.ones_like(self._values)
        scale[:, :4] = self._values[:, :2].mean(axis=1, keepdims=True)  # pixels change by the focal length
        values = self._values + np.where(self._free, of_cameras[:, :N_INTRINSICS], 0.0) * scale
        values[self._one_focal, 1] = values[self._one_focal, 0]
        moves = np.vstack([of_cameras[:, N_INTRINSICS:], of_boards])
        moves[0] = 0.0
        R = Rotation.from_rotvec(moves[:, :3]).as_matrix() @ self._R
        return values, R, self._t_m + moves[:, 3:]


def _whitening(slope: Floats, block: Ints, n_blocks: int) -> Floats:
    """(n_blocks, k, k) of slopes (M, k), each row of which belongs to a block: inverse Cholesky factors."""
    k = slope.shape[1]
    squares = np.zeros((n_blocks, k, k))
    order = np.argsort(block, kind="stable")
    bounds = np.searchsorted(block[order], np.arange(n_blocks + 1))
    for b in range(n_blocks):
        rows = slope[order[bounds[b] : bounds[b + 1]]]
        squares[b] = rows.T @ rows
        size = np.maximum(np.diag(squares[b]), _RIDGE)
        squares[b] += np.diag(np.where(np.diag(squares[b]) > 0, _RIDGE * size, 1.0))
    factors = np.linalg.cholesky(squares)
    return np.asarray(np.linalg.inv(factors).transpose(0, 2, 1), np.float64)
