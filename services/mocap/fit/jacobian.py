"""How the rim moves in the pictures when the pose or the shape changes."""

from dataclasses import dataclass

import numpy as np

from services.mocap.body import shape_space
from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF, SEGMENT_JOINTS, joint_transforms
from services.mocap.body.skeleton import JOINT_INDEX, JOINTS, SEGMENT_NAMES
from services.mocap.camera.rig import Rig
from services.mocap.fit.matching import Matches
from services.mocap.fit.rim import Indices, topology
from services.mocap.types import Floats

_STEP = 1e-4
"""Of finite differences, in radians, metres and logarithms."""


@dataclass(frozen=True, eq=False)
class ShapeSlopes:
    """A body, and its change with S of the shape parameters."""

    body: Body
    vertices_m: Floats
    """(V, 3) all segments' vertices, each in its segment's frame."""
    vertex_slopes_m: Floats
    """(S, V, 3)"""
    offset_slopes_m: Floats
    """(S, 17, 3)"""

    @classmethod
    def at(cls, x: Floats, parameters: tuple[int, ...]) -> "ShapeSlopes":
        """By differences from the shape vector x (len(PARAMETERS),)."""
        body = shape_space.body_of(x)
        vertices_m = np.vstack(body.vertices_m)
        vertex_slopes_m = np.empty((len(parameters), *vertices_m.shape))
        offset_slopes_m = np.empty((len(parameters), len(JOINTS), 3))
        for k, parameter in enumerate(parameters):
            moved = x.copy()
            moved[parameter] += _STEP
            other = shape_space.body_of(moved)
            vertex_slopes_m[k] = (np.vstack(other.vertices_m) - vertices_m) / _STEP
            offset_slopes_m[k] = (other.offsets_m - body.offsets_m) / _STEP
        return cls(body, vertices_m, vertex_slopes_m, offset_slopes_m)


def jacobians(slopes: ShapeSlopes, pose: Floats, rig: Rig, matches: list[Matches]) -> tuple[Floats, Floats]:
    """Slopes of all residuals of a frame, camera after camera: (N, 35) by pose, (N, S) by shape."""
    moved = np.vstack([pose[None], pose + _STEP * np.eye(N_DOF)])
    T_world_joint = joint_transforms(moved, slopes.body.offsets_m)
    T, dT_pose = T_world_joint[0], (T_world_joint[1:] - T_world_joint[0]) / _STEP
    shifts_m = _joint_shifts(T, slopes.offset_slopes_m)
    edges = np.vstack([m.edges for m in matches])
    gradients = np.vstack([_gradients(m, P, slopes, T) for m, P in zip(matches, rig.P_px_world, strict=True)])
    by_pose, by_shape = np.empty((len(edges), N_DOF)), np.empty((len(edges), len(slopes.vertex_slopes_m)))
    segments = _segments_of(edges)
    for s in range(len(SEGMENT_NAMES)):
        rows = np.flatnonzero(segments == s)
        if len(rows) == 0:
            continue
        g, joint = gradients[rows], SEGMENT_JOINTS[s]
        points = np.column_stack([slopes.vertices_m[edges[rows]].mean(axis=1), np.ones(len(rows))])
        products = (g[:, :, None] * points[:, None, :]).reshape(len(rows), 12)
        by_pose[rows] = products @ dT_pose[:, joint, :3].reshape(N_DOF, 12).T
        local = slopes.vertex_slopes_m[:, edges[rows]].mean(axis=2)
        by_shape[rows] = np.einsum("ni,kni->nk", g @ T[joint, :3, :3], local, optimize=True)
        by_shape[rows] += g @ shifts_m[:, joint].T
    return by_pose, by_shape


def _gradients(matches: Matches, P_px_world: Floats, slopes: ShapeSlopes, T_world_joint: Floats) -> Floats:
    """(N, 3) how a view's residuals change with the world position of their rim points."""
    joints = SEGMENT_JOINTS[_segments_of(matches.edges)]
    middle_m = slopes.vertices_m[matches.edges].mean(axis=1)
    world_m = np.einsum("nij,nj->ni", T_world_joint[joints, :3, :3], middle_m) + T_world_joint[joints, :3, 3]
    depth = world_m @ P_px_world[2, :3] + P_px_world[2, 3]
    n = matches.normals / depth[:, None]
    along = np.einsum("ni,ni->n", n, matches.points_px)
    gradients: Floats = n @ P_px_world[:2, :3] - along[:, None] * P_px_world[2, :3]
    return gradients


def _joint_shifts(T_world_joint: Floats, offset_slopes_m: Floats) -> Floats:
    """(S, 17, 3) how the joints move in the world when the shape changes and the pose stays."""
    shifts_m = np.zeros_like(offset_slopes_m)
    for j, joint in enumerate(JOINTS):  # parents precede children
        if joint.parent is None:
            shifts_m[:, j] = offset_slopes_m[:, j]
        else:
            parent = JOINT_INDEX[joint.parent]
            shifts_m[:, j] = shifts_m[:, parent] + offset_slopes_m[:, j] @ T_world_joint[parent, :3, :3].T
    return shifts_m


def _segments_of(edges: Indices) -> Indices:
    """(N,) the segment of each edge."""
    return np.searchsorted(topology().starts, edges[:, 0], side="right") - 1
