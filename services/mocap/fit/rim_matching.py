"""Matches the model's rim with the input's contour in both directions, for the residuals of a fit."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numba
import numpy as np

from services.mocap.body.actor import Body
from services.mocap.camera.rig import Rig
from services.mocap.fit.contours import (
    TURN_PX,
    Contour,
    nearest_facing,
    outline_length_px,
)
from services.mocap.fit.rim import PosedSurface, Rim
from services.mocap.sampling import evenly
from services.mocap.side_by_side import side_by_side
from services.mocap.types import Floats, Longs, Mask

RIM_POINTS = 200
"""Most rim points of a view that are matched with the contour."""
_SURFACE_PX, _SURFACE_TURN_PX = 4.0, 3.0
"""How far from an outline point, in working pixels, what makes it is looked for on the surface, and how many
of them a turn by a radian counts for."""
_WAY_POINTS = 12
"""At which it is seen whether there are unsure pixels on the way from a rim point to the contour."""
_SHORTEST_PX = 60.0
"""Views with a shorter contour are not used: the actor is hardly in them."""


@dataclass(frozen=True, eq=False)
class Matches:
    """One view's matched pairs: distances r = n · (rim - contour), in working pixels."""

    edges: Longs
    """(N, 2) the mesh edge of each row."""
    points_px: Floats
    """(N, 2) points of the body's outline in the picture."""
    normals: Floats
    """(N, 2) the contour's normals, over the pixels per working pixel."""
    residuals_px: Floats
    """(N,)"""
    lengths_px: Floats
    """(N,) the length of outline that a row stands for, in working pixels."""
    unmatched_px: float = 0.0
    """Length of a contour that has no rows, because the body is outside of the picture, in working pixels."""


def match_frames(
    body: Body, poses: Floats, rig: Rig, contours: Sequence[Sequence[Contour]]
) -> list[list[Matches]]:
    """The matches of every frame and camera, of a body in poses (F, D)."""
    surfaces = side_by_side(partial(PosedSurface.of, body), poses)

    def of_view(view: tuple[PosedSurface, int, Contour]) -> Matches:
        surface, camera, contour = view
        return match_view(surface.rim(rig, camera), contour)

    views = [
        (surface, camera, contour)
        for surface, of_cameras in zip(surfaces, contours, strict=True)
        for camera, contour in enumerate(of_cameras)
    ]
    found = iter(side_by_side(of_view, views))
    return [[next(found) for _ in of_cameras] for of_cameras in contours]


def match_view(rim: Rim, contour: Contour) -> Matches:
    """Match some points of the model's outline with the nearest of the input's, and the other way round.

    The distance includes the difference of the normals. Points of the model that meet unsure pixels first are
    not used.
    """
    scale, is_used = contour.scale, contour.length_px >= _SHORTEST_PX
    if len(rim.edges) == 0 or len(rim.points_px) == 0 or not is_used:
        unmatched_px, points = contour.length_px if is_used else 0.0, np.zeros((0, 2))
        return Matches(points.astype(np.int64), points, points, np.zeros(0), np.zeros(0), unmatched_px)
    forth = evenly(len(rim.points_px), RIM_POINTS)
    on_contour = nearest_facing(
        rim.points_px[forth], rim.normals[forth], contour.points_px, contour.normals, TURN_PX * scale, np.inf
    )
    forth_px = outline_length_px(len(rim.points_px), scale) / len(forth)
    if contour.near_unsure is not None:
        told = ~_hidden(
            rim.points_px[forth], rim.normals[forth], contour.points_px[on_contour], contour.near_unsure
        )
        forth, on_contour = forth[told], on_contour[told]
    chosen = contour.chosen
    on_rim = nearest_facing(
        contour.points_px[chosen],
        contour.normals[chosen],
        rim.points_px,
        rim.normals,
        TURN_PX * scale,
        np.inf,
    )
    rows, targets = np.concatenate([forth, on_rim]), np.concatenate([on_contour, chosen])
    back_px = contour.length_px / max(len(on_rim), 1)
    lengths_px = np.repeat([forth_px, back_px], [len(forth), len(on_rim)])
    edges = nearest_facing(
        rim.points_px[rows], rim.normals[rows], rim.middles_px, rim.facing,
        _SURFACE_TURN_PX * scale, _SURFACE_PX * scale,
    )  # fmt: skip
    found = edges >= 0
    rows, targets = rows[found], targets[found]
    normals = contour.normals[targets] / scale
    off = rim.points_px[rows] - contour.points_px[targets]
    return Matches(
        edges=rim.edges[edges[found]],
        points_px=rim.points_px[rows],
        normals=normals,
        residuals_px=np.einsum("ni,ni->n", normals, off),
        lengths_px=lengths_px[found],
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _hidden(points_px: Floats, normals: Floats, targets_px: Floats, near_unsure: Mask) -> Mask:
    """Which of the rim's points (N, 2) meet unsure pixels before their targets (N, 2).

    On the way there, or as near along the normal, either side: what belongs to them may be there.
    """
    height, width = near_unsure.shape
    hidden = np.zeros(len(points_px), np.bool_)
    for n in range(len(points_px)):
        x, y = points_px[n]
        dx, dy = targets_px[n, 0] - x, targets_px[n, 1] - y
        along = np.sqrt(dx * dx + dy * dy)
        u, v = along * normals[n, 0], along * normals[n, 1]
        for k in range(_WAY_POINTS):
            share = k / (_WAY_POINTS - 1.0)
            for way_x, way_y in ((dx, dy), (u, v), (-u, -v)):
                column = min(max(int(np.rint(x + share * way_x)), 0), width - 1)
                row = min(max(int(np.rint(y + share * way_y)), 0), height - 1)
                hidden[n] |= near_unsure[row, column]
    return hidden
