"""Which pixels are unsure: cut off, or kept, against what their own colours or the other cameras say."""

import cv2
import numpy as np

from services.mocap.types import Bytes, Mask
from services.segmentation.cleanup import SPECK_AREA_PPM, drop_specks, opened
from services.segmentation.pixels import Levels

HARDLY_AGAINST = -2.2
"""Log odds of a pixel (its own evidence plus the other cameras') above which it may be unsure instead of
background."""
_UNLIKE, _UNLIKE_BESIDE = np.float32(-1.7), np.float32(-1.0)
"""Mean evidence of a pixel and its neighbours below which it is background all the same: one pixel that looks
like an even wall is hardly evidence where the actor wears its colour, a whole patch is. The second value
holds with few cameras, outside gaps of the actor: of the pixels between the two values, 44 % are the actor's
in gaps and 3 % elsewhere (five takes with three and four cameras)."""
_GAP_PERMILLE = 40
"""Width of a gap, as a share of the picture's longer side: about that of an arm."""
_SLIGHTLY_AGAINST = -0.5
"""Own evidence below which only its neighbours make a pixel the actor's."""
_TELLING = -0.5
"""Prior odds above which the other cameras count as seeing the actor along a pixel's ray."""


def unsure_pixels(
    actor: Bytes, own: Levels, prior: Levels, shape_px: tuple[int, int], *, has_few_cameras: bool
) -> Mask:
    """Which pixels (h, w) of a part of a picture are unsure.

    actor (h, w): 1 where the pixel was taken for the actor's. own, prior (h, w): log odds of the actor by the
    pixel's own colours, and by what the other cameras see. shape_px: of the whole picture. has_few_cameras:
    few other cameras exclude little of the space about the actor. A patch in it that looks about like the
    stage is then background, except in gaps; if it were unsure, the search would hide limbs there.
    """
    around = cv2.blur(own, (5, 5))
    is_unlike = around <= _UNLIKE
    if has_few_cameras:
        half_px = round(_GAP_PERMILLE * 5e-4 * max(shape_px))
        is_unlike |= (around <= _UNLIKE_BESIDE) & ~_closed(actor, half_px)
    kept_against = (own < _SLIGHTLY_AGAINST) & (prior <= _TELLING)
    cut_against = (own + prior > HARDLY_AGAINST) & ~is_unlike
    unsure = opened(np.where(actor > 0, kept_against, cut_against), 3)
    drop_specks(unsure, SPECK_AREA_PPM * 1e-6 * shape_px[0] * shape_px[1])
    return np.asarray(unsure > 0)


def _closed(actor: Bytes, half_px: int) -> Mask:
    """The actor (h, w) with its gaps of up to twice half_px, and nothing at the edges of the part."""
    square = np.ones((2 * half_px + 1,) * 2, np.uint8)
    closed = cv2.morphologyEx(np.pad(actor, half_px), cv2.MORPH_CLOSE, square)
    return np.asarray(closed[half_px:-half_px, half_px:-half_px] > 0)
