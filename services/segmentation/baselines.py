"""Published background tests, to compare with: the paper's and OpenCV's, each camera by itself.

The paper's (section 3): statistics of the clean plate, pixel by pixel, tell foreground from background, and a
limit on the turn of the colour tells cast shadow from the actor.
"""

from collections.abc import Iterable
from math import radians, tan
from typing import Any

import numpy as np

from services.mocap.energy.bitplanes import trimap_of
from services.mocap.types import Bytes, Mask, Trimap
from services.segmentation.cleanup import cleanup
from services.segmentation.comparison import Comparison
from services.segmentation.pixels import MEAN_STEPS, Levels
from services.segmentation.plate import Plate
from services.segmentation.plate_noise import check_size

_SHADOW_SIGMAS = 3.0
"""How many deviations of noise may add to the turn of a shadow's colour."""
_DISTANCE_SIGMAS = 5.0
"""Standard deviations from the clean plate at which the published test ends the background."""
_SHADOW_RATIO_MIN, _SHADOW_ANGLE_DEG = 0.45, 2.5
"""Brightness of its darkest shadow over that in light, and how far shadow may turn a colour, a BGR vector."""
_FOREGROUND = 255
"""In OpenCV's masks; shadow has 127."""
_LEAST_LOOKS = 30
"""Looks at the plate that a model of OpenCV's needs; a plate of fewer pictures is shown again."""


class TrainedModel:
    """Silhouettes by a background model of OpenCV's, trained once: each picture is judged by itself."""

    def __init__(self, model: Any, plate: Iterable[Bytes]) -> None:
        """Plate: pictures (H, W, 3) of the empty scene, one or more, from which the model learns."""
        self._model = model
        pictures = list(plate)
        for _ in range(-(-_LEAST_LOOKS // max(len(pictures), 1))):
            for picture in pictures:
                model.apply(picture)

    def trimap(self, image_bgr: Bytes) -> Trimap:
        """See Matte.trimap; no pixel is unsure."""
        marked = np.asarray(self._model.apply(image_bgr, learningRate=0))
        return trimap_of(cleanup(marked == _FOREGROUND))


class PaperTest:
    """Compares a camera's pictures with its clean plate. Made by `learn`."""

    def __init__(self, plate: Plate) -> None:
        self._comparison = Comparison(plate)

    @staticmethod
    def learn(frames: Iterable[Bytes]) -> "PaperTest":
        """From BGR uint8 frames (H, W, 3) of the empty stage; raises UserError as Plate.learn does."""
        return PaperTest(Plate.learn(frames))

    def trimap(self, image_bgr: Bytes) -> Trimap:
        """See Matte.trimap; depends on this image alone. Raises UserError where it is not of the plate's
        size."""
        return trimap_of(cleanup(self.foreground(image_bgr)))

    def foreground(self, image_bgr: Bytes) -> Mask:
        """The pixels that differ from the plate and are not shadow: a mask (H, W), including specks."""
        plate = self._comparison.plate
        check_size(image_bgr, plate.shape, "image", "the clean plate")
        gains = self._comparison.compare(image_bgr, light_varies=False)
        differs = np.asarray(self._comparison.deviation2 > _DISTANCE_SIGMAS**2)
        seen = np.array([channel[differs] for channel in np.moveaxis(image_bgr, 2, 0)], np.float32)
        mean = np.array([channel[differs] for channel in plate.mean])
        differs[differs] = ~_is_shadow(seen, gains[:, None] / MEAN_STEPS * mean, plate.turn_noise[differs])
        return differs


def _is_shadow(seen: Levels, lit: Levels, turn_noise: Levels) -> Mask:
    """Which of some pixels (3, N) show background in shadow: darker, not too dark, same colour.

    lit (3, N): the background in this picture's light. turn_noise (N,): see Plate.

    The turn of colour is the angle between the BGR vectors. Hue itself is undefined on grey walls and
    noisy near them, while a grey wall's vector is as well defined as any: navy before grey turns it by
    tens of degrees, shadow by hardly any. Noise turns dark colours further than bright ones, so its
    share is granted in levels, not in degrees.
    """
    along, expected = (seen * lit).sum(axis=0), (np.minimum(lit, 255) * lit).sum(axis=0)
    along_levels = along / np.sqrt(np.maximum((lit * lit).sum(axis=0), 1))
    allowed = along_levels * tan(radians(_SHADOW_ANGLE_DEG)) + _SHADOW_SIGMAS * turn_noise
    is_same_colour = (seen * seen).sum(axis=0) - along_levels**2 <= allowed**2
    return np.asarray((_SHADOW_RATIO_MIN * expected <= along) & (along < expected) & is_same_colour)
