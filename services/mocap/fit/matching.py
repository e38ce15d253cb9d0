"""Matching the model's rim with the input's contour, both ways: what a fit makes small."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from services.mocap.body.actor import Body
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Backend
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.fit.contours import Contour, features_of, working_scales
from services.mocap.fit.rim import Indices, Rim, find_rims
from services.mocap.search.chains import ALL_SEGMENTS
from services.mocap.types import Floats

RIM_POINTS = 200
"""Rim points of a view that are looked for on the contour, at most."""
_SHORTEST_PX = 60.0
"""Views with a shorter contour say nothing: the actor is hardly in them."""


@dataclass(frozen=True, eq=False)
class Matches:
    """One view's matched pairs: distances r = n · (rim - contour), in working pixels."""

    edges: Indices
    """(N, 2) the mesh edges of whose midpoint each row speaks."""
    points_px: Floats
    """(N, 2) those midpoints in the picture."""
    normals: Floats
    """(N, 2) the contour's normals, over the pixels per working pixel."""
    residuals_px: Floats
    """(N,)"""
    lengths_px: Floats
    """(N,) the length of outline that a row stands for, in working pixels."""


def match_frame(
    body: Body, backend: Backend, pose: Floats, rig: Rig, contours: list[Contour]
) -> list[Matches]:
    """Every camera's matches of a body in a pose (35,); the backend is the body's."""
    coverage = backend.coverage(pose[None], ALL_SEGMENTS, Region.whole(rig))[0]
    rims, scales = find_rims(body, pose, rig, coverage), working_scales(rig)
    return [
        match_view(rim, contour, float(scale))
        for rim, contour, scale in zip(rims, contours, scales, strict=True)
    ]


def backend_for(body: Body, rig: Rig) -> Backend:
    """What tells which rim points are hidden: drawing one body a few times is quickest on the CPU."""
    return CpuBackend(body, rig)


def match_view(rim: Rim, contour: Contour, scale: float) -> Matches:
    """Match evenly chosen rim points with their nearest contour points, and the other way round.

    Near is what lies near and faces the same way. scale: pixels per working pixel.
    """
    if len(rim.edges) == 0 or contour.length_px < _SHORTEST_PX:
        empty = np.zeros((0, 2))
        return Matches(np.zeros((0, 2), np.int64), empty, empty, np.zeros(0), np.zeros(0))
    rim_features = features_of(rim.points_px, rim.normals, scale)
    forth, share = _evenly(rim.lengths_px / scale)
    _, on_contour = contour.tree.query(rim_features[forth])
    _, on_rim = cKDTree(rim_features).query(contour.tree.data[contour.chosen])
    rows, targets = np.concatenate([forth, on_rim]), np.concatenate([on_contour, contour.chosen])
    back = np.full(len(on_rim), contour.length_px / max(len(on_rim), 1))
    normals = contour.normals[targets] / scale
    off = rim.points_px[rows] - contour.points_px[targets]
    return Matches(
        edges=rim.edges[rows],
        points_px=rim.points_px[rows],
        normals=normals,
        residuals_px=np.einsum("ni,ni->n", normals, off),
        lengths_px=np.concatenate([np.full(len(forth), share), back]),
    )


def _evenly(lengths_px: Floats) -> tuple[Indices, float]:
    """At most RIM_POINTS edges, evenly spread over the length of all, and the length each stands for."""
    along = np.cumsum(lengths_px)
    count = min(RIM_POINTS, len(lengths_px))
    places = (np.arange(count) + 0.5) / count * along[-1]
    return np.searchsorted(along, places).astype(np.int64), float(along[-1]) / count
