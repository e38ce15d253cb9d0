"""What turns a raw foreground mask into a silhouette: specks, small holes and half-covered edge pixels.

The settings of the whole segmentation stand here too. Lengths and areas are given relative to the
picture, so that one set of values serves 320x240 and 1920x1080.
"""

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from services.mocap.types import Mask

Levels: TypeAlias = NDArray[np.float32]
"""Pixel values from 0 to 255 and what is computed from them; single precision, for speed."""

_MIN_CONTRAST_LEVELS = 15.0  # below it, noise decides on which side of the middle a mixed pixel falls
_MIN_PURITY = 1e-3


class SegmentationSettings(BaseModel):
    """How pictures become silhouettes; a level is one step of an 8-bit channel."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)

    distance_sigmas: float = Field(5.0, gt=0)
    """a number over 0: standard deviations from the clean plate at which background ends"""
    noise_floor_levels: float = Field(1.5, gt=0)
    """levels over 0, per channel: deviation that a plate does not show (rounding, a codec's still scene)"""
    assumed_noise_levels: float = Field(2.5, gt=0)
    """levels over 0, per channel: the camera's noise, assumed where the plate is a single picture"""
    flicker_limit: float = Field(0.25, ge=0, lt=1)
    """a number from 0 to below 1: largest relative change of exposure that is evened out"""
    shadow_ratio_min: float = Field(0.4, gt=0, le=1)
    """a number over 0, at most 1: brightness of the darkest shadow over that of the lit background"""
    shadow_angle_deg: float = Field(4.0, ge=0, lt=90)
    """degrees from 0 to below 90: how far a shadow may turn the background's colour, a BGR vector"""
    speck_area_ppm: float = Field(200.0, ge=0)
    """millionths of the picture's area, 0 or more: smaller foreground patches go (200: 15 px of 320x240)"""
    hole_area_ppm: float = Field(100.0, ge=0)
    """millionths of the picture's area, 0 or more: smaller holes are filled (100: 7 px of 320x240)"""
    edge_width_permille: float = Field(6.25, ge=0, le=50)
    """thousandths of the picture's width, 0 to 50: rim of mixed colours (6.25: 2 px of 320; 0: none)"""
    edge_misfit: float = Field(0.4, gt=0)
    """a number over 0: how far a mixed colour may lie off the line between its two, over their distance"""


def cleanup(mask: Mask, settings: SegmentationSettings) -> Mask:
    """A silhouette (H, W) without specks and small holes; the mask (H, W) itself stays as it is.

    Nothing is eroded or dilated: thin limbs keep their width, and a gap between arm and body or between
    the legs stays open unless it is smaller than `hole_area_ppm` and off the picture's border. Cleaning
    twice changes nothing more, and a larger mask never gives a smaller silhouette.
    """
    solid = mask & ~_small_patches(mask, settings.speck_area_ppm, connectivity=8)
    # Four-connected outside goes with eight-connected inside: a diagonal line of actor closes a hole.
    holes = _small_patches(~solid, settings.hole_area_ppm, connectivity=4, enclosed=True)
    return solid | holes


def settle_edges(mask: Mask, picture: Levels, background: Levels, settings: SegmentationSettings) -> Mask:
    """The mask (H, W) with each pixel of its rim given to whom more than half of it belongs.

    picture, background: (H, W, 3), the background as this picture would show it without the actor.

    A statistical test takes every pixel that differs at all, which makes silhouettes half a pixel too fat
    all round. A rim pixel mixes actor and background, and the colours on both sides of it tell in which
    shares. Where no such mix explains its colour, or the two sides look alike, the mask stands.
    """
    rim_px = settings.edge_width_permille * 1e-3 * mask.shape[1]
    view = _extent(mask, settings.speck_area_ppm, margin_px=round(3 * rim_px))
    if rim_px == 0 or view is None:
        return mask
    settled = mask.copy()
    _settle(settled[view], picture[view], background[view], rim_px, settings.edge_misfit)
    return settled


def _settle(mask: Mask, picture: Levels, background: Levels, rim_px: float, misfit: float) -> None:
    """Settle the edges of a mask in place."""
    inside_px, outside_px = _depth(mask), _depth(~mask)
    size = 2 * round(1.5 * rim_px) + 1
    # The deeper in the body, the purer its colour; where a limb is thin, its middle line must do.
    purity = np.minimum(inside_px, rim_px + 1) ** 4
    beyond = (outside_px > rim_px).astype(np.float32)
    weight = _box(purity, size)
    rim = ((inside_px <= rim_px) & (outside_px <= max(1, rim_px / 2)) & (weight > _MIN_PURITY)).nonzero()

    actor = _box(purity[..., None] * picture, size)[rim] / weight[rim][:, None]
    # Beside the feet the floor lies in shadow: as dark at the rim as nearby beyond it.
    lit = _box(beyond * _dot(background, background), size)[rim]
    seen = _box(beyond * _dot(picture, background), size)[rim]
    behind = background[rim] * ((seen + 1) / (lit + 1))[:, None]

    span, offset = actor - behind, picture[rim] - behind
    length2 = np.maximum(_dot(span, span), 1)
    share = _dot(offset, span) / length2
    off_line = offset - share[:, None] * span
    explained = (length2 > _MIN_CONTRAST_LEVELS**2) & (_dot(off_line, off_line) < misfit**2 * length2)
    mask[rim] = np.where(explained, share > 0.5, mask[rim])


def _patches(
    mask: Mask, area_ppm: float, connectivity: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], Mask]:
    """Labels (H, W), their left, top, width, height and area (N, 5), and which are below an area (N,)."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=connectivity)
    small: Mask = stats[:, cv2.CC_STAT_AREA] < area_ppm * 1e-6 * mask.size
    return labels.astype(np.int32, copy=False), stats.astype(np.int32, copy=False), small


def _small_patches(mask: Mask, area_ppm: float, connectivity: int, enclosed: bool = False) -> Mask:
    """The connected patches of the mask below an area; if enclosed, only those off the picture's border."""
    labels, stats, small = _patches(mask, area_ppm, connectivity)
    if enclosed:
        left, top, across, down, _ = stats.T
        small &= (left > 0) & (top > 0) & (left + across < mask.shape[1]) & (top + down < mask.shape[0])
    small[0] = False  # the label of all that is not mask
    return small.take(labels)


def _extent(mask: Mask, area_ppm: float, margin_px: int) -> tuple[slice, slice] | None:
    """Rows and columns of all patches that are no specks, and a margin; None where there are none."""
    _, stats, small = _patches(mask, area_ppm, connectivity=8)
    left, top, across, down, _ = stats[1:][~small[1:]].T
    if left.size == 0:
        return None
    rows = slice(max(int(top.min()) - margin_px, 0), int((top + down).max()) + margin_px)
    columns = slice(max(int(left.min()) - margin_px, 0), int((left + across).max()) + margin_px)
    return rows, columns


def _dot(first: Levels, second: Levels) -> Levels:
    """Scalar products over the last axis."""
    products: Levels = np.einsum("...c,...c->...", first, second)
    return products


def _box(values: Levels, size: int) -> Levels:
    """Sums over square neighbourhoods."""
    return cv2.boxFilter(values, -1, (size, size), normalize=False).astype(np.float32, copy=False)


def _depth(mask: Mask) -> Levels:
    """Distance of the mask's pixels to the nearest pixel outside it; 0 outside."""
    return cv2.distanceTransform(mask.view(np.uint8), cv2.DIST_L2, 5).astype(np.float32, copy=False)
