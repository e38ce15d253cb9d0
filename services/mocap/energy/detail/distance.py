"""Compiled distances from points to triangle meshes, which stand in trees of boxes."""

from math import sqrt
from typing import TypeAlias

import numba
import numpy as np

from services.mocap.types import Floats, Ints

Tree: TypeAlias = tuple[Floats, Floats, Ints]
"""(F, 3, 3) triangle corners in the tree's order; (N, 6) boxes of its nodes, low then high; (N, 3) first
triangle, last + 1 and right child of each node, which is 0 for a leaf. The left child is the next node."""
_LEAF = 4  # triangles
DEPTH = 64
"""Nodes of a tree that wait at most while it is searched: what the scratch of nearest has room for."""


def tree_of(vertices_m: Floats, faces: Ints) -> Tree:
    """Put the triangles of a mesh into a tree of boxes."""
    corners_m = vertices_m[faces]
    order, boxes_m, nodes = _split(corners_m)
    return np.ascontiguousarray(corners_m[order]), boxes_m, nodes


@numba.njit(cache=True, nogil=True)
def _split(corners_m: Floats) -> tuple[Ints, Floats, Ints]:
    """Halve triangles (F, 3, 3) at their median along the widest axis until few are left."""
    n = len(corners_m)
    order = np.arange(n).astype(np.int32)
    centres = np.empty((n, 3))
    for f in range(n):
        for k in range(3):
            centres[f, k] = (corners_m[f, 0, k] + corners_m[f, 1, k] + corners_m[f, 2, k]) / 3.0
    boxes_m, nodes = np.empty((2 * n + 1, 6)), np.zeros((2 * n + 1, 3), np.int32)
    stack = np.empty((DEPTH, 3), np.int32)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, n, -1
    waiting, n_nodes = 1, 0
    while waiting:
        waiting -= 1
        first, last, parent = stack[waiting]
        node, n_nodes = n_nodes, n_nodes + 1
        nodes[node, 0], nodes[node, 1] = first, last
        if parent >= 0:
            nodes[parent, 2] = node
        axis = _bound(corners_m, centres, order[first:last], boxes_m[node])
        if last - first > _LEAF:
            middle = (first + last) // 2
            mine = order[first:last].copy()
            order[first:last] = mine[np.argsort(centres[mine, axis], kind="mergesort")]
            stack[waiting, 0], stack[waiting, 1], stack[waiting, 2] = middle, last, node
            stack[waiting + 1, 0], stack[waiting + 1, 1], stack[waiting + 1, 2] = first, middle, -1
            waiting += 2
    return order, boxes_m[:n_nodes].copy(), nodes[:n_nodes].copy()


@numba.njit(cache=True, nogil=True)
def _bound(corners_m: Floats, centres_m: Floats, members: Ints, box_m: Floats) -> int:
    """Write the box of the members; returns the axis along which their centres spread most."""
    axis, widest = 0, -1.0
    for k in range(3):
        low, high, first, last = np.inf, -np.inf, np.inf, -np.inf
        for f in members:
            for i in range(3):
                low, high = min(low, corners_m[f, i, k]), max(high, corners_m[f, i, k])
            first, last = min(first, centres_m[f, k]), max(last, centres_m[f, k])
        box_m[k], box_m[3 + k] = low, high
        if last - first > widest:
            axis, widest = k, last - first
    return axis


@numba.njit(cache=True, nogil=True, error_model="numpy")
def closest(x: float, y: float, z: float, t: Floats) -> tuple[float, float, float]:
    """The weights of corners 1 and 2 in the point of triangle t (3, 3) closest to (x, y, z), and its squared
    distance; after Ericson, Real-Time Collision Detection (2005), 5.1.5."""
    ax, ay, az = t[0, 0], t[0, 1], t[0, 2]
    ux, uy, uz = t[1, 0] - ax, t[1, 1] - ay, t[1, 2] - az
    vx, vy, vz = t[2, 0] - ax, t[2, 1] - ay, t[2, 2] - az
    px, py, pz = x - ax, y - ay, z - az
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    d1, d2 = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
    v, w = _weights(uu, uv, vv, d1, d2)
    dx, dy, dz = px - v * ux - w * vx, py - v * uy - w * vy, pz - v * uz - w * vz
    return v, w, dx * dx + dy * dy + dz * dz


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _weights(uu: float, uv: float, vv: float, d1: float, d2: float) -> tuple[float, float]:
    """Weights of the sides u and v in the point closest to p, from the products uu, uv, vv, up and vp."""
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0
    d3, d4 = d1 - uu, d2 - uv
    if d3 >= 0.0 and d4 <= d3:
        return 1.0, 0.0
    d5, d6 = d1 - uv, d2 - vv
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 1.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and uu > 0.0:
        return d1 / (d1 - d3), 0.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return 0.0, d2 / (d2 - d6)
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 1.0 - w, w
    if not (
        va > 0.0 and vb > 0.0 and vc > 0.0
    ):  # a triangle without area, and rounding: any corner is no lie
        return 0.0, 0.0
    return vb / (va + vb + vc), vc / (va + vb + vc)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def nearest(x: float, y: float, z: float, tree: Tree, hint: int, stack: Ints) -> tuple[int, float]:
    """The triangle of a tree that is nearest to (x, y, z), and its squared distance.

    hint: one that may be near. stack (DEPTH,) is scratch.
    """
    corners_m, boxes_m, nodes = tree
    best, best_sq = hint, closest(x, y, z, corners_m[hint])[2]
    stack[0], waiting = 0, 1
    while waiting:
        waiting -= 1
        node = stack[waiting]
        if _box_sq(x, y, z, boxes_m[node]) >= best_sq:
            continue
        right = nodes[node, 2]
        if right == 0:
            for t in range(nodes[node, 0], nodes[node, 1]):
                distance_sq = closest(x, y, z, corners_m[t])[2]
                if distance_sq < best_sq:
                    best, best_sq = t, distance_sq
            continue
        left_first = _box_sq(x, y, z, boxes_m[node + 1]) <= _box_sq(x, y, z, boxes_m[right])
        stack[waiting] = right if left_first else node + 1
        stack[waiting + 1] = node + 1 if left_first else right
        waiting += 2
    return best, best_sq


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _box_sq(x: float, y: float, z: float, box_m: Floats) -> float:
    dx = max(box_m[0] - x, x - box_m[3], 0.0)
    dy = max(box_m[1] - y, y - box_m[4], 0.0)
    dz = max(box_m[2] - z, z - box_m[5], 0.0)
    return float(dx * dx + dy * dy + dz * dz)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def farthest_point(points_m: Floats, tree: Tree) -> float:
    """How far the farthest of points (V, 3) lies from a tree's surface."""
    farthest_sq, hint, stack = 0.0, 0, np.empty(DEPTH, np.int32)
    for i in range(len(points_m)):
        hint, distance_sq = nearest(points_m[i, 0], points_m[i, 1], points_m[i, 2], tree, hint, stack)
        farthest_sq = max(farthest_sq, distance_sq)
    return float(sqrt(farthest_sq))
