"""Motion blur: silhouettes reach too far where the actor moves fast.

While a shutter is open, an outline that moves by v pixels a frame across itself is smeared over e v pixels,
with the exposure e in frames. A segmenter takes in nearly all of the smear, so that a silhouette reaches too
far by up to e v / 2, before the actor and behind; of a slow outline `segmentation.edges` finds the middle.

The poses of an earlier run tell v. How far silhouettes reach beyond the tracked body, compared with v, tells
how much must be cut off; without blur there is no relation. The cut depends on the speed of the body's
outline, not on its position. The speed is the shorter of the steps to the frames before and after: a limb
that is lost in one frame jumps there and back, and the shorter step stays small.
"""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from scipy.spatial import cKDTree

from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import WORKING_WIDTH_PX, Rig
from services.mocap.camera.undistort import undistorted_px
from services.mocap.fit.contours import TURN_PX, Contour, nearest_facing
from services.mocap.fit.rim import PosedSurface
from services.mocap.sampling import evenly
from services.mocap.side_by_side import side_by_side
from services.mocap.take.tables import PoseTable
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Floats, Trimap
from services.segmentation.cleanup import SPECK_AREA_PPM, box_of, drop_specks
from services.segmentation.kept_trimaps import KeptTrimaps
from services.segmentation.silhouettes import Segmenter

_FAR_PX = 12.0
"""Distance, in working pixels, from which an outline does not belong to the body's nearest one."""
_SLOW_PX, _FAST_PX = 2.0, 8.0
"""Speeds, in working pixels a frame, below which nothing is smeared, and above which smears are measured."""
_SETTLED_PX = 4.0
"""Up to this speed the edges' middle is found anyway."""
_LEAST_CUT_PX, _LOOKED_AT_VERTICES = 3.0, 64
"""Where no vertex of the body, one of so many looked at, moves faster in a picture, nothing is cut there."""
_FEWEST = 300
"""Fast outline points, before the actor and behind, of which blur is measured."""
_LEAST_BLUR = 0.04
"""An exposure of 3/8 of a frame gives 0.10 to 0.16, sharp takes less than 0.01; below this is no blur."""
_ABSORBED = 1.25
"""Silhouettes reach this many times farther beyond the actor than beyond the tracked body, which was fitted
to them."""
_LOOKED_AT = 24
"""At most so many frames tell whether there is blur."""
_LEAST_STRETCH = 0.3
"""Pinhole pixels in a raw one: less is where a lens folds."""
_BLURRED = (
    "the actor is blurred where it moves fast: silhouettes were cut there before the second run; shorter "
    "exposures give better results"
)
_SMOOTHED_POINTS = 7
"""Outline points whose speeds are averaged."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class MovingOutline:
    """One camera's outline of the actor in one frame, and how the tracked body moves there."""

    points_px: Floats
    """(N, 2) in the raw picture."""
    speeds_px: Floats
    """(N,) of the body's outline nearby, across itself, in working pixels a frame: positive before the actor,
    negative behind; nan where none is near."""
    excess_px: Floats
    """(N,) how far the silhouette reaches beyond it, in working pixels; nan where none is near."""


def cut_motion_blur(
    segmenter: Segmenter,
    kept: KeptTrimaps,
    cameras: tuple[Camera, ...],
    actor: Actor,
    tracked: PoseTable,
    progress: Callable[[float], None] = lambda _: None,
) -> float:
    """Cut the smears of fast limbs off the kept silhouettes of consecutive frames, if there is blur.

    segmenter: makes what is not kept yet. tracked: the frames, with the actor's poses. progress: called with
    0 to 1. Returns the blur (blur_of) of some frames that are not marked.
    """
    moving, frames = _MovingBody(build_body(actor), tracked.poses, cameras), tracked.frames.tolist()
    unmarked = np.arange(len(frames))
    if tracked.marks is not None:
        unmarked = unmarked[~tracked.marks.distrusted.any(axis=1)]
    outlines = list[MovingOutline]()
    for row in unmarked[evenly(len(unmarked), _LOOKED_AT)].tolist():
        (moment,) = segmenter.source.raw_moments(frames[row], frames[row] + 1, with_pictures=False)
        outlines += moving.outlines(row, moment.trimaps)
    blur = blur_of(outlines)
    if blur > 0.0:
        log.warning("%s", _BLURRED)
        moments = segmenter.source.raw_moments(frames[0], frames[-1] + 1, with_pictures=False)
        for row, moment in enumerate(moments):
            outlines = moving.outlines(row, moment.trimaps, least_px=_LEAST_CUT_PX)
            of_cameras = zip(moment.trimaps, outlines, strict=True)
            kept.keep(frames[row], side_by_side(lambda pair: without_smear(*pair, blur), of_cameras))
            progress((row + 1) / len(frames))
    return blur


def blur_of(outlines: Iterable[MovingOutline]) -> float:
    """How far silhouettes reach beyond a fast part of the tracked body, over its speed; 0 without blur.

    The lesser of what is measured before the actor and behind: loose cloth trails behind only.
    """
    both = [np.stack([outline.speeds_px, outline.excess_px]) for outline in outlines]
    speeds_px, excess_px = np.hstack(both or [np.zeros((2, 0))])
    speeds_px, excess_px = speeds_px[~np.isnan(speeds_px)], excess_px[~np.isnan(speeds_px)]
    slow = np.abs(speeds_px) < _SLOW_PX
    if not slow.any():
        return 0.0
    excess_px = excess_px - np.median(excess_px[slow])
    shares = []
    for side in (speeds_px > _FAST_PX, speeds_px < -_FAST_PX):
        if np.count_nonzero(side) < _FEWEST:
            return 0.0
        shares.append(float(np.median(excess_px[side] / (np.abs(speeds_px[side]) - _SETTLED_PX))))
    return min(shares) if min(shares) >= _LEAST_BLUR else 0.0


def without_smear(trimap: Trimap, outline: MovingOutline, blur: float) -> Trimap:
    """A trimap (h, w) without the actor's pixels that are nearer to the outline than it reaches too far."""
    scale = trimap.shape[1] / WORKING_WIDTH_PX
    fast_px = np.maximum(np.nan_to_num(np.abs(outline.speeds_px)) - _SETTLED_PX, 0.0)
    too_far_px = _ABSORBED * blur * scale * fast_px
    if not too_far_px.any():
        return trimap
    cut = trimap.copy()
    box = box_of(trimap == ACTOR, 1)
    if box is None:
        return cut
    was_actor = trimap[box] == ACTOR
    actor = was_actor.astype(np.uint8)
    depths_px = cv2.distanceTransform(actor, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    ys, xs = np.nonzero((depths_px > 0) & (depths_px <= too_far_px.max() + 1))
    neighbours = list(range(1, min(_SMOOTHED_POINTS, len(too_far_px)) + 1))
    pixels = np.stack([xs + box[1].start, ys + box[0].start], axis=1)
    distances_px, nearest = cKDTree(outline.points_px).query(pixels, neighbours)
    smeared = distances_px[:, 0] < too_far_px[nearest].mean(axis=1)
    actor[ys[smeared], xs[smeared]] = 0
    drop_specks(actor, SPECK_AREA_PPM * 1e-6 * trimap.size)
    cut[box][was_actor & (actor == 0)] = BACKGROUND
    return cut


class _MovingBody:
    """A body in the poses (N, D) of consecutive frames, and how its outlines move."""

    def __init__(self, body: Body, poses: Floats, cameras: tuple[Camera, ...]) -> None:
        self._cameras, self._rig, self._last = cameras, Rig.of(cameras), len(poses) - 1
        self._surface = lru_cache(maxsize=3)(lambda row: PosedSurface.of(body, poses[row]))

    def outlines(self, row: int, trimaps: list[Trimap], least_px: float = 0.0) -> list[MovingOutline]:
        """Those of raw trimaps (h, w) of the cameras, in the frame of a row; unsure pixels have none.

        least_px: where the whole body moves by fewer working pixels a frame, they are empty.
        """
        here = self._surface(row)
        earlier, later = self._surface(max(row - 1, 0)), self._surface(min(row + 1, self._last))
        is_end = row in {0, self._last}
        some = [surface.vertices_world_m[::_LOOKED_AT_VERTICES] for surface in (earlier, here, later)]

        def fastest_px(c: int) -> float:
            """How far a vertex is at least from where it was before, or will be after."""
            before_px, now_px, after_px = map(self._cameras[c].project_px, some)
            steps_px = np.linalg.norm(np.stack([now_px - before_px, after_px - now_px]), axis=-1)
            apart_px = steps_px.max(axis=0) if is_end else steps_px.min(axis=0)
            return float(apart_px.max() / self._rig.scales[c])

        def outline(c: int) -> MovingOutline:
            camera, scale = self._cameras[c], float(self._rig.scales[c])
            if fastest_px(c) < least_px:
                return MovingOutline(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
            contour = Contour.of(trimaps[c] == ACTOR, scale, 0, trimaps[c] == UNSURE)
            points_px, normals, rim = contour.points_px, contour.normals, here.rim(self._rig, c)
            if len(points_px) == 0 or len(rim.edges) == 0:
                unknown = np.full(len(points_px), np.nan)
                return MovingOutline(points_px, unknown, unknown)
            pinhole_px = undistorted_px(camera, points_px)
            beside_px = undistorted_px(camera, points_px + normals)
            stretch = np.einsum("ni,ni->n", beside_px - pinhole_px, normals)  # pinhole pixels in a raw one
            edges = nearest_facing(
                pinhole_px, normals, rim.middles_px, rim.facing, TURN_PX * scale, _FAR_PX * scale
            )
            ends = rim.edges[edges]
            stretch[(edges < 0) | (stretch < _LEAST_STRETCH)] = np.nan

            def beyond_px(surface: PosedSurface) -> Floats:
                """(N,) how far the outline lies beyond the body's, in working pixels."""
                middles_px = camera.project_px(surface.vertices_world_m[ends].mean(axis=1))
                across_px = np.einsum("ni,ni->n", pinhole_px - middles_px, normals)
                return np.asarray(across_px / (stretch * scale), np.float64)

            excess_px = beyond_px(here)
            steps_px = beyond_px(earlier) - excess_px, excess_px - beyond_px(later)
            if is_end:
                speeds_px = steps_px[0] + steps_px[1]  # one of them is 0
            else:
                shorter_px = np.minimum(*np.abs(steps_px)) * np.sign(steps_px[0])
                speeds_px = np.where(steps_px[0] * steps_px[1] < 0, 0.0, shorter_px)
            return MovingOutline(points_px, speeds_px, excess_px)

        return side_by_side(outline, range(len(trimaps)))
