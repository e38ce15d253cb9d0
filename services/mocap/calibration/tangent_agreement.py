"""Whether cameras agree, and which do not, by the planes that touch the actor in the pictures of two."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from services.mocap.calibration.epipolar_tangents import Outline, Touches, touches_of
from services.mocap.camera.camera import Camera
from services.mocap.types import Floats

_OFF_PER_WIDTH = 0.005
"""Two good cameras' silhouettes touch the same planes to within this share of the width, 1.6 px of 320."""
_DECISIVE = 2.0
"""Factor by which a camera's error must fall when its pictures are turned or mirrored, to conclude that they
are."""
_FEWEST_LEFT = 2


@dataclass(frozen=True, eq=False)
class TangentAgreement:
    """The agreement of all cameras."""

    off_px: Floats
    """(C,) distance of the tangent planes to the actor between a camera and those that agree; NaN if
    unknown."""
    odd: tuple[int, ...]
    """Cameras that do not agree with the others, the worst first."""


def agreement_of(cameras: tuple[Camera, ...], outlines: list[list[Outline | None]]) -> TangentAgreement:
    """Find the cameras that disagree: the worst is left out until all others agree.

    outlines: per camera, of each frame. If two disagree it is unknown which is wrong: then both are odd.
    """
    off_px = pair_matrix(len(cameras), touches_of(cameras, outlines))
    limit_px = agreement_limit_px(cameras)
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
    return TangentAgreement(each, tuple(odd))


def agreement_limit_px(cameras: Sequence[Camera]) -> float:
    """The error up to which cameras agree."""
    return _OFF_PER_WIDTH * float(np.median([camera.width_px for camera in cameras]))


def pair_matrix(n_cameras: int, pairs: Sequence[Touches]) -> Floats:
    """(C, C) error of each pair of cameras in the median frame; NaN if unknown."""
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
    """What makes an odd camera agree with the others: turning its pictures, or mirroring them."""
    for words, flip in (("upside down", (-1.0, -1.0)), ("mirrored", (-1.0, 1.0))):
        flipped = [o and o.in_camera(cameras[camera], flip=flip) for o in outlines[camera]]
        chosen = (*(cameras[c] for c in others), cameras[camera])
        found = pair_matrix(len(chosen), touches_of(chosen, [*(outlines[c] for c in others), flipped]))
        if _typical(found, len(others), list(range(len(chosen)))) * _DECISIVE < off_px:
            return words
    return None


def _typical(off_px: Floats, camera: int, among: list[int]) -> float:
    """How far a camera is off in the median of its pairs with some others; NaN where none says anything."""
    off = [off_px[camera, other] for other in among if other != camera]
    return float(np.nanmedian(off)) if np.isfinite(off).any() else float("nan")
