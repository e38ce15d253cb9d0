"""Compiled scan conversion by outlines: which pixels a posed body covers, without filling a triangle.

The front faces of a closed mesh cover a pixel as often as the outline of those faces winds around it. So
only the edges between a front and a back face matter, a few hundred in twenty thousand: each puts +1 or -1
where it crosses a pixel row, and a running sum along the row is above zero exactly where a front face lies.
With snapped vertices all of this is whole-number arithmetic, and equal bit for bit to filling every triangle
by the top-left rule.
"""

import numba
import numpy as np

from services.mocap.energy.facing import AGAINST, ALONG, UNDECIDED, find_candidates
from services.mocap.energy.mesh import Indices, Singles
from services.mocap.energy.snapping import NEAR_M, SUBPIXEL, SUBPIXEL_BITS, project_vertex
from services.mocap.types import Bytes, Floats, Ints


@numba.njit(cache=True, nogil=True, error_model="numpy")
def outline_energy(
    T_world_segment: Floats,
    segments: Ints,
    P_px_world: Floats,
    xyz_m: Floats,
    edges: Indices,
    planes: Singles,
    block_planes: Singles,
    block_start: Ints,
    spheres_m: Floats,
    M_px_segment: Floats,
    found: Indices,
    ends: Ints,
    blocks: Bytes,
    gain: Ints,
    winding: Ints,
    energies: Floats,
) -> None:
    """Add, for each of N poses, the gain of every pixel that the body covers.

    T_world_segment (N, S, 4, 4); segments: indices of those drawn; P_px_world (C, 3, 4); mesh and scratch arrays as in FlatMesh and Candidates;
    gain (C, H, W) int8, what a covered pixel adds; winding (H, W + 1) int16, all zero, is scratch; energies
    (N,).
    """
    height_px, width_px = gain.shape[1], gain.shape[2]
    extent = np.empty(4, np.int64)
    for n in range(len(T_world_segment)):
        find_candidates(
            T_world_segment[n], segments, P_px_world, width_px, height_px, planes, block_planes,
            block_start, spheres_m, M_px_segment, found, ends, blocks,
        )  # fmt: skip
        total = 0
        for c in range(len(P_px_world)):
            _wind(segments, xyz_m, edges, M_px_segment[c], found[c], ends[c], winding, extent)
            total += _collect_gain(winding, extent, gain[c])
        energies[n] += total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def outline_coverage(
    T_world_segment: Floats,
    segments: Ints,
    P_px_world: Floats,
    xyz_m: Floats,
    edges: Indices,
    planes: Singles,
    block_planes: Singles,
    block_start: Ints,
    spheres_m: Floats,
    M_px_segment: Floats,
    found: Indices,
    ends: Ints,
    blocks: Bytes,
    winding: Ints,
    covered: Bytes,
) -> None:
    """Set the bits of every pixel that the body covers in covered (N, P, H, W); else as outline_energy."""
    height_px, width_px = covered.shape[2], covered.shape[3]
    extent = np.empty(4, np.int64)
    for n in range(len(T_world_segment)):
        find_candidates(
            T_world_segment[n], segments, P_px_world, width_px, height_px, planes, block_planes,
            block_start, spheres_m, M_px_segment, found, ends, blocks,
        )  # fmt: skip
        for c in range(len(P_px_world)):
            _wind(segments, xyz_m, edges, M_px_segment[c], found[c], ends[c], winding, extent)
            _collect_bits(winding, extent, covered[n, c // 8], np.uint8(1 << c % 8))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _wind(
    segments: Ints,
    xyz_m: Floats,
    edges: Indices,
    M_px_segment: Floats,
    found: Indices,
    ends: Ints,
    winding: Ints,
    extent: Ints,
) -> None:
    """Put one camera's outlines of the segments into winding.

    extent gets what they touch: first row, last row + 1, first column, last column + 1.
    """
    extent[0], extent[1] = winding.shape[0], 0
    extent[2], extent[3] = winding.shape[1], 0
    for k in range(len(segments)):
        M = M_px_segment[segments[k]]
        for i in range(ends[k], ends[k + 1]):
            edge, code = found[i] >> 2, found[i] & 3
            a, b = edges[edge, 0], edges[edge, 1]
            x0, y0, z0 = project_vertex(xyz_m, a, M)
            x1, y1, z1 = project_vertex(xyz_m, b, M)
            if code == UNDECIDED:
                code = _decide(edges, edge, xyz_m, M)
            if code == ALONG:
                _cross_rows(x0, y0, x1, y1, winding, extent)
            elif code == AGAINST:
                _cross_rows(x1, y1, x0, y0, winding, extent)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _decide(edges: Indices, edge: int, xyz_m: Floats, M: Floats) -> int:
    """ALONG, AGAINST or 0 from the snapped corners of an edge's two faces.

    A front face's corners run counter-clockwise on the screen, where y points down, and lie before the near
    plane.
    """
    ax, ay, az = project_vertex(xyz_m, edges[edge, 0], M)
    bx, by, bz = project_vertex(xyz_m, edges[edge, 1], M)
    cx, cy, cz = project_vertex(xyz_m, edges[edge, 2], M)
    dx, dy, dz = project_vertex(xyz_m, edges[edge, 3], M)
    before = min(az, bz) >= NEAR_M
    along = before and cz >= NEAR_M and (bx - ax) * (cy - ay) < (cx - ax) * (by - ay)
    against = before and dz >= NEAR_M and (bx - ax) * (dy - ay) > (dx - ax) * (by - ay)
    if along == against:
        return 0
    return ALONG if along else AGAINST


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _cross_rows(x0: int, y0: int, x1: int, y1: int, winding: Ints, extent: Ints) -> None:
    """Put an outline edge into winding: +1 where it runs down across a row's centres, -1 where up.

    A crossing counts from the first pixel whose centre is not left of it, so that a centre on a left or top
    edge is inside and one on a right or bottom edge outside.
    """
    if y0 == y1:
        return
    sign = 1
    if y0 > y1:
        x0, y0, x1, y1 = x1, y1, x0, y0
        sign = -1
    height, width = winding.shape[0], winding.shape[1] - 1
    first = max((y0 + SUBPIXEL - 1) >> SUBPIXEL_BITS, 0)
    last = min((y1 + SUBPIXEL - 1) >> SUBPIXEL_BITS, height)
    if first >= last:
        return
    extent[0], extent[1] = min(extent[0], first), max(extent[1], last)
    dx, dy = x1 - x0, y1 - y0
    divisor = dy << SUBPIXEL_BITS
    for row in range(first, last):
        crossing = x0 * dy + ((row << SUBPIXEL_BITS) - y0) * dx
        column = min(max(-((-crossing) // divisor), 0), width)
        extent[2], extent[3] = min(extent[2], column), max(extent[3], column + 1)
        winding[row, column] += sign


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _collect_gain(winding: Ints, extent: Ints, gain: Ints) -> int:
    """Sum the gain of covered pixels and set winding back to zero."""
    total = 0
    past_picture = gain.shape[1]
    for row in range(extent[0], extent[1]):
        depth = 0
        for x in range(extent[2], min(extent[3], past_picture)):
            depth += winding[row, x]
            winding[row, x] = 0
            total += gain[row, x] if depth > 0 else 0
        winding[row, past_picture] = 0
    return total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _collect_bits(winding: Ints, extent: Ints, plane: Bytes, bit: int) -> None:
    """Set the bit of covered pixels in plane (H, W) and set winding back to zero."""
    past_picture = plane.shape[1]
    for row in range(extent[0], extent[1]):
        depth = 0
        for x in range(extent[2], min(extent[3], past_picture)):
            depth += winding[row, x]
            winding[row, x] = 0
            if depth > 0:
                plane[row, x] |= bit
        winding[row, past_picture] = 0
