"""The model's rim: points of its surface that lie on the outline of its silhouette in a camera's picture."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import segment_transforms
from services.mocap.body.shape import generic_segments
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import camera_bit
from services.mocap.energy.detail.surface import closed_edges
from services.mocap.fit.contours import off_border
from services.mocap.types import Bytes, Floats, Ints

_STEP_OFF_PX = 1.0
"""This far off the surface, an outline point of the whole silhouette is off the model."""
_NEAREST_M = 0.1
"""Points nearer to a camera's plane are left out."""

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Topology:
    """All segments' meshes as one."""

    starts: Indices
    """(17,) where each segment's vertices begin, and their number."""
    faces: Indices
    """(F, 3)"""
    edges: Indices
    """(E, 2) vertices."""
    sides: Indices
    """(E, 2) the faces on both sides of an edge."""


@cache
def topology() -> Topology:
    """The generic body's, and so that of every actor."""
    meshes = generic_segments()
    starts = np.cumsum([0] + [len(mesh.vertices_heights) for mesh in meshes])
    face_starts = np.cumsum([0] + [len(mesh.faces) for mesh in meshes])
    pairs = [closed_edges(mesh.faces) for mesh in meshes]
    return Topology(
        starts=starts,
        faces=np.vstack([m.faces + s for m, s in zip(meshes, starts[:-1], strict=True)]),
        edges=np.vstack([edges[:, :2] + s for (edges, _), s in zip(pairs, starts[:-1], strict=True)]),
        sides=np.vstack([sides + s for (_, sides), s in zip(pairs, face_starts[:-1], strict=True)]),
    )


@dataclass(frozen=True, eq=False)
class Rim:
    """One camera's rim points in one frame: midpoints of mesh edges."""

    edges: Indices
    """(N, 2) vertices of the whole body."""
    points_px: Floats
    """(N, 2)"""
    normals: Floats
    """(N, 2) unit vectors that point off the model."""
    lengths_px: Floats
    """(N,) of outline that each stands for."""


def find_rims(body: Body, pose: Floats, rig: Rig, coverage: Bytes) -> list[Rim]:
    """Every camera's rim of a body in a pose (35,), whose silhouettes are the bit-planes (P, H, W)."""
    mesh = topology()
    T_world_segment = segment_transforms(pose[None], body.offsets_m)[0]
    vertices_world_m = np.vstack(
        [v @ T[:3, :3].T + T[:3, 3] for v, T in zip(body.vertices_m, T_world_segment, strict=True)]
    )
    a, b, c = (vertices_world_m[corner] for corner in mesh.faces.T)
    normals_world = np.cross(b - a, c - a)
    normals_world /= np.maximum(np.linalg.norm(normals_world, axis=1, keepdims=True), 1e-12)
    planes_m = np.einsum("fi,fi->f", normals_world, a)
    rims = []
    for camera, P_px_world in enumerate(rig.P_px_world):
        centre_world_m = -np.linalg.solve(P_px_world[:, :3], P_px_world[:, 3])
        front = normals_world @ centre_world_m > planes_m
        outline = np.flatnonzero(front[mesh.sides[:, 0]] != front[mesh.sides[:, 1]])
        outward_world = normals_world[mesh.sides[outline]].sum(axis=1)
        silhouette = camera_bit(coverage, camera)
        rims.append(
            _rim(
                mesh.edges[outline],
                vertices_world_m,
                outward_world,
                P_px_world,
                silhouette,
                rig.sizes_px[camera],
            )
        )
    return rims


def _rim(
    edges: Indices,
    vertices_world_m: Floats,
    outward_world: Floats,
    P_px_world: Floats,
    silhouette: NDArray[np.bool_],
    size_px: Ints,
) -> Rim:
    """The midpoints of edges that lie on the outline of the whole silhouette."""
    ends = vertices_world_m[edges]
    ends_px, depth_m = project(ends, P_px_world)
    middle_px, _ = project(ends.mean(axis=1), P_px_world)
    normals = outward_world @ P_px_world[:2, :3].T - middle_px * (outward_world @ P_px_world[2, :3])[:, None]
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    off = np.rint(middle_px + _STEP_OFF_PX * normals)
    kept = (depth_m.min(axis=1) > _NEAREST_M) & off_border(off, size_px)
    at = np.where(kept[:, None], off, 0).astype(np.int64)
    kept &= ~silhouette[at[:, 1], at[:, 0]]
    along = ends_px[:, 1] - ends_px[:, 0]  # edges zigzag about the outline: what counts is their way along it
    lengths_px = np.abs(along[:, 0] * normals[:, 1] - along[:, 1] * normals[:, 0])
    return Rim(edges[kept], middle_px[kept], normals[kept], lengths_px[kept])


def project(points_world_m: Floats, P_px_world: Floats) -> tuple[Floats, Floats]:
    """Pixels (…, 2) and depths (…) of points (…, 3); pixels of points behind the camera mean nothing."""
    homogeneous = points_world_m @ P_px_world[:, :3].T + P_px_world[:, 3]
    depth = homogeneous[..., 2]
    ahead = np.where(depth > _NEAREST_M, depth, 1.0)
    return homogeneous[..., :2] / ahead[..., None], depth
