"""Finds what hides the actor from a camera: pixels that a tracked body covers often, silhouettes hardly ever.

Furniture in front of the actor cuts the same piece out of every silhouette, so it shows only once the other
cameras have told where the actor was. Such pixels become unsure: they count neither for nor against a pose.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from services.mocap.body.skeleton import SEGMENT_NAMES
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, unpack
from services.mocap.energy.picture import Region
from services.mocap.energy.snapping import SUBPIXEL, project_snapped
from services.mocap.search.model import Model
from services.mocap.search.whole_objects import whole_object
from services.mocap.types import Bytes, Floats, Mask

_LEAST_FRAMES, _LEAST_SHARE = 3, 0.03
"""A pixel counts if the body covers it in so many frames, or in all if there are fewer, and in this share of
all."""
_MOST_SEEN = 0.15
"""… and silhouettes have it in at most this share of as many frames."""
_INSIDE_PX, _AROUND_PX = 1, 2
"""So far inside the body, in pictures 320 wide, a pixel is surely behind something, and not where the body is
too wide; so far about such pixels others are taken for hidden, too."""
_LEAST_PX = 60.0
"""Fewer such pixels side by side, in pictures 320 wide, are a hand or a shoe that the body has elsewhere."""

_BEYOND_PX = 10
"""So far beyond what a few poses show, in pictures 320 wide, furniture may go on."""

_SEGMENTS = tuple(range(len(SEGMENT_NAMES)))
"""Without cloth, which hangs as it likes."""


@dataclass(frozen=True, eq=False)
class PosedFrame:
    """One frame of a tracked take."""

    seen: TriPlanes
    """(P, H, W)"""
    pose: Floats
    """(D,)"""
    is_lost: bool
    """Whether the whole body may be elsewhere; marks of limbs do not count, as furniture leads to them."""


def find_occluded(
    model: Model, frames: Iterable[PosedFrame], stage_of: Callable[[int], Bytes | None] = lambda _: None
) -> Mask:
    """(C, H, W) the pixels in which something hides the actor from each camera.

    stage_of: a camera's undistorted picture (h, w, 3) of the empty stage, which shows how far an object goes
    on; None: there is none.
    """
    rig, region = model.rig, Region.whole(model.rig)
    n_covered, n_behind, n_seen = np.zeros((3, rig.n_cameras, *rig.shape_px), np.int32)
    n_frames = 0
    for frame in frames:
        n_frames += 1
        possible = unpack(frame.seen.possible, rig.n_cameras)
        n_seen += possible
        if frame.is_lost:
            continue
        planes = model.backend.coverage(frame.pose[None], _SEGMENTS, region)[0]
        for c, covered in enumerate(unpack(planes, rig.n_cameras)):
            deep = cv2.erode(covered.view(np.uint8), disc(_INSIDE_PX, rig, c)) > 0
            n_covered[c] += deep
            n_behind[c] += deep & ~possible[c]
    often = n_covered >= max(min(_LEAST_FRAMES, n_frames), 1, _LEAST_SHARE * n_frames)
    most_seen = _MOST_SEEN * n_covered
    hidden = often & (n_covered - n_behind <= most_seen) & (n_seen <= most_seen + 1)
    large = [large_pieces(mask, _LEAST_PX * scale**2) for mask, scale in zip(hidden, rig.scales, strict=True)]
    for c, known in enumerate(large):
        if known.any() and (stage_bgr := stage_of(c)) is not None:
            part = np.s_[: stage_bgr.shape[0], : stage_bgr.shape[1]]
            known[part] |= whole_object(known[part] > 0, stage_bgr, n_seen[c][part])
    return widened(np.array(large), _AROUND_PX, rig)


def grown(masks: Mask, rig: Rig) -> Mask:
    """Masks (C, H, W) of what hides the actor in a few poses, and what may belong to it around."""
    return widened(masks.view(np.uint8), _BEYOND_PX, rig)


def widened(masks: Bytes, radius_px: float, rig: Rig) -> Mask:
    """Masks (C, H, W) wider by a radius, which is given for pictures 320 wide."""
    return np.array([cv2.dilate(mask, disc(radius_px, rig, c)) > 0 for c, mask in enumerate(masks)])


def large_pieces(mask: Mask, least_px: float) -> Bytes:
    """The connected pieces of a mask (H, W) that have so many pixels."""
    _, pieces, statistics, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8))
    is_large = statistics[:, cv2.CC_STAT_AREA] >= least_px
    is_large[0] = False  # the rest of the picture
    return np.asarray(is_large[pieces], np.uint8)


def disc(radius_px: float, rig: Rig, camera: int) -> Bytes:
    """A round kernel for a camera's picture; its radius is given for pictures 320 wide."""
    size = 1 + 2 * max(1, round(radius_px * rig.scales[camera]))
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))


def points_drawn(rig: Rig, points_world_m: Floats, drawn: Mask, radius_px: float) -> Mask:
    """(C, H, W) pixels of each camera's picture around those of the points (N, 3) that are drawn (C, N) there
    and lie in it; the radius is given for pictures 320 wide."""
    picture = np.zeros((rig.n_cameras, *rig.shape_px), np.uint8)
    for c, (width, height) in enumerate(rig.sizes_px.tolist()):
        steps, _ = project_snapped(points_world_m[drawn[c]], rig.P_px_world[c])
        columns, rows = np.rint(steps.T / SUBPIXEL).astype(np.int32)
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        picture[c, rows[inside], columns[inside]] = 1
    return widened(picture, radius_px, rig)
