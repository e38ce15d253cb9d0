"""Motion blur: silhouettes reach too far where the actor moves fast.

While a shutter is open, an outline that moves by v pixels a frame across itself is smeared over e v pixels,
with the exposure e in frames. A segmenter takes in nearly all of the smear, so that a silhouette reaches too
far by up to e v / 2, before the actor and behind; of a slow outline `segmentation.edges` finds the middle.

The poses of an earlier run tell v. How far silhouettes then reach beyond the tracked body tells how much has
to be cut off; without blur that does not depend on v. Where the body's outline is counts for nothing after
that, only its speed: a wrong pose cannot confirm itself.
"""

import logging
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.camera.undistort import undistorted_px
from services.mocap.fit.contours import features_of, outline_of
from services.mocap.fit.rim import PosedSurface
from services.mocap.search.chains import REFERENCE_WIDTH_PX
from services.mocap.take.tables import PoseTable
from services.mocap.types import ACTOR, BACKGROUND, Floats, Trimap
from services.segmentation.kept_trimaps import KeptTrimaps
from services.segmentation.side_by_side import side_by_side
from services.segmentation.silhouettes import Segmenter

_FAR = 12.0
"""From the body's outline, as features (features_of): what is farther belongs to something else."""
_SLOW_PX, _FAST_PX = 2.0, 8.0
"""Speeds, in working pixels a frame, below which nothing is smeared, and above which smears are measured."""
_SETTLED_PX = 4.0
"""Up to this speed the edges' middle is found anyway."""
_FEWEST = 300
"""Fast outline points, before the actor and behind, of which blur is measured."""
_LEAST_BLUR = 0.04
"""Half an exposure of 3/8 of a frame shows as 0.1; less than this is no blur."""
_ABSORBED = 1.25
"""How much farther silhouettes reach beyond the actor than beyond the tracked body, which follows them."""
_LOOKED_AT = 24
"""So many frames tell whether there is blur."""
_SMOOTHED_POINTS = 7
"""Outline points whose speeds are averaged."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class MovingOutline:
    """One camera's outline of the actor in one frame, and how the tracked body moves there."""

    points_px: Floats
    """(N, 2) in the raw picture."""
    speeds_px: Floats
    """(N,) of the body's outline nearby, across itself and away from the body, in working pixels a frame; nan
    where none is near."""
    excess_px: Floats
    """(N,) how far the silhouette reaches beyond it, in working pixels; nan where none is near."""


def cut_motion_blur(
    segmenter: Segmenter, kept: KeptTrimaps, cameras: tuple[Camera, ...], actor: Actor, tracked: PoseTable
) -> float:
    """Cut the smears of fast limbs off the kept silhouettes of consecutive frames, if there is blur.

    segmenter: makes what is not kept yet. tracked: the frames, with the actor's poses. Returns blur_of some
    frames without marks.
    """
    moving, numbers = _MovingBody(build_body(actor), tracked.poses, cameras), tracked.frames.tolist()
    rows = np.arange(len(numbers))
    if tracked.marks is not None:
        rows = rows[~tracked.marks.distrusted.any(axis=1)]
    looked_at = rows[:: max(1, len(rows) // _LOOKED_AT)].tolist()

    def trimaps_of(row: int) -> list[Trimap]:
        return next(segmenter.raw_moments(numbers[row], numbers[row] + 1, with_pictures=False)).trimaps

    blur = blur_of(outline for row in looked_at for outline in moving.outlines(row, trimaps_of(row)))
    if blur > 0.0:
        log.info("motion blur: silhouettes reach %.2f px too far for every px that they move a frame", blur)
        for row, frame in enumerate(numbers):
            trimaps = trimaps_of(row)
            outlines = moving.outlines(row, trimaps)
            cut = side_by_side(lambda pair: without_smear(*pair, blur), zip(trimaps, outlines, strict=True))
            kept.keep(frame, cut)
    return blur


def blur_of(outlines: Iterable[MovingOutline]) -> float:
    """How far silhouettes reach beyond a tracked body where they are fast, over their speed; 0 if that is no
    blur, which is alike before the actor and behind: what trails behind is cloth."""
    speeds_px, excess_px = np.hstack(
        [np.stack([o.speeds_px, o.excess_px]) for o in outlines] or [np.zeros((2, 0))]
    )
    speeds_px, excess_px = speeds_px[~np.isnan(speeds_px)], excess_px[~np.isnan(speeds_px)]
    slow = np.abs(speeds_px) < _SLOW_PX
    if not slow.any():
        return 0.0
    excess_px = excess_px - np.median(excess_px[slow])
    shares = []
    for before in (speeds_px > _FAST_PX, speeds_px < -_FAST_PX):
        if np.count_nonzero(before) < _FEWEST:
            return 0.0
        shares.append(float(np.median(excess_px[before] / (np.abs(speeds_px[before]) - _SETTLED_PX))))
    return min(shares) if min(shares) >= _LEAST_BLUR else 0.0


def without_smear(trimap: Trimap, outline: MovingOutline, blur: float) -> Trimap:
    """A trimap (h, w) without the actor's pixels that are nearer to the outline than it reaches too far."""
    ys, xs = np.nonzero(trimap == ACTOR)
    n_points = min(_SMOOTHED_POINTS, len(outline.points_px))
    if n_points == 0:
        return trimap
    distances_px, nearest = cKDTree(outline.points_px).query(np.stack([xs, ys], axis=1), n_points)
    distances_px, nearest = distances_px.reshape(-1, n_points), nearest.reshape(-1, n_points)
    scale = trimap.shape[1] / REFERENCE_WIDTH_PX
    speeds_px = np.nan_to_num(np.abs(outline.speeds_px))[nearest].mean(axis=1)
    smeared = distances_px[:, 0] < _ABSORBED * blur * np.maximum(speeds_px - _SETTLED_PX, 0.0) * scale
    cut = trimap.copy()
    cut[ys[smeared], xs[smeared]] = BACKGROUND
    return cut


class _MovingBody:
    """A body in the poses (N, D) of consecutive frames, and how its outlines move."""

    def __init__(self, body: Body, poses: Floats, cameras: tuple[Camera, ...]) -> None:
        self._body, self._poses, self._cameras, self._rig = body, poses, cameras, Rig.of(cameras)

    def outlines(self, row: int, trimaps: list[Trimap]) -> list[MovingOutline]:
        """Those of raw trimaps (h, w) of the cameras, in the frame of a row."""
        earlier, later = max(row - 1, 0), min(row + 1, len(self._poses) - 1)
        surfaces = [PosedSurface.of(self._body, self._poses[n]) for n in (earlier, row, later)]

        def outline(c: int) -> MovingOutline:
            camera, scale = self._cameras[c], self._cameras[c].width_px / REFERENCE_WIDTH_PX
            points_px, normals = outline_of(trimaps[c] == ACTOR)
            rim = surfaces[1].rim(self._rig, c)
            if len(points_px) == 0 or len(rim.edges) == 0:
                unknown = np.full(len(points_px), np.nan)
                return MovingOutline(points_px, unknown, unknown)
            pinhole_px = undistorted_px(camera, points_px)
            tree = cKDTree(features_of(rim.middles_px, rim.facing, scale))
            distances, edges = tree.query(features_of(pinhole_px, normals, scale))
            ends = rim.edges[edges]
            was_px, is_px, will_be_px = (
                camera.project_px(s.vertices_world_m[ends].mean(axis=1)) for s in surfaces
            )
            step_px = (will_be_px - was_px) / max(later - earlier, 1)
            of_both = np.einsum("kni,ni->kn", [step_px, pinhole_px - is_px], normals) / scale
            return MovingOutline(points_px, *np.where(distances < _FAR, of_both, np.nan))

        return side_by_side(outline, range(len(trimaps)))
