"""Frames that one camera's recording lacks, or has twice, in the middle of a take, found by silhouettes.

One offset for the whole take cannot mend them.
"""

from dataclasses import dataclass

import numpy as np

from services.mocap.calibration.epipolar_tangents import Outline, Touches, touches_of
from services.mocap.calibration.time_offsets import CAP_PX_PER_WIDTH, STEP
from services.mocap.camera.camera import Camera
from services.mocap.types import Floats

_REACH = 5
"""Offsets up to this many frames, in half frames, are tried before and after the place."""
_FEWEST_FRAMES = 12
"""So many frames that show the actor at all these offsets must lie on either side of the place."""
_NEAR_FRAMES = 60
"""The gain is measured over this many frames before the place and after it, as in a long take it would be a
small share of all errors."""
_FEWEST_PAIRS = 2
"""With one other camera alone it is not known which of both lacks frames."""
_LEAST_GAIN = 0.25
"""Cameras without such a place gain at most 0.17 (15 people, whole takes and parts of 60 frames); a lost
frame gains 0.2 to 0.8 where the actor moves before it and after it."""


@dataclass(frozen=True)
class LostFrames:
    """A place in one camera's recording where frames are missing, or are there twice."""

    camera: int
    n_lost: int
    """Negative: so many frames are there twice. _REACH stands for more as well."""
    first_after: int
    """Of the outlines: the first one that shows a later (earlier) moment than it should."""
    gain: float
    """0 to 1: how far the camera's error falls with one offset before the place and another one after it."""

    def __str__(self) -> str:
        n = abs(self.n_lost)
        frames = "1 frame" if n == 1 else f"{n} frames or more" if n >= _REACH else f"{n} frames"
        return f"{frames} {'missing' if self.n_lost > 0 else 'too many'}"


def find_lost_frames(
    cameras: tuple[Camera, ...], outlines: list[list[Outline | None]], offsets: Floats
) -> LostFrames | None:
    """The place where one camera's frames are missing, or are there twice; None if there is none.

    There, the camera agrees much better with at least two others if it has one offset before and another one
    after. outlines: per camera, of consecutive frames. offsets: (C,) of the whole, as find_offsets returns
    them. Where several cameras have such places, the one that gains most is returned.
    """
    pairs = touches_of(cameras, outlines)
    pairs += [pair.reversed() for pair in pairs]
    cap_px = CAP_PX_PER_WIDTH * float(np.median([camera.width_px for camera in cameras]))
    found = [_best_place(c, [p for p in pairs if p.first == c], offsets, cap_px) for c in range(len(cameras))]
    best = max((lost for lost in found if lost is not None), key=lambda lost: lost.gain, default=None)
    return best if best is not None and best.gain >= _LEAST_GAIN else None


def _best_place(camera: int, pairs: list[Touches], offsets: Floats, cap_px: float) -> LostFrames | None:
    """The place at which two offsets of a camera gain most; None if one is as good, or little is known.

    pairs: of this camera with the others.
    """
    if len(pairs) < _FEWEST_PAIRS:
        return None
    later = np.arange(-_REACH, _REACH + STEP / 2, STEP)
    off_px = np.array(  # (pairs, offsets, frames of this camera, lower and upper)
        [[pair.off_px(offsets[pair.second] - offsets[camera] - step) for step in later] for pair in pairs]
    )
    is_known = np.isfinite(off_px).all(axis=1)
    if is_known.any(axis=(1, 2)).sum() < _FEWEST_PAIRS:
        return None
    places = np.flatnonzero(is_known.any(axis=(0, 2)))[_FEWEST_FRAMES : 1 - _FEWEST_FRAMES]
    if not places.size:
        return None
    cost_px = np.where(is_known[:, None], np.minimum(off_px, cap_px), 0.0).sum(axis=(0, 3))
    before_px = np.cumsum(cost_px, axis=1)[:, places - 1]
    after_px = cost_px.sum(axis=1, keepdims=True) - before_px
    two_px = before_px[:, None] + after_px[None]
    a, b, k = np.unravel_index(two_px.argmin(), two_px.shape)
    place = int(places[k])
    near_before = cost_px[:, max(place - _NEAR_FRAMES, 0) : place].sum(axis=1)
    near_after = cost_px[:, place : place + _NEAR_FRAMES].sum(axis=1)
    one_px = float((near_before + near_after).min())
    n_lost = int(np.floor(later[a] - later[b] + 0.5))
    if n_lost == 0 or one_px <= 0:
        return None
    return LostFrames(camera, n_lost, place, 1 - float(near_before[a] + near_after[b]) / one_px)
