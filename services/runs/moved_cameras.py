"""Cameras that do not stand where their calibration says, as the tracked body shows.

A tripod that somebody touched, or a calibration that is a pixel or two off, spoils right silhouettes: no pose
agrees with all of them. What the actor does between the cameras shows where they stand.
"""

import logging
from collections.abc import Mapping

import numpy as np

from services.mocap.body.actor import Actor
from services.mocap.calibration.from_body import OFF_PX, moved_by, offsets_px, refine_cameras
from services.mocap.camera.camera import Camera
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.take.folder import Take
from services.mocap.types import Floats

PLACING_FRAMES = 48
"""Frames by which cameras are moved; half of them are kept out. More hardly make them more exact."""
_LEAST_GAIN = 0.1
"""Share of the energy, in frames that were kept out, by which moved cameras must be better. Cameras that are
turned by .3 degrees gain .26, focal lengths that are 1.5 % off .12, a camera out of step nothing."""
_BELOW_OTHERS = 0.1
"""A moved camera whose IoU is lower by this than the median of all sees something else than the body."""
_SAME_DEG, _SAME_MM = 0.01, 0.5
"""Up to this a camera stands where it did: files are rounded."""
_MOVED = (
    "%s: not where calibration.toml says (turned by %.1f degrees, moved by %.0f mm): the second run uses its "
    "place as the tracked body shows it"
)

log = logging.getLogger(__name__)

Moves = Mapping[str, tuple[float, float]]
"""By camera how far it was turned, in degrees, and moved, in millimetres."""


def disagree(cameras: tuple[Camera, ...], seen: TriPlanes, actor: Actor, poses: Floats) -> bool:
    """Whether a camera sees an actor in poses (F, D) clearly beside the silhouettes (F, P, H, W)."""
    return bool(offsets_px(cameras, seen, actor, poses).max() >= OFF_PX)


def placed(cameras: tuple[Camera, ...], seen: TriPlanes, actor: Actor, poses: Floats) -> tuple[Camera, ...]:
    """The cameras of silhouettes (F, P, H, W), moved to where an actor in poses (F, D) shows them, if they
    agree clearly better there with frames that were kept out; else as they are."""
    refined = refine_cameras(cameras, seen, actor, poses)
    before_px, after_px = (quality.energy_px.sum() for quality in (refined.before, refined.after))
    iou = refined.after.iou.mean(axis=0)
    is_unlike = ~refined.held & (iou < np.median(iou) - _BELOW_OTHERS)
    is_right = after_px <= (1.0 - _LEAST_GAIN) * before_px and not is_unlike.any()
    return refined.cameras if is_right else cameras


def moves_of(before: Take, after: Take) -> Moves:
    """How far the cameras of one take moved from those of another; those that did not are left out."""
    moves = {
        new.name: moved_by(old, new) for old, new in zip(before.calibrated, after.calibrated, strict=True)
    }
    return {name: (deg, mm) for name, (deg, mm) in moves.items() if deg > _SAME_DEG or mm > _SAME_MM}


def if_moved(before: Take, after: Take) -> Take | None:
    """The second of two takes, if some of its cameras moved."""
    return after if moves_of(before, after) else None


def warn_of_moved(before: Take, after: Take) -> None:
    """Say which cameras of a take were moved."""
    for name, move in moves_of(before, after).items():
        log.warning(_MOVED, name, *move)
