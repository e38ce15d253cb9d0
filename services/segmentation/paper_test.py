"""Silhouettes by the published test: colour statistics of the clean plate, and how far a colour is turned.

Per-pixel statistics tell foreground from background, and a limit on the turn of the colour tells cast shadow
from the actor (the paper, section 3). The baseline: each camera by itself, no border settled.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import radians, tan

import cv2
import numpy as np

from services.mocap.types import ACTOR, Bytes, Mask, Trimap
from services.segmentation.cleanup import SegmentationSettings, cleanup
from services.segmentation.pixels import drop_shadow, mark_differences
from services.segmentation.plate import Plate, check_size


@dataclass(frozen=True, eq=False)
class PaperTest:
    """Tells a camera's pictures from its clean plate. Made by `learn`."""

    plate: Plate
    channels: Bytes
    """(3, H, W) room for the picture in work: blue, green and red."""

    @staticmethod
    def learn(frames: Iterable[Bytes], settings: SegmentationSettings) -> "PaperTest":
        """From BGR uint8 frames (H, W, 3) of the empty stage; raises UserError as Plate.learn does."""
        plate = Plate.learn(frames, settings)
        return PaperTest(plate, np.empty((3, *plate.shape), np.uint8))

    def trimap(self, image_bgr: Bytes) -> Trimap:
        """See Matte.trimap; depends on this image alone. Raises UserError where it is not of the plate's
        size."""
        return cleanup(self.foreground(image_bgr), self.plate.settings) * np.uint8(ACTOR)

    def foreground(self, image_bgr: Bytes) -> Mask:
        """What differs from the plate and is no shadow, pixel by pixel: a mask (H, W), specks included."""
        plate, settings = self.plate, self.plate.settings
        check_size(image_bgr, plate.shape, "image", "the clean plate")
        height, width = plate.shape
        gains = plate.gauge.gains(image_bgr, settings.flicker_limit)
        whole = np.zeros((height, -(-width // 8) * 8), np.uint8)
        cv2.split(image_bgr, list(self.channels))
        mark_differences(self.channels, gains, plate.mean, plate.whitening, settings.distance_sigmas, whole)
        drop_shadow(
            whole, whole.view(np.uint64), self.channels, gains, plate.mean, plate.turn_noise,
            settings.shadow_ratio_min, tan(radians(settings.shadow_angle_deg)),
        )  # fmt: skip
        return whole[:, :width].view(np.bool_)
