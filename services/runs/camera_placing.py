"""Cameras are placed where the tracked body shows them, if they do not stand where their calibration says.

A tripod that somebody touched, or a calibration that is a pixel or two off, spoils right silhouettes: no pose
agrees with all of them. What the actor does between the cameras shows where they stand. The silhouettes stay
as they were made for the first run.
"""

import logging

import numpy as np

from services.mocap.body.actor import Actor
from services.mocap.calibration.from_body import OFF_PX, offsets_px, refine_cameras
from services.mocap.camera.camera import Camera
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.take.folder import Take
from services.mocap.take.moved_cameras import AS_THE_BODY_SHOWS, moves_in_words, moves_of
from services.mocap.types import Floats

PLACING_FRAMES = 48
"""Frames by which cameras are moved; half of them are kept out. More hardly make them more exact."""
_CLEAR_GAIN = 0.1
"""Share of the energy, in frames that were kept out, by which moved cameras must be better. Cameras that are
turned by .3 degrees gain .26, focal lengths that are 1.5 % off .12, a camera out of step nothing."""
_UNLIKE_IOU = 0.1
"""A moved camera whose IoU is lower by this than the median of all sees something else than the body."""

log = logging.getLogger(__name__)


def disagree(cameras: tuple[Camera, ...], seen: TriPlanes, actor: Actor, poses: Floats) -> bool:
    """Whether a camera sees an actor in poses (F, D) clearly beside the silhouettes (F, P, H, W)."""
    return bool(offsets_px(cameras, seen, actor, poses).max() >= OFF_PX)


def placed(cameras: tuple[Camera, ...], seen: TriPlanes, actor: Actor, poses: Floats) -> tuple[Camera, ...]:
    """The cameras of silhouettes (F, P, H, W), moved to where an actor in poses (F, D) shows them, if they
    agree clearly better there with frames that were kept out; else as they are."""
    refined = refine_cameras(cameras, seen, actor, poses)
    before_px, after_px = (quality.energy_px.sum() for quality in (refined.before, refined.after))
    iou = refined.after.iou.mean(axis=0)
    is_unlike = ~refined.held & (iou < np.median(iou) - _UNLIKE_IOU)
    is_right = after_px <= (1.0 - _CLEAR_GAIN) * before_px and not is_unlike.any()
    return refined.cameras if is_right else cameras


def warn_of_moved(take: Take) -> None:
    """Say which cameras of a take were moved, if any."""
    if moves := moves_of(take):
        log.warning("%s: %s", moves_in_words(moves, len(take.calibrated)), AS_THE_BODY_SHOWS)
