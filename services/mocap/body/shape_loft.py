"""Lofting: closed triangle meshes made of smooth cross-sections strung along a bone.

A loft's triangles all have about the same edge length: rings hold as many vertices as their girth asks
for, neighbouring rings are joined by a zipper, and both ends close in a rounded cap.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from scipy.interpolate import PchipInterpolator

from services.mocap.types import Floats, Ints

# Height over base of an equilateral triangle: rings that far apart, in edges, give even triangles.
_RING_SPACING_EDGES = 0.866
_FINEST_GIRTH_EDGES = 10
_HALF_OUTLINE = np.linspace(0.0, pi, 181)
_DENSE = 1001

Stations = tuple[tuple[float, float, float, float, float, float, float], ...]
"""Rows of cross-sections in ascending order: position along the bone; lowest and highest extent across;
lowest and highest extent in depth (all from the bone, in body heights); squareness (the exponent of a
superellipse, 2 is an ellipse) of the half with low and of the half with high depth."""


@dataclass(frozen=True)
class Bump:
    """A smooth local swelling: vertices move by `push`, weighted by a Gaussian about `centre`."""

    centre: tuple[float, float, float]
    spread: tuple[float, float, float]
    """Standard deviations of the Gaussian along x, y and z, in body heights like the others."""
    push: tuple[float, float, float]


@dataclass(frozen=True)
class Loft:
    """One closed surface: the part of a station table from `start` to `end`, ends rounded over the caps."""

    axes: str
    """Frame axes of a station's (along, across, depth): "zyx" for trunk and legs, "yzx" for arms, …"""
    stations: Stations
    start: float
    end: float
    start_cap: float
    end_cap: float
    bumps: tuple[Bump, ...] = ()


def loft_mesh(loft: Loft, edge_heights: float) -> tuple[Floats, Ints]:
    """Triangulate a loft with edges of about edge_heights, or finer where it is thinner than a few edges.

    Returns vertices (V, 3) in body heights in the segment's frame and faces (F, 3), counter-clockwise seen
    from outside. Every ring and its triangles are mirror symmetric across, before bumps are raised.
    """
    # Positions along the bone, close together at both ends where the caps turn steeply.
    along = loft.start + (loft.end - loft.start) * 0.5 * (1.0 - np.cos(np.linspace(0.0, pi, _DENSE)))
    sections = _sections(loft, along)
    girths = 2.0 * _half_outlines(sections)[1][:, -1]
    edge = min(edge_heights, float(girths.max()) / _FINEST_GIRTH_EDGES)
    rings_along = _ring_positions(along, sections, edge)
    # Edges in one half of each ring; none at the poles, which are single vertices.
    halves = np.maximum(3, np.rint(np.interp(rings_along, along, girths) / (2.0 * edge))).astype(np.int32)
    halves[[0, -1]] = 0
    points = _ring_points(_sections(loft, rings_along), halves)
    columns = ["xyz".index(axis) for axis in loft.axes]
    vertices = np.empty((len(points), 3))
    vertices[:, columns[0]] = np.repeat(rings_along, np.maximum(2 * halves, 1))
    vertices[:, columns[1:]] = points
    faces = _faces(halves)
    if loft.axes in ("xyz", "yzx", "zxy"):  # a right-handed order turns the rings the other way round
        faces = np.ascontiguousarray(faces[:, ::-1])
    moved = vertices.copy()
    for bump in loft.bumps:
        weight = np.exp(-0.5 * np.sum(((vertices - bump.centre) / bump.spread) ** 2, axis=1))
        moved += weight[:, None] * bump.push
    return moved, faces


def _sections(loft: Loft, along: Floats) -> Floats:
    """Cross-sections (N, 6): across centre and half width, depth centre and half depth, two squarenesses."""
    table = np.array(loft.stations)
    low, high, back, front, square_low, square_high = PchipInterpolator(table[:, 0], table[:, 1:])(along).T
    into_start = np.clip(1.0 - (along - loft.start) / loft.start_cap, 0.0, 1.0)
    into_end = np.clip(1.0 - (loft.end - along) / loft.end_cap, 0.0, 1.0)
    size = 0.5 * np.sqrt((1.0 - into_start**2) * (1.0 - into_end**2))
    return np.column_stack(
        [
            (low + high) / 2,
            (high - low) * size,
            (back + front) / 2,
            (front - back) * size,
            square_low,
            square_high,
        ]
    )


def _half_outlines(sections: Floats) -> tuple[Floats, Floats]:
    """Outlines of the half with high across values, from highest to lowest depth.

    Returns points (N, 181, 2) as (across, depth), and the length (N, 181) of the outline up to each.
    """
    across, half_width, depth, half_depth, square_low, square_high = sections.T[:, :, None]
    cosine, sine = np.cos(_HALF_OUTLINE), np.abs(np.sin(_HALF_OUTLINE))
    power = 2.0 / np.where(cosine > 0.0, square_high, square_low)
    points = np.stack(
        [across + half_width * sine**power, depth + half_depth * np.sign(cosine) * np.abs(cosine) ** power],
        -1,
    )
    steps = np.linalg.norm(np.diff(points, axis=1), axis=2)
    return points, np.concatenate([np.zeros((len(points), 1)), np.cumsum(steps, axis=1)], axis=1)


def _ring_positions(along: Floats, sections: Floats, edge: float) -> Floats:
    """Positions of the rings, poles included, evenly spaced over the surface rather than along the bone."""
    across, half_width, depth, half_depth = sections.T[:4]
    extents = np.stack([across - half_width, across + half_width, depth - half_depth, depth + half_depth])
    steps = np.sqrt(np.diff(along) ** 2 + np.mean(np.diff(extents, axis=1) ** 2, axis=0))
    length = np.concatenate([[0.0], np.cumsum(steps)])
    count = round(length[-1] / (_RING_SPACING_EDGES * edge))
    return np.interp(np.linspace(0.0, length[-1], count + 1), length, along)


def _ring_points(sections: Floats, halves: Ints) -> Floats:
    """Points (V, 2) as (across, depth) of all rings one after the other, evenly spaced along each."""
    rings = []
    for section, outline, length, half in zip(sections, *_half_outlines(sections), halves, strict=True):
        at = np.linspace(0.0, length[-1], half + 1)
        points = np.column_stack([np.interp(at, length, outline[:, k]) for k in (0, 1)])
        points[[0, -1], 0] = section[0]  # the seam lies exactly on the plane of symmetry
        mirrored = points[-2:0:-1] * (-1.0, 1.0) + (2.0 * section[0], 0.0)
        rings.append(np.vstack([points, mirrored]) if half else section[None, [0, 2]])
    return np.vstack(rings)


def _faces(halves: Ints) -> Ints:
    """Faces (F, 3) that join each ring to the next, first the one half and then its mirror image."""
    first = np.concatenate([[0], np.cumsum(np.maximum(2 * halves, 1))])
    faces: list[tuple[int, int, int]] = []
    for k, (lower, upper) in enumerate(zip(halves[:-1].tolist(), halves[1:].tolist(), strict=True)):
        for triangle in _zipper(lower, upper):
            corners = [(first[k + ring], 2 * (lower, upper)[ring], i) for ring, i in triangle]
            faces.append(tuple(base + (i % n if n else 0) for base, n, i in corners))
            faces.append(tuple(base + (-i % n if n else 0) for base, n, i in reversed(corners)))
    return np.array(faces, np.int32)


def _zipper(lower: int, upper: int) -> list[tuple[tuple[int, int], tuple[int, int], tuple[int, int]]]:
    """Triangles between two half rings of `lower` and `upper` edges; a corner is (0 or 1, vertex)."""
    triangles = []
    i = j = 0
    while i < lower or j < upper:
        if i < lower and (j == upper or (i + 0.5) * upper <= (j + 0.5) * lower):
            triangles.append(((0, i), (0, i + 1), (1, j)))
            i += 1
        else:
            triangles.append(((0, i), (1, j + 1), (1, j)))
            j += 1
    return triangles
