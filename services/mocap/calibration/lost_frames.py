"""Frames that one camera's video lacks, or has twice, in the middle of a take, found by silhouettes.

One offset for the whole take cannot mend them.
"""

from dataclasses import dataclass

import numpy as np

from services.mocap.calibration.epipolar_tangents import Outline, Touches, touches_of
from services.mocap.calibration.time_offsets import CAP_PX_PER_WIDTH, STEP
from services.mocap.camera.camera import Camera
from services.mocap.types import Floats

_REACH = 5
"""Half-frame offsets up to this many frames are tried before and after the place."""
_FEWEST_FRAMES = 8
"""Before and after the place."""
_LEAST_GAIN = 0.2
"""Cameras without such a place gain at most 0.16 (15 people, whole takes and parts of 60 frames); a lost
frame gains 0.2 to 0.7 where the actor moves before it and after it."""


@dataclass(frozen=True)
class LostFrames:
    """A place in one camera's video where frames are missing, or are there twice."""

    camera: int
    n_lost: int
    """Negative: so many frames are there twice."""
    first_after: int
    """The first frame of the video that shows a later (earlier) moment than it should."""
    gain: float
    """0 to 1: how far the camera's error falls with one offset before the place and another one after it."""

    def __str__(self) -> str:
        n = abs(self.n_lost)
        frames = "1 frame" if n == 1 else f"{n} frames"
        return f"{frames} {'missing' if self.n_lost > 0 else 'too many'} at about frame {self.first_after}"


def find_lost_frames(
    cameras: tuple[Camera, ...], outlines: list[list[Outline | None]], offsets: Floats
) -> LostFrames | None:
    """The camera that agrees much better with the others with one offset up to some frame and another one
    from there on; None: there is none.

    outlines: per camera, of consecutive frames. offsets: (C,) of the whole, as find_offsets returns them.
    """
    ahead = np.rint(offsets).astype(int).tolist()
    in_step = [[*of_camera[n:], *[None] * n] for of_camera, n in zip(outlines, ahead, strict=True)]
    pairs = touches_of(cameras, in_step)
    pairs += [pair.reversed() for pair in pairs]
    cap_px = CAP_PX_PER_WIDTH * float(np.median([camera.width_px for camera in cameras]))
    found = [_best_place(c, [p for p in pairs if p.first == c], cap_px) for c in range(len(cameras))]
    best = max((place for place in found if place is not None), key=lambda place: place.gain, default=None)
    if best is None or best.gain < _LEAST_GAIN:
        return None
    return LostFrames(best.camera, best.n_lost, best.first_after + ahead[best.camera], best.gain)


def _best_place(camera: int, pairs: list[Touches], cap_px: float) -> LostFrames | None:
    """The place at which two offsets of a camera gain most; None if one is as good, or little is known.

    pairs: of this camera with the others.
    """
    if not pairs:
        return None
    steps = np.arange(-_REACH, _REACH + STEP / 2, STEP)
    off_px = np.array([[pair.off_px(-step) for step in steps] for pair in pairs])
    is_known = np.isfinite(off_px).all(axis=1)  # off_px is (P, G, F, 2)
    cost_px = np.where(is_known[:, None], np.minimum(off_px, cap_px), 0.0).sum(axis=(0, 3))
    places = np.flatnonzero(is_known.any(axis=(0, 2)))[_FEWEST_FRAMES : 1 - _FEWEST_FRAMES]
    if not places.size:
        return None
    before_px = np.cumsum(cost_px, axis=1)
    one_px, left_px = before_px[:, -1:], before_px[:, places - 1]
    two_px = left_px[:, None] + (one_px - left_px)[None]
    a, b, k = np.unravel_index(two_px.argmin(), two_px.shape)
    n_lost = round(float(steps[a] - steps[b]))
    if n_lost == 0 or one_px.min() <= 0:
        return None
    return LostFrames(camera, n_lost, int(places[k]), float(1 - two_px[a, b, k] / one_px.min()))
