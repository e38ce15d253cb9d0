"""Compiled painting of colour classes: what a camera sees of a body, and how much of that is wrong.

Surfaces are painted one by one, each as far away as its middle (painter's algorithm, by segments): what is
nearer to the camera hides what is farther.
"""

from typing import TypeAlias

import numba
import numpy as np

from services.mocap.body.kinematics import SURFACE_FRAMES, place_frames
from services.mocap.energy.cpu.collecting import Canvas, row_spans
from services.mocap.energy.cpu.outline import MeshArrays, Scratch, draw
from services.mocap.energy.snapping import NEAR_M
from services.mocap.njit import njit_without_refcounts
from services.mocap.types import Bytes, Floats, Ints, Singles

Coat: TypeAlias = tuple[Bytes, Floats, Floats]
"""What surfaces are painted with: the class of each quarter (S + 5, QUARTERS); near end, middle and far end
of each surface in its frame (S + 5, 3, 3); how much nearer to the camera than its middle it counts
(S + 5,)."""
Rest: TypeAlias = tuple[Bytes, Singles]
"""What is painted already: its classes (C, h, w) and how far away it is (C, h, w), infinite for nothing."""
Room: TypeAlias = tuple[Ints, Floats, Floats, Ints]
"""What painting needs room for: an order (K,) and the distances (K,) of K surfaces, a line (3,), and from and
to where each row was painted (h, 2)."""
Layers: TypeAlias = tuple[Bytes, Bytes, Singles]
"""One camera's classes of the input, the painted ones, and how far what is painted is away, all (h, w)."""
Drawing: TypeAlias = tuple[float, MeshArrays, Scratch, Canvas, Room]
"""The level of detail in pixels, and what drawing takes."""
_SHORTEST_PX2 = 1e-9
"""Of a surface that a camera sees along its axis."""


def room_for(n_surfaces: int, height_px: int) -> Room:
    """What painting so many surfaces needs room for."""
    spans = np.zeros((height_px, 2), np.int32)
    return np.zeros(n_surfaces, np.int32), np.zeros(n_surfaces), np.zeros(3), spans


@njit_without_refcounts
def paint(
    T_world_frame: Floats,
    surfaces: Ints,
    coat: Coat,
    cameras: tuple[Floats, Floats, Floats],
    drawing: Drawing,
    everywhere: Bytes,
    rest: Rest,
) -> None:
    """Paint surfaces of one pose over what is painted already; T_world_frame (J + 5, 4, 4).

    cameras: projections (C, 3, 4), lenses, and centres in the world (C, 3). everywhere (h, w): ones.
    """
    for c in range(len(cameras[0])):
        layers = (everywhere, rest[0][c], rest[1][c])
        _paint_view(c, T_world_frame, surfaces, coat, cameras, drawing, layers, True)


@njit_without_refcounts
def count_wrong(
    values: Floats,
    plan: tuple[Ints, Ints, Ints],
    pose: Floats,
    T_world_frame: Floats,
    offsets_m: Floats,
    coat: Coat,
    cameras: tuple[Floats, Floats, Floats],
    drawing: Drawing,
    rest: Rest,
    painted: Bytes,
    seen: Bytes,
    weights: Floats,
    wrong_px: Floats,
) -> None:
    """Write how many more pixels (N,) have a wrong class than of the rest, for values (N, d) as in evaluate.

    seen (C, h, w): the input's classes. A pixel is wrong if it has one class there and another one of the
    body. weights (C,): of the cameras. painted: a copy of the rest's classes, and again so at the end.
    """
    dofs, frames, surfaces = plan
    painted_rows = drawing[4][3]
    for n in range(len(values)):
        for k in range(len(dofs)):
            pose[dofs[k]] = values[n, k]
        place_frames(pose, offsets_m, frames, T_world_frame)
        total = 0.0
        for c in range(len(weights)):
            if weights[c] == 0.0:
                continue
            layers = (seen[c], painted[c], rest[1][c])
            more = _paint_view(c, T_world_frame, surfaces, coat, cameras, drawing, layers, False)
            for row in range(len(painted_rows)):
                for x in range(painted_rows[row, 0], painted_rows[row, 1]):
                    painted[c, row, x] = rest[0][c, row, x]
            total += weights[c] * more
        wrong_px[n] = total


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _paint_view(
    c: int,
    T_world_frame: Floats,
    surfaces: Ints,
    coat: Coat,
    cameras: tuple[Floats, Floats, Floats],
    drawing: Drawing,
    layers: Layers,
    keeps: bool,
) -> int:
    """Paint surfaces as camera c sees them, and return how many more pixels are wrong then; keeps: the layer
    of distances is updated too."""
    P_px_world, lenses, centres_world_m = cameras
    detail_px, mesh, scratch, canvas, room = drawing
    order, far_m, line, painted_rows = room
    for row in range(len(painted_rows)):
        painted_rows[row, 0], painted_rows[row, 1] = canvas[0].shape[1], 0
    _sort_by_distance(T_world_frame, surfaces, coat, centres_world_m[c], order, far_m)
    more = 0
    for k in order:
        s = surfaces[k]
        draw(T_world_frame, surfaces[k : k + 1], P_px_world[c], lenses[c], detail_px, mesh, scratch, canvas)
        _find_line(T_world_frame[SURFACE_FRAMES[s]], coat[1][s], P_px_world[c], coat[0].shape[1], line)
        more += _collect(canvas, layers, far_m[k], line, coat[0][s], painted_rows, keeps)
    return more


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sort_by_distance(
    T_world_frame: Floats, surfaces: Ints, coat: Coat, centre_world_m: Floats, order: Ints, far_m: Floats
) -> None:
    """Write how far surfaces (K,) are from a camera, and their order from the farthest on."""
    for k in range(len(surfaces)):
        s = surfaces[k]
        T, middle_m = T_world_frame[SURFACE_FRAMES[s]], coat[1][s, 1]
        total = 0.0
        for i in range(3):
            at_m = T[i, 0] * middle_m[0] + T[i, 1] * middle_m[1] + T[i, 2] * middle_m[2] + T[i, 3]
            total += (at_m - centre_world_m[i]) ** 2
        far_m[k] = np.sqrt(total) - coat[2][s]
        place = k
        while place > 0 and far_m[order[place - 1]] < far_m[k]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = k


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _find_line(T: Floats, ends_m: Floats, P: Floats, n_pieces: int, line: Floats) -> None:
    """Set line (3,): the piece of a surface at a pixel (x, y) is line · (x, y, 1), from 0 to n_pieces.

    Where an end lies nearer to the camera than NEAR_M, pieces cannot be told: the first one counts.
    """
    line[0] = line[1] = line[2] = 0.0
    before, near_x, near_y = _pixel(T, ends_m[0], P)
    beyond, far_x, far_y = _pixel(T, ends_m[2], P)
    if before and beyond:
        dx, dy = far_x - near_x, far_y - near_y
        scale = n_pieces / max(dx * dx + dy * dy, _SHORTEST_PX2)
        line[0], line[1] = scale * dx, scale * dy
        line[2] = -(line[0] * near_x + line[1] * near_y)


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _pixel(T: Floats, point_m: Floats, P: Floats) -> tuple[bool, float, float]:
    """Where a point of a surface is in a picture, and whether it is before the camera."""
    x, y, z = point_m[0], point_m[1], point_m[2]
    world_x = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
    world_y = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
    world_z = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
    depth_m = P[2, 0] * world_x + P[2, 1] * world_y + P[2, 2] * world_z + P[2, 3]
    u = P[0, 0] * world_x + P[0, 1] * world_y + P[0, 2] * world_z + P[0, 3]
    v = P[1, 0] * world_x + P[1, 1] * world_y + P[1, 2] * world_z + P[1, 3]
    safe_m = max(depth_m, NEAR_M)
    return depth_m >= NEAR_M, u / safe_m, v / safe_m


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _collect(
    canvas: Canvas,
    layers: Layers,
    far_m: float,
    line: Floats,
    classes: Bytes,
    painted_rows: Ints,
    keeps: bool,
) -> int:
    """Paint one surface from the canvas, empty it, and return how many more pixels are wrong then.

    Only pixels that have a class in the input are painted. painted_rows (h, 2): widened.
    """
    extent, spans = canvas[2], canvas[3]
    more, last = 0, len(classes) - 1
    for row in range(extent[0], extent[1]):
        for i in range(row_spans(canvas, row)):
            # As 64 bits, like x below: otherwise a version is compiled for each mixture.
            first, end = int(np.int64(spans[i, 0])), int(np.int64(spans[i, 1]))
            painted_rows[row, 0] = min(painted_rows[row, 0], first)
            painted_rows[row, 1] = max(painted_rows[row, 1], end)
            begun, new = first, classes[_piece(line, first, row, last)]
            for x in range(first + 1, end):
                following = classes[_piece(line, x, row, last)]
                if following != new:
                    more += _paint_run(layers, row, far_m, begun, x, new, keeps)
                    begun, new = x, following
            more += _paint_run(layers, row, far_m, begun, end, new, keeps)
    extent[0], extent[1] = canvas[0].shape[0], 0
    return more


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _piece(line: Floats, x: int, y: int, last: int) -> int:
    return min(max(int(line[0] * x + line[1] * y + line[2]), 0), last)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _paint_run(
    layers: Layers, row: int, far_m: float, first: int, end: int, new: np.uint8, keeps: bool
) -> int:
    """Paint pixels first to end of a row in one class; without a branch, so that it becomes vector code."""
    seen, painted, nearest_m = layers[0][row], layers[1][row], layers[2][row]
    more, far = np.int32(0), np.float32(far_m)
    is_class = np.int32(new != 0)
    for at in range(first, end):
        x = np.uint32(at)
        k, old = seen[x], painted[x]
        is_painted = np.int32(k != 0) & np.int32(far < nearest_m[x])
        more += is_painted * ((is_class & np.int32(new != k)) - (np.int32(old != 0) & np.int32(old != k)))
        painted[x] = new if is_painted else old
        if keeps:
            nearest_m[x] = far if is_painted else nearest_m[x]
    return int(more)
