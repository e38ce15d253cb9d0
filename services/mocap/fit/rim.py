"""The model's rim: the outline of its silhouette, and the surface points that produce it.

The outline is extracted from the drawn silhouette exactly as the input's is. So a correct body has zero
residuals despite the pixel grid; the surface is used only for the derivatives.
"""

from dataclasses import dataclass
from functools import cache

import numba
import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.body_mesh import BodyMesh
from services.mocap.body.kinematics import N_RIGID
from services.mocap.body.surface import closed_edges
from services.mocap.camera.rig import Rig
from services.mocap.fit.contours import outline_of
from services.mocap.types import Floats, Ints, Longs, Mask

NEAREST_M = 0.1
"""Nothing is drawn for a camera if the body comes nearer to its plane than this."""


@dataclass(frozen=True, eq=False)
class Topology:
    """All surfaces' meshes as one."""

    starts: Longs
    """(surfaces + 1,) where each one's vertices begin, and their number."""
    faces: Longs
    """(F, 3)"""
    edges: Longs
    """(E, 2) vertices."""
    sides: Ints
    """(2, E) the faces on both sides of an edge."""


@cache
def topology(body_mesh: BodyMesh) -> Topology:
    """That of every actor with this mesh."""
    meshes = body_mesh.surfaces
    starts = np.cumsum([0] + [len(mesh.vertices_heights) for mesh in meshes])
    face_starts = np.cumsum([0] + [len(mesh.faces) for mesh in meshes])
    pairs = [closed_edges(mesh.faces) for mesh in meshes]
    return Topology(
        starts=starts,
        faces=np.vstack([m.faces + s for m, s in zip(meshes, starts[:-1], strict=True)]).astype(np.int64),
        edges=np.vstack([edges[:, :2] + s for (edges, _), s in zip(pairs, starts[:-1], strict=True)]),
        sides=np.hstack(
            [(sides + s).T for (_, sides), s in zip(pairs, face_starts[:-1], strict=True)]
        ).astype(np.int32),
    )


@dataclass(frozen=True, eq=False)
class Rim:
    """One camera's view of the model in one frame."""

    points_px: Floats
    """(N, 2) the outline of its silhouette."""
    normals: Floats
    """(N, 2) unit vectors that point off the model there."""
    edges: Longs
    """(E, 2) mesh edges, as vertices of the whole body, between a front face and a back face; none of webs,
    whose edges are long."""
    middles_px: Floats
    """(E, 2) the middles of their ends."""
    facing: Floats
    """(E, 2) unit vectors that point off the surface there."""


@dataclass(frozen=True, eq=False)
class PosedSurface:
    """A body's surface in one pose."""

    vertices_world_m: Floats
    """(V, 3) of all surfaces."""
    planes: Floats
    """(4, F) unit normal and offset of the faces."""
    mesh: Topology

    @classmethod
    def of(cls, body: Body, pose: Floats) -> "PosedSurface":
        """That of a body in a pose (D,)."""
        mesh = topology(body.mesh)
        vertices_world_m = body.posed_m(pose)
        return cls(vertices_world_m, _planes(vertices_world_m, mesh.faces), mesh)

    def rim(self, rig: Rig, camera: int) -> Rim:
        """One camera's rim; empty if the body reaches the camera's plane."""
        P_px_world, (width_px, height_px) = rig.P_px_world[camera], rig.sizes_px[camera]
        centre_world_m = -np.linalg.solve(P_px_world[:, :3], P_px_world[:, 3])
        edges, middles_px, facing, ends_px = _turning_edges(
            self.vertices_world_m, self.planes, self.mesh.edges, self.mesh.sides,
            self.mesh.starts[N_RIGID], centre_world_m, np.ascontiguousarray(P_px_world),
        )  # fmt: skip
        outline = outline_of(_silhouette(ends_px, int(width_px), int(height_px)))
        return Rim(*outline, edges, middles_px, facing)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _planes(vertices_m: Floats, faces: Longs) -> Floats:
    """(4, F) unit normal and offset of faces."""
    planes = np.zeros((4, len(faces)))
    for f in range(len(faces)):
        a, b, c = vertices_m[faces[f, 0]], vertices_m[faces[f, 1]], vertices_m[faces[f, 2]]
        x = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
        y = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
        z = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        length = max(np.sqrt(x * x + y * y + z * z), 1e-12)
        planes[0, f], planes[1, f], planes[2, f] = x / length, y / length, z / length
        planes[3, f] = (x * a[0] + y * a[1] + z * a[2]) / length
    return planes


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _turning_edges(
    vertices_m: Floats, planes: Floats, edges: Longs, sides: Ints, n_rigid: int, centre_m: Floats, P: Floats
) -> tuple[Longs, Floats, Floats, Floats]:
    """The edges of which a camera sees one side. Of those between the first n_rigid vertices: their ends as
    vertices (E, 2), middles (E, 2) in pixels and normals (E, 2); of all: their ends (N, 2, 2) in pixels.

    Seen from the first end to the second, the front face is always on the same side. Empty if one of them
    reaches the camera's plane.
    """
    # Contiguous rows, and loops without branches: the compiler makes them two to three times as fast.
    normal_x, normal_y, normal_z, offset = planes[0], planes[1], planes[2], planes[3]
    ones, others = sides[0], sides[1]
    front = np.empty(len(offset), np.bool_)
    for f in range(len(offset)):
        towards_m = normal_x[f] * centre_m[0] + normal_y[f] * centre_m[1] + normal_z[f] * centre_m[2]
        front[f] = towards_m > offset[f]
    turning, total = np.empty(len(ones), np.int32), 0
    for e in range(len(ones)):
        turning[total] = e
        total += front[ones[e]] != front[others[e]]
    ends_px, of_rigid = np.empty((total, 2, 2)), np.empty((total, 2), np.int64)
    middles_px, facing, count = np.empty((total, 2)), np.empty((total, 2)), 0
    for n in range(total):
        e = turning[n]
        one, other = ones[e], others[e]
        for k in range(2):
            a, end = edges[e, k], k if front[one] else 1 - k
            ax, ay, az = vertices_m[a, 0], vertices_m[a, 1], vertices_m[a, 2]
            depth = P[2, 0] * ax + P[2, 1] * ay + P[2, 2] * az + P[2, 3]
            if depth <= NEAREST_M:
                return of_rigid[:0].copy(), middles_px[:0].copy(), facing[:0].copy(), ends_px[:0].copy()
            ends_px[n, end, 0] = (P[0, 0] * ax + P[0, 1] * ay + P[0, 2] * az + P[0, 3]) / depth
            ends_px[n, end, 1] = (P[1, 0] * ax + P[1, 1] * ay + P[1, 2] * az + P[1, 3]) / depth
        if edges[e, 0] >= n_rigid:
            continue
        x, y = normal_x[one] + normal_x[other], normal_y[one] + normal_y[other]
        z = normal_z[one] + normal_z[other]
        u, v = (ends_px[n, 0, 0] + ends_px[n, 1, 0]) / 2, (ends_px[n, 0, 1] + ends_px[n, 1, 1]) / 2
        away = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z
        du = P[0, 0] * x + P[0, 1] * y + P[0, 2] * z - u * away
        dv = P[1, 0] * x + P[1, 1] * y + P[1, 2] * z - v * away
        length = max(np.sqrt(du * du + dv * dv), 1e-12)
        of_rigid[count, 0], of_rigid[count, 1] = edges[e, 0], edges[e, 1]
        middles_px[count, 0], middles_px[count, 1] = u, v
        facing[count, 0], facing[count, 1] = du / length, dv / length
        count += 1
    return of_rigid[:count].copy(), middles_px[:count].copy(), facing[:count].copy(), ends_px


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _silhouette(ends_px: Floats, width_px: int, height_px: int) -> Mask:
    """(H, W) the pixels whose centres are covered by the surface: those inside the edges (N, 2, 2)."""
    mask = np.zeros((height_px, width_px), np.bool_)
    if len(ends_px) == 0:
        return mask
    # Only between the outermost edges: pictures are large.
    left = int(min(max(np.ceil(ends_px[:, :, 0].min()), 0.0), width_px))
    right = int(min(max(np.ceil(ends_px[:, :, 0].max()), 0.0), width_px))
    top = int(min(max(np.ceil(ends_px[:, :, 1].min()), 0.0), height_px))
    bottom = int(min(max(np.ceil(ends_px[:, :, 1].max()), 0.0), height_px))
    turns = np.zeros((bottom - top, right - left + 1), np.int16)
    for n in range(len(ends_px)):
        x0, y0, x1, y1 = ends_px[n, 0, 0], ends_px[n, 0, 1], ends_px[n, 1, 0], ends_px[n, 1, 1]
        way = 1
        if y1 < y0:
            x0, y0, x1, y1, way = x1, y1, x0, y0, -1
        for y in range(max(int(np.ceil(y0)), top), min(int(np.ceil(y1)), bottom)):
            x = x0 + (x1 - x0) * (y - y0) / (y1 - y0)
            turns[y - top, int(min(max(np.ceil(x), left), right)) - left] += way
    for y in range(top, bottom):
        total = 0
        for x in range(left, right):
            total += turns[y - top, x - left]
            mask[y, x] = total != 0
    return mask
