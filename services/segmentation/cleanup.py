"""What turns a raw foreground mask into a silhouette: specks and small holes.

The settings of the whole segmentation stand here too. Lengths and areas are given relative to the
picture, so that one set of values serves 320x240 and 1920x1080.
"""

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from services.mocap.types import Bytes, Mask
from services.segmentation.patches import drop_specks, fill_holes


class SegmentationSettings(BaseModel):
    """How pictures become silhouettes; a level is one step of an 8-bit channel."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)

    distance_sigmas: float = Field(5.0, gt=0)
    """a number over 0: standard deviations from the clean plate at which background ends"""
    noise_floor_levels: float = Field(1.5, gt=0)
    """levels over 0, per channel: deviation that a plate does not show (rounding, a codec's still scene)"""
    assumed_noise_levels: float = Field(2.5, gt=0)
    """levels over 0, per channel: the camera's noise, assumed where the plate is a single picture"""
    flicker_limit: float = Field(0.4, ge=0, lt=1)
    """a number from 0 to below 1: largest relative change of exposure that is evened out"""
    shadow_ratio_min: float = Field(0.45, gt=0, le=1)
    """a number over 0, at most 1: brightness of the darkest shadow over that of the lit background"""
    shadow_angle_deg: float = Field(2.5, ge=0, lt=90)
    """degrees from 0 to below 90: how far a shadow may turn the background's colour, a BGR vector"""
    speck_area_ppm: float = Field(200.0, ge=0)
    """millionths of the picture's area, 0 or more: smaller foreground patches go (200: 15 px of 320x240)"""
    hole_area_ppm: float = Field(100.0, ge=0)
    """millionths of the picture's area, 0 or more: smaller holes are filled (100: 7 px of 320x240)"""
    edge_width_permille: float = Field(4.7, ge=0, le=50)
    """thousandths of the picture's width, 0 to 50: rim of mixed colours (4.7: 1.5 px of 320; 0: none)"""
    edge_misfit: float = Field(0.4, gt=0)
    """a number over 0: how far a mixed colour may lie off the line between its two, over their distance"""


def cleanup(mask: Mask, settings: SegmentationSettings) -> Mask:
    """A silhouette (H, W) without specks and small holes; the mask (H, W) itself stays as it is.

    Nothing is eroded or dilated: thin limbs keep their width, and a gap between arm and body or between
    the legs stays open unless it is smaller than `hole_area_ppm` and off the picture's border. Cleaning
    twice changes nothing more, and a larger mask never gives a smaller silhouette.
    """
    clean = mask.astype(np.uint8)
    cleanup_in_place(clean, mask.size, settings)
    return clean.view(np.bool_)


def cleanup_in_place(part: Bytes, picture_px: int, settings: SegmentationSettings) -> None:
    """Clean a mask (h, w) of zeros and ones: a picture of so many pixels, or all that is set in it."""
    drop_specks(part, settings.speck_area_ppm * 1e-6 * picture_px)
    fill_holes(part, settings.hole_area_ppm * 1e-6 * picture_px)
