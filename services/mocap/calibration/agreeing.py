"""Whether a take's cameras agree, by their silhouettes alone, and which one does not."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from services.mocap.calibration.epipolar_tangents import Outline, Touches, touches_of
from services.mocap.camera.camera import Camera
from services.mocap.types import Floats

_OFF_PER_WIDTH = 0.005
"""Two good cameras' silhouettes touch the same planes to within this share of the width, 1.6 px of 320."""
_DECISIVE = 2.0
"""How many times less a camera must be off, once turned or mirrored, for that to be what is wrong with it."""
_FEWEST_LEFT = 2


@dataclass(frozen=True, eq=False)
class Agreement:
    """What the silhouettes say of all cameras."""

    off_px: Floats
    """(C,) how far the planes that touch the actor are apart between a camera and those that agree; NaN where
    nothing can be said."""
    limit_px: float
    """From here on a camera does not agree."""
    odd: tuple[int, ...]
    """Cameras that do not agree with the others, the worst first."""


def agreement_of(cameras: tuple[Camera, ...], outlines: list[list[Outline | None]]) -> Agreement:
    """The fewest cameras to blame: the worst is left out until all others agree.

    outlines: per camera, of each frame. Of two that disagree neither can be blamed: then both are odd.
    """
    off_px = pair_matrix(len(cameras), touches_of(cameras, outlines))
    limit_px = _OFF_PER_WIDTH * float(np.median([camera.width_px for camera in cameras]))
    left = [c for c in range(len(cameras)) if np.isfinite(off_px[c]).any()]
    odd: list[int] = []
    while len(left) > _FEWEST_LEFT:
        each = np.array([_typical(off_px, c, left) for c in left])
        if not (each > limit_px).any():
            break
        odd.append(left.pop(int(np.nanargmax(each))))
    if len(left) == _FEWEST_LEFT and _typical(off_px, left[0], left) > limit_px:
        odd += left
    good = [c for c in left if c not in odd] or left
    each = np.array([_typical(off_px, c, [*good, c]) for c in range(len(cameras))])
    return Agreement(each, limit_px, tuple(odd))


def pair_matrix(n_cameras: int, pairs: Sequence[Touches]) -> Floats:
    """(C, C) how far each two cameras are apart in the median frame; NaN where nothing can be said."""
    off_px = np.full((n_cameras, n_cameras), np.nan)
    for pair in pairs:
        off = pair.off_px(0.0)
        if np.isfinite(off).any():
            off_px[pair.first, pair.second] = off_px[pair.second, pair.first] = float(np.nanmedian(off))
    return off_px


def likely_mistake(
    camera: int,
    cameras: tuple[Camera, ...],
    others: list[int],
    outlines: list[list[Outline | None]],
    off_px: float,
) -> str | None:
    """What would make an odd camera agree with others that do: its pictures turned, or mirrored."""
    for words, flip in (("upside down", (-1.0, -1.0)), ("mirrored", (-1.0, 1.0))):
        flipped = [_flipped(outline, cameras[camera], flip) for outline in outlines[camera]]
        chosen = (*(cameras[c] for c in others), cameras[camera])
        found = pair_matrix(len(chosen), touches_of(chosen, [*(outlines[c] for c in others), flipped]))
        if _typical(found, len(others), list(range(len(chosen)))) * _DECISIVE < off_px:
            return words
    return None


def _typical(off_px: Floats, camera: int, among: list[int]) -> float:
    known = [
        off_px[camera, other] for other in among if other != camera and np.isfinite(off_px[camera, other])
    ]
    return float(np.median(known)) if known else float("nan")


def _flipped(outline: Outline | None, camera: Camera, flip: tuple[float, float]) -> Outline | None:
    """An outline in pictures that are flipped about their middle."""
    if outline is None:
        return None
    in_camera = outline.rays_world @ camera.R_camera_world.T
    pixel = in_camera @ camera.K.T
    middle = np.array([camera.width_px - 1, camera.height_px - 1]) / 2
    pixel = (pixel[:, :2] / pixel[:, 2:] - middle) * flip + middle
    rays = np.column_stack([pixel, np.ones(len(pixel))]) @ np.linalg.inv(camera.K).T @ camera.R_camera_world
    return Outline(rays / np.linalg.norm(rays, axis=1, keepdims=True), outline.cut_off)
