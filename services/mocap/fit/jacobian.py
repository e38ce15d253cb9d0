"""The Jacobian of the rim in the pictures by pose and shape."""

from dataclasses import dataclass, replace

import numpy as np

from services.mocap.body import shape_space
from services.mocap.body.actor import Actor, Body
from services.mocap.body.cloth_frames import PELVIS
from services.mocap.body.kinematics import HANGING, N_DOF, N_FRAMES, SURFACE_FRAMES, frame_transforms
from services.mocap.body.skeleton import JOINT_INDEX, JOINTS
from services.mocap.camera.rig import Rig
from services.mocap.fit.rim import topology
from services.mocap.fit.rim_matching import Matches
from services.mocap.njit import njit_without_refcounts
from services.mocap.types import Floats, Ints, Longs

_STEP = 1e-4
"""Of finite differences, in radians, metres and logarithms."""
_NEAR = 0.01
"""Derivatives are computed again only if a shape parameter, a logarithm, has changed by more than this since:
lengths scale with the factors, so that a change of 1 % changes their derivatives by about 1 %."""


@dataclass(frozen=True, eq=False)
class ShapeSlopes:
    """A body, and its derivatives by S shape parameters."""

    parameters: tuple[int, ...]
    taken_at: Floats
    """(len(PARAMETERS),) the shape vector of the derivatives: the body's, or one near it."""
    body: Body
    vertices_m: Floats
    """(V, 3) all surfaces' vertices, each in its own frame."""
    vertex_slopes_m: Floats
    """(V, S, 3)"""
    offset_slopes_m: Floats
    """(S, J or J + 1, 3)"""

    @classmethod
    def at(
        cls, x: Floats, parameters: tuple[int, ...], base: Actor = shape_space.GENERIC_ACTOR
    ) -> "ShapeSlopes":
        """By differences from the shape vector x (len(PARAMETERS),), with the mesh and what base wears."""
        body = shape_space.body_of(x, base)
        vertices_m, starts = _vertices_m(body), topology(body.mesh).starts[:-1]
        vertex_slopes_m = np.zeros((len(vertices_m), len(parameters), 3))
        offset_slopes_m = np.empty((len(parameters), *body.offsets_m.shape))
        for k, parameter in enumerate(parameters):
            moved = x.copy()
            moved[parameter] += _STEP
            other = shape_space.body_of(moved, base)
            for start, (here_m, _), (there_m, _) in zip(starts, body.surfaces, other.surfaces, strict=True):
                if not np.array_equal(here_m, there_m):  # most parameters move few surfaces
                    vertex_slopes_m[start : start + len(here_m), k] = (there_m - here_m) / _STEP
            offset_slopes_m[k] = (other.offsets_m - body.offsets_m) / _STEP
        return cls(parameters, x, body, vertices_m, vertex_slopes_m, offset_slopes_m)

    def near(self, x: Floats, base: Actor) -> "ShapeSlopes":
        """Those of a shape vector (len(PARAMETERS),): its own body, with these derivatives if it is near the
        shape that they were taken at."""
        if np.abs(x - self.taken_at).max() > _NEAR:
            return ShapeSlopes.at(x, self.parameters, base)
        body = shape_space.body_of(x, base)
        return replace(self, body=body, vertices_m=_vertices_m(body))


def _vertices_m(body: Body) -> Floats:
    return np.vstack([vertices_m for vertices_m, _ in body.surfaces])


def jacobian(slopes: ShapeSlopes, pose: Floats, rig: Rig, matches: list[Matches]) -> Floats:
    """(N, D + S) slopes of all residuals of a frame, camera after camera, by pose and then by shape."""
    moved = np.vstack([pose[None], pose + _STEP * np.eye(N_DOF)])
    T_world_frame = frame_transforms(moved, slopes.body.offsets_m)
    T, T_slopes = T_world_frame[0], (T_world_frame[1:] - T_world_frame[0]) / _STEP
    rows: Floats = np.zeros((sum(len(m.edges) for m in matches), N_DOF + len(slopes.offset_slopes_m)))
    shifts_m, starts, first = _frame_shifts(T, slopes.offset_slopes_m), topology(slopes.body.mesh).starts, 0
    for view, P_px_world in zip(matches, rig.P_px_world, strict=True):
        frames = SURFACE_FRAMES[np.searchsorted(starts, view.edges[:, 0], side="right") - 1]
        _fill(
            view.edges, frames, view.points_px, view.normals, np.ascontiguousarray(P_px_world), T, T_slopes,
            slopes.vertices_m, slopes.vertex_slopes_m, shifts_m, rows[first : first + len(frames)],
        )  # fmt: skip
        first += len(frames)
    return rows


def _frame_shifts(T_world_frame: Floats, offset_slopes_m: Floats) -> Floats:
    """(S, J + 5, 3) derivative of the frames' origins in the world by the shape, for a fixed pose;
    zeros for webs of cloth, whose rim is not matched."""
    shifts_m: Floats = np.zeros((len(offset_slopes_m), N_FRAMES, 3))
    for j, joint in enumerate(JOINTS):  # parents precede children
        if joint.parent is None:
            shifts_m[:, j] = offset_slopes_m[:, j]
        else:
            parent = JOINT_INDEX[joint.parent]
            shifts_m[:, j] = shifts_m[:, parent] + offset_slopes_m[:, j] @ T_world_frame[parent, :3, :3].T
    shifts_m[:, HANGING] = shifts_m[:, PELVIS]
    return shifts_m


@njit_without_refcounts
def _fill(
    edges: Longs,
    frames: Ints,
    points_px: Floats,
    normals: Floats,
    P: Floats,
    T_world_frame: Floats,
    T_slopes: Floats,
    vertices_m: Floats,
    vertex_slopes_m: Floats,
    shifts_m: Floats,
    rows: Floats,
) -> None:
    """Write one view's rows (N, D + S)."""
    n_dofs = len(T_slopes)
    for n in range(len(edges)):
        a, b, j = edges[n, 0], edges[n, 1], frames[n]
        T = T_world_frame[j]
        x = (vertices_m[a, 0] + vertices_m[b, 0]) / 2
        y = (vertices_m[a, 1] + vertices_m[b, 1]) / 2
        z = (vertices_m[a, 2] + vertices_m[b, 2]) / 2
        depth = P[2, 3]
        for i in range(3):
            depth += P[2, i] * (T[i, 0] * x + T[i, 1] * y + T[i, 2] * z + T[i, 3])
        u, v = normals[n, 0] / depth, normals[n, 1] / depth
        along = u * points_px[n, 0] + v * points_px[n, 1]
        g0 = u * P[0, 0] + v * P[1, 0] - along * P[2, 0]
        g1 = u * P[0, 1] + v * P[1, 1] - along * P[2, 1]
        g2 = u * P[0, 2] + v * P[1, 2] - along * P[2, 2]
        for d in range(n_dofs):
            D = T_slopes[d, j]
            slope = g0 * (D[0, 0] * x + D[0, 1] * y + D[0, 2] * z + D[0, 3])
            slope += g1 * (D[1, 0] * x + D[1, 1] * y + D[1, 2] * z + D[1, 3])
            slope += g2 * (D[2, 0] * x + D[2, 1] * y + D[2, 2] * z + D[2, 3])
            rows[n, d] = slope
        local0 = (g0 * T[0, 0] + g1 * T[1, 0] + g2 * T[2, 0]) / 2
        local1 = (g0 * T[0, 1] + g1 * T[1, 1] + g2 * T[2, 1]) / 2
        local2 = (g0 * T[0, 2] + g1 * T[1, 2] + g2 * T[2, 2]) / 2
        for k in range(len(shifts_m)):
            slope = local0 * (vertex_slopes_m[a, k, 0] + vertex_slopes_m[b, k, 0]) + g0 * shifts_m[k, j, 0]
            slope += local1 * (vertex_slopes_m[a, k, 1] + vertex_slopes_m[b, k, 1]) + g1 * shifts_m[k, j, 1]
            slope += local2 * (vertex_slopes_m[a, k, 2] + vertex_slopes_m[b, k, 2]) + g2 * shifts_m[k, j, 2]
            rows[n, n_dofs + k] = slope
