"""Aligning a body with the input's silhouettes by their contours.

The rim of the model, where its surface turns away from a camera, is to lie on the input's contour. Points of
the rim look along their normals for the contour that faces the same way, Gauss-Newton moves the pose, and so
again with shorter reach and less patience for outliers (a form of articulated ICP on silhouettes: Rosenhahn,
Brox, Weickert, IJCV 73(3), 2007). Only the model's silhouettes are drawn: they show which parts of the rim
are hidden, and the pixel contour of the rest, which is compared with the input's.

The fit of a body's shape has a solver of its own (fit/least_squares.py), with slower matches both ways: one
solver for both was measured, and results of some takes became worse.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import ALL_FRAMES, N_DOF, N_RIGID, SURFACE_FRAMES, moving_frames
from services.mocap.body.skeleton import BODY_DOFS, DOFS, LOWER, UPPER
from services.mocap.body.surface import Level, closed_edges
from services.mocap.camera.rig import Rig
from services.mocap.energy.cpu.collecting import empty_canvas
from services.mocap.energy.cpu.facing import lenses_of
from services.mocap.energy.cpu.outline import prepared
from services.mocap.energy.detail.cache import levels_of
from services.mocap.energy.picture import Picture
from services.mocap.search.alignment.contacts import Contacts
from services.mocap.search.alignment.matching import (
    OWN_REACH_PX,
    SHARES,
    RimArrays,
    input_of,
    room_for,
    views_of,
)
from services.mocap.search.alignment.pose_prices import PosePrices, contact_px, prices_px
from services.mocap.search.alignment.solving import follow
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Floats

_FIRST_CAP_PX, _LAST_CAP_PX = 6.0, 1.5
"""Contours farther away than this count as outliers, in the first and in the last step."""
_LAST_REACH = 0.375
"""Of the reach, in the last step."""
_FIRST_DAMPING, _LAST_DAMPING = 0.05, 0.001
_COARSE_M = 0.006
"""Allowed error of the rim until the last steps, in pictures 320 wide; the last steps use every edge of the
body."""
_LEAST_COARSE_M = 0.003
"""At least this error is allowed, in larger pictures too: using every edge takes time."""
_FINE_STEPS = 2
"""Number of last steps; an alignment has at least this many."""
_FINE = 0.2
"""Of the level of detail, in the last steps."""
_LONGEST = np.array([0.15 if dof.unit == "m" else 0.35 for dof in DOFS])
"""Largest step, in metres and radians."""
_NEAR_PX = 2.0
"""A rim point nearer to the contour than this lies on it, in pictures 320 wide."""
_EVERYTHING = np.array(ALL_SURFACES, np.int32)
_LIMITS = np.array([LOWER, UPPER])
_REST_SHARES = np.array([dof.rest for dof in DOFS])


@dataclass(frozen=True, eq=False)
class SeenRim:
    """What is seen of each segment's rim, over all cameras."""

    lengths_px: Floats
    """(S + 5, SHARES) summed over the cameras, each by its weight."""
    place_normals: Floats
    """(S + 5, 3, 3) what the rim tells of the segment's place: its normal matrix, in cubic pixels per square
    metre. Only the lower half is filled, which np.linalg.eigvalsh reads."""

    @classmethod
    def nothing(cls) -> "SeenRim":
        """Of a body whose rim was not looked for."""
        return cls(np.zeros((len(ALL_SURFACES), SHARES)), np.zeros((len(ALL_SURFACES), 3, 3)))


@dataclass(frozen=True, eq=False)
class Aligned:
    """The result of an alignment."""

    pose: Floats
    """(D,)"""
    anchor_cost: float
    """Of the distance from the expected and the rest pose: weighted squares, by steadiness and rest. Files
    and messages call it `prior`."""
    rim: SeenRim


class Aligner:
    """Aligns one body in one camera rig; only one thread at a time may call it."""

    def __init__(self, body: Body, rig: Rig, *, thinned: bool = True) -> None:
        """thinned: with levels of detail, which take about a second for a new body."""
        self._offsets_m, self._rig = body.offsets_m, rig
        self._mesh, (self._scratch,) = prepared(body, thinned)
        self._scale = rig.scale
        levels = levels_of(body) if thinned else ()
        self._rims = _rim_of(body, levels, max(_COARSE_M / self._scale, _LEAST_COARSE_M)), _rim_of(body)
        self._contacts = Contacts.of(body)
        self._room = room_for(self._rims[-1])

    def align(
        self,
        picture: Picture,
        pose: Floats,
        settings: SearchSettings,
        dofs: tuple[int, ...] = tuple(range(N_DOF)),
        segments: tuple[int, ...] = ALL_SURFACES,
    ) -> Aligned:
        """Move parameters of a pose (D,) so that segments' rims lie on the contours of a picture.

        Of the dofs only those that the settings' body has move. Webs of cloth are drawn, but do not pull.
        The picture has full resolution: whole pictures, or windows. Rim points outside do not count.
        """
        free = np.zeros(N_DOF)
        free[[d for d in dofs if d in BODY_DOFS[settings.body]]] = 1.0
        anchor, region, steps = _anchor(pose, settings), picture.region, self._steps(settings)
        views = views_of(self._rig, region, settings.cost.weights(self._rig.n_cameras))
        cameras = (views[0], lenses_of(views[0], region.width_px, region.height_px))
        canvas = empty_canvas(region.height_px, region.width_px)
        moves = np.isin(SURFACE_FRAMES, moving_frames(tuple(np.flatnonzero(free)), ALL_SURFACES))
        drawing = (_EVERYTHING[~moves], _EVERYTHING[moves], self._mesh, self._scratch, cameras, canvas)
        pulling, seen = np.array([s for s in segments if s < N_RIGID], np.int32), input_of(picture)
        coarse_rim, fine_rim = self._rims
        prices = PosePrices.of(self._contacts, self._rig, settings)

        def followed(
            start: Floats, detail_px: float, rim: RimArrays, steps: Floats
        ) -> tuple[Floats, float, Floats, Floats]:
            return follow(
                start, self._offsets_m, ALL_FRAMES, seen, drawing, detail_px,
                (pulling, rim, views, self._room), steps, free, anchor, _LIMITS, prices,
            )  # fmt: skip

        pose, _, _, _ = followed(pose, settings.detail_px, coarse_rim, steps[:-_FINE_STEPS])
        pose, anchor_cost, rim_px, places = followed(
            pose, _FINE * settings.detail_px, fine_rim, steps[-_FINE_STEPS:]
        )
        return Aligned(pose, anchor_cost, SeenRim(rim_px, places[SURFACE_FRAMES]))

    def contact_px(self, poses: Floats, settings: SearchSettings) -> Floats:
        """(N, 4) what limbs (LIMB_NAMES) cost for being inside others in poses (N, D)."""
        return contact_px(self._contacts, self._offsets_m, poses, self._rig, settings)

    def prices_px(self, poses: Floats, settings: SearchSettings) -> Floats:
        """(N,) what poses (N, D) cost beside their pixels."""
        return prices_px(self._contacts, self._offsets_m, poses, self._rig, settings)

    def _steps(self, settings: SearchSettings) -> Floats:
        """(K, 4) as follow takes them: from far to near."""
        share = np.linspace(0.0, 1.0, settings.contour_steps)
        reach_px = settings.contour_reach_px * self._scale * (1.0 + (_LAST_REACH - 1.0) * share)
        cap_px = self._scale * _FIRST_CAP_PX * (_LAST_CAP_PX / _FIRST_CAP_PX) ** share
        damping = _FIRST_DAMPING * (_LAST_DAMPING / _FIRST_DAMPING) ** share
        near_px = np.full_like(share, _NEAR_PX * self._scale)
        return np.column_stack([np.maximum(np.ceil(reach_px), OWN_REACH_PX), near_px, cap_px, damping])


def _anchor(expected: Floats, settings: SearchSettings) -> Floats:
    """(3, D) as follow takes it: target pose between the expected and the rest pose, weights, largest
    steps."""
    rest = settings.rest * _REST_SHARES
    weights = settings.steadiness + rest
    likely = expected * np.divide(settings.steadiness, weights, out=np.zeros(N_DOF), where=weights > 0)
    return np.stack([likely, weights, _LONGEST])


def _rim_of(body: Body, ladders: Sequence[Sequence[Level]] = (), most_m: float = 0.0) -> RimArrays:
    """The edges of a body, from each segment's coarsest thinned mesh with an error of at most most_m, or its
    full mesh."""
    ladders = ladders or [()] * len(body.surfaces)
    pieces = [_edges(_coarsest(body, s, ladder, most_m)) for s, ladder in enumerate(ladders)]
    starts = np.cumsum([0] + [len(piece[0]) for piece in pieces])
    planes, middles_m, halves_m, outward = (
        np.ascontiguousarray(np.concatenate(column).T) for column in zip(*pieces, strict=True)
    )
    return planes.astype(np.float32), middles_m, halves_m, outward, starts.astype(np.int32)


def _coarsest(body: Body, surface: int, ladder: Sequence[Level], most_m: float) -> Level:
    full = Level(*body.surfaces[surface], 0.0)
    return max([full, *(lv for lv in ladder if lv.error_m <= most_m)], key=lambda level: level.error_m)


def _edges(level: Level) -> tuple[Floats, Floats, Floats, Floats]:
    """(E, 8) planes, (E, 3) middles, halves and outward directions of one segment."""
    edges, sides = closed_edges(level.faces)
    a, b, c = (level.vertices_m[corner] for corner in level.faces.T)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    planes = np.column_stack([normals, np.sum(normals * a, axis=1)])[sides].reshape(-1, 8)
    ends = level.vertices_m[edges[:, :2]]
    return planes, ends.mean(axis=1), (ends[:, 1] - ends[:, 0]) / 2, normals[sides].sum(axis=1)
