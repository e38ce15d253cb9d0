"""One damped step of least squares over one shape and many poses, within their bounds."""

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

from services.mocap.body import shape_space
from services.mocap.body.kinematics import N_DOF, clip_to_limits
from services.mocap.types import Floats

ALL_DOFS: tuple[int, ...] = tuple(range(N_DOF))
_WALL, _WALL_ROUNDS = 1e4, 4
"""How stiff bounds are against the data, and how often a step is sought anew because of them."""


@dataclass(frozen=True, eq=False)
class State:
    """The unknowns of a fit."""

    x: Floats
    """(len(PARAMETERS),) the shape vector."""
    poses: Floats
    """(F, D)"""


@dataclass(frozen=True)
class FitStage:
    """One round of a fit from coarse to fine."""

    parameters: tuple[int, ...]
    """The shape parameters that vary."""
    dofs: tuple[int, ...]
    """The pose parameters that vary, in every frame."""
    cap_px: float
    """Scale of the robust loss, in working pixels."""
    steps: int
    """At most."""
    damping: float = 0.1
    """Share of their diagonal by which the normal equations are strengthened (Levenberg, Marquardt)."""
    patience: int = 4
    """A stage ends after this many steps without progress."""
    is_strict: bool = False
    """Whether what is far beyond the cap pulls next to nothing (Geman, McClure), as bites out of silhouettes
    should; else it pulls the less the farther it is (Cauchy), as what is still to be found should."""

    def losses(self, residuals_px: Floats) -> Floats:
        """Cost of residuals (N,), in square working pixels."""
        squares = (residuals_px / self.cap_px) ** 2
        return self.cap_px**2 * (squares / (1.0 + squares) if self.is_strict else np.log1p(squares))

    def weights(self, residuals_px: Floats) -> Floats:
        """(N,) the weights of the residuals' squares."""
        return (1.0 + (residuals_px / self.cap_px) ** 2) ** (-2.0 if self.is_strict else -1.0)


@dataclass(frozen=True, eq=False)
class System:
    """Normal equations in blocks: every frame's pose is coupled with the shape, but not with other poses.

    In place of the shape there may be anything else that all frames share, such as the cameras.
    """

    poses: Floats
    """(F, d, d)"""
    cross: Floats
    """(F, d, s)"""
    shape: Floats
    """(s, s)"""
    pose_slopes: Floats
    """(F, d) half the cost's gradient."""
    shape_slopes: Floats
    """(s,)"""

    def add_frame(self, f: int, sums: Floats, gradient: Floats) -> None:
        """Add a frame: the normal_sums (d + s, d + s), (d + s,) of its residuals by its pose and by shape."""
        d = self.poses.shape[1]
        self.poses[f] += sums[:d, :d]
        self.cross[f] += sums[:d, d:]
        self.shape[...] += sums[d:, d:]
        self.pose_slopes[f] += gradient[:d]
        self.shape_slopes[...] += gradient[d:]

    def shape_information(self) -> Floats:
        """(s, s) information about the shape with free poses: the inverse of its covariance."""
        onto_shape = np.linalg.solve(self.poses, self.cross)
        left: Floats = self.shape - (self.cross.transpose(0, 2, 1) @ onto_shape).sum(axis=0)
        return left

    def free_shape_step(self) -> Floats:
        """(s,) the shape's part of the whole step to the least cost, with no bounds."""
        free, free_poses = np.zeros_like(self.shape_slopes), np.zeros_like(self.pose_slopes)
        return self._solve((free, free), (free_poses, free_poses), damping=0.0)[0]

    def step(
        self, state: State, stage: FitStage, bounds: Callable[[Floats], Floats] = shape_space.clip_to_bounds
    ) -> State:
        """The state after one damped step; parameters that would cross a bound are held there, and the others
        are solved again.

        bounds: moves a shape vector within its bounds.
        """
        parameters, dofs = list(stage.parameters), list(stage.dofs)
        x, poses = state.x.copy(), state.poses.copy()
        shape_walls, pose_walls = np.zeros(len(parameters)), np.zeros((len(poses), len(dofs)))
        for _ in range(_WALL_ROUNDS):
            to_shape_bound = x[parameters] - state.x[parameters]
            to_pose_bound = poses[:, dofs] - state.poses[:, dofs]
            shape_step, pose_steps = self._solve(
                (shape_walls, to_shape_bound), (pose_walls, to_pose_bound), stage.damping
            )
            x[parameters] = state.x[parameters] + shape_step
            poses[:, dofs] = state.poses[:, dofs] + pose_steps
            held, held_poses = bounds(x), clip_to_limits(poses)
            beyond, poses_beyond = held != x, held_poses != poses
            x, poses = held, held_poses
            shape_walls = np.maximum(shape_walls, _WALL * beyond[parameters])
            pose_walls = np.maximum(pose_walls, _WALL * poses_beyond[:, dofs])
            if not (beyond.any() or poses_beyond.any()):
                break
        return State(x, poses)

    def _solve(
        self, shape_walls: tuple[Floats, Floats], pose_walls: tuple[Floats, Floats], damping: float
    ) -> tuple[Floats, Floats]:
        """Shape step (s,) and pose steps (F, d): poses are eliminated, then put back.

        Walls pull a step, with a strength, to a value.
        """
        diagonals = np.diagonal(self.poses, axis1=1, axis2=2)
        strength = pose_walls[0] * diagonals
        poses = self.poses + (damping * diagonals + strength)[:, :, None] * np.eye(diagonals.shape[1])
        slopes = self.pose_slopes - strength * pose_walls[1]
        diagonal = np.diag(self.shape)
        strength = shape_walls[0] * diagonal
        shape = self.shape + np.diag(damping * diagonal + strength)
        solved = np.linalg.solve(poses, np.concatenate([self.cross, slopes[:, :, None]], axis=2))
        onto_shape, onto_slopes = solved[:, :, :-1], solved[:, :, -1]
        transposed = self.cross.transpose(0, 2, 1)
        left = shape - (transposed @ onto_shape).sum(axis=0)
        right = self.shape_slopes - strength * shape_walls[1]
        right = right - (transposed @ onto_slopes[:, :, None]).sum(axis=0)[:, 0]
        shape_step = -np.linalg.solve(left, right)
        return shape_step, -onto_slopes - onto_shape @ shape_step


@numba.njit(cache=True, nogil=True, error_model="numpy")
def normal_sums(rows: Floats, residuals: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """rows' diag(weights) rows (M, M) and rows' diag(weights) residuals (M,) of rows (N, M), mostly zeros.

    Written out, because a library would distribute this small product over cores that other processes use.
    """
    n_columns = rows.shape[1]
    sums, slopes = np.zeros((n_columns, n_columns)), np.zeros(n_columns)
    columns = np.empty(n_columns, np.int64)
    for n in range(len(rows)):
        row, count = rows[n], 0
        for m in range(n_columns):
            if row[m] != 0.0:
                columns[count] = m
                count += 1
        for i in range(count):
            one = columns[i]
            weighted = weights[n] * row[one]
            slopes[one] += weighted * residuals[n]
            for k in range(i + 1):
                sums[one, columns[k]] += weighted * row[columns[k]]
    for i in range(n_columns):
        for k in range(i):
            sums[k, i] = sums[i, k]
    return sums, slopes
