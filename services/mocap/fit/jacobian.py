"""The Jacobian of the rim in the pictures by pose and shape."""

from dataclasses import dataclass

import numba
import numpy as np

from services.mocap.body import shape_space
from services.mocap.body.actor import Actor, Body
from services.mocap.body.kinematics import N_DOF, SEGMENT_JOINTS, joint_transforms
from services.mocap.body.skeleton import JOINT_INDEX, JOINTS
from services.mocap.camera.rig import Rig
from services.mocap.fit.matching import Matches
from services.mocap.fit.rim import Indices, topology
from services.mocap.types import Floats, Ints

_STEP = 1e-4
"""Of finite differences, in radians, metres and logarithms."""


@dataclass(frozen=True, eq=False)
class ShapeSlopes:
    """A body, and its derivatives by S shape parameters."""

    body: Body
    vertices_m: Floats
    """(V, 3) all segments' vertices, each in its segment's frame."""
    vertex_slopes_m: Floats
    """(V, S, 3)"""
    offset_slopes_m: Floats
    """(S, J, 3)"""

    @classmethod
    def at(
        cls, x: Floats, parameters: tuple[int, ...], base: Actor = shape_space.GENERIC_ACTOR
    ) -> "ShapeSlopes":
        """By differences from the shape vector x (len(PARAMETERS),), with the mesh and the skirt of base."""
        body = shape_space.body_of(x, base)
        vertices_m = np.vstack(body.vertices_m)
        vertex_slopes_m = np.empty((len(vertices_m), len(parameters), 3))
        offset_slopes_m = np.empty((len(parameters), len(JOINTS), 3))
        for k, parameter in enumerate(parameters):
            moved = x.copy()
            moved[parameter] += _STEP
            other = shape_space.body_of(moved, base)
            vertex_slopes_m[:, k] = (np.vstack(other.vertices_m) - vertices_m) / _STEP
            offset_slopes_m[k] = (other.offsets_m - body.offsets_m) / _STEP
        return cls(body, vertices_m, vertex_slopes_m, offset_slopes_m)


def jacobian(slopes: ShapeSlopes, pose: Floats, rig: Rig, matches: list[Matches]) -> Floats:
    """(N, D + S) slopes of all residuals of a frame, camera after camera, by pose and then by shape."""
    moved = np.vstack([pose[None], pose + _STEP * np.eye(N_DOF)])
    T_world_joint = joint_transforms(moved, slopes.body.offsets_m)
    T, T_slopes = T_world_joint[0], (T_world_joint[1:] - T_world_joint[0]) / _STEP
    rows: Floats = np.zeros((sum(len(m.edges) for m in matches), N_DOF + len(slopes.offset_slopes_m)))
    shifts_m, starts, first = _joint_shifts(T, slopes.offset_slopes_m), topology(slopes.body.mesh).starts, 0
    for view, P_px_world in zip(matches, rig.P_px_world, strict=True):
        joints = SEGMENT_JOINTS[np.searchsorted(starts, view.edges[:, 0], side="right") - 1]
        _fill(
            view.edges, joints, view.points_px, view.normals, np.ascontiguousarray(P_px_world), T, T_slopes,
            slopes.vertices_m, slopes.vertex_slopes_m, shifts_m, rows[first : first + len(joints)],
        )  # fmt: skip
        first += len(joints)
    return rows


def _joint_shifts(T_world_joint: Floats, offset_slopes_m: Floats) -> Floats:
    """(S, J, 3) derivative of the joints in the world by the shape, for a fixed pose."""
    shifts_m = np.zeros_like(offset_slopes_m)
    for j, joint in enumerate(JOINTS):  # parents precede children
        if joint.parent is None:
            shifts_m[:, j] = offset_slopes_m[:, j]
        else:
            parent = JOINT_INDEX[joint.parent]
            shifts_m[:, j] = shifts_m[:, parent] + offset_slopes_m[:, j] @ T_world_joint[parent, :3, :3].T
    return shifts_m


@numba.njit(cache=True, nogil=True)
def _fill(
    edges: Indices,
    joints: Ints,
    points_px: Floats,
    normals: Floats,
    P: Floats,
    T_world_joint: Floats,
    T_slopes: Floats,
    vertices_m: Floats,
    vertex_slopes_m: Floats,
    shifts_m: Floats,
    rows: Floats,
) -> None:
    """Write one view's rows (N, D + S)."""
    n_dofs = len(T_slopes)
    point, g, local = np.empty(3), np.empty(3), np.empty(3)
    for n in range(len(edges)):
        a, b, j = edges[n, 0], edges[n, 1], joints[n]
        T = T_world_joint[j]
        depth = P[2, 3]
        for i in range(3):
            point[i] = (vertices_m[a, i] + vertices_m[b, i]) / 2
        for i in range(3):
            depth += P[2, i] * (T[i, 0] * point[0] + T[i, 1] * point[1] + T[i, 2] * point[2] + T[i, 3])
        u, v = normals[n, 0] / depth, normals[n, 1] / depth
        along = u * points_px[n, 0] + v * points_px[n, 1]
        for i in range(3):
            g[i] = u * P[0, i] + v * P[1, i] - along * P[2, i]
        for i in range(3):
            local[i] = (g[0] * T[0, i] + g[1] * T[1, i] + g[2] * T[2, i]) / 2
        for d in range(n_dofs):
            D, slope = T_slopes[d, j], 0.0
            for i in range(3):
                slope += g[i] * (D[i, 0] * point[0] + D[i, 1] * point[1] + D[i, 2] * point[2] + D[i, 3])
            rows[n, d] = slope
        for k in range(len(shifts_m)):
            slope = 0.0
            for i in range(3):
                slope += (
                    local[i] * (vertex_slopes_m[a, k, i] + vertex_slopes_m[b, k, i])
                    + g[i] * shifts_m[k, j, i]
                )
            rows[n, n_dofs + k] = slope


@numba.njit(cache=True, nogil=True)
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
