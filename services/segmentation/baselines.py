"""Published background tests, to compare with: the paper's and OpenCV's, each camera by itself.

The paper's (section 3): statistics of the clean plate, pixel by pixel, tell foreground from background, and a
limit on the turn of the colour tells cast shadow from the actor.
"""

from collections.abc import Iterable
from math import radians, tan
from typing import Any

import numba
import numpy as np

from services.mocap.energy.bitplanes import trimap_of
from services.mocap.types import Bytes, Mask, Trimap
from services.segmentation.cleanup import cleanup
from services.segmentation.comparison import Comparison
from services.segmentation.pixels import MEAN_STEPS, Levels, Steps
from services.segmentation.plate import Plate
from services.segmentation.plate_noise import check_size

_SHADOW_SIGMAS = np.float32(3)
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
        return PaperTest(Plate.learn(frames, of_codec=False))

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
        _drop_shadow(
            differs, image_bgr, gains / np.float32(MEAN_STEPS), plate.mean, plate.turn_noise,
            np.float32(_SHADOW_RATIO_MIN), np.float32(tan(radians(_SHADOW_ANGLE_DEG))),
        )  # fmt: skip
        return differs


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _drop_shadow(
    differs: Mask, image_bgr: Bytes, gains: Levels, mean: Steps, turn_noise: Levels, ratio_min: np.float32,
    tangent: np.float32,
) -> None:  # fmt: skip
    """Clear pixels of a mask (H, W) that show background in shadow: darker, not too dark, same colour.

    The turn of colour is the angle between the BGR vectors. Hue itself is undefined on grey walls and
    noisy near them, while a grey wall's vector is as well defined as any: navy before grey turns it by
    tens of degrees, shadow by hardly any. Noise turns dark colours further than bright ones, so its
    share is granted in levels, not in degrees.
    """
    for y in range(differs.shape[0]):
        for x in range(differs.shape[1]):
            if differs[y, x]:
                along = expected = length2 = seen2 = np.float32(0)
                for c in range(3):
                    seen, lit = np.float32(image_bgr[y, x, c]), gains[c] * np.float32(mean[c, y, x])
                    along += seen * lit
                    expected += min(lit, np.float32(255)) * lit
                    length2 += lit * lit
                    seen2 += seen * seen
                along_levels = along / np.sqrt(max(length2, np.float32(1)))
                allowed = along_levels * tangent + _SHADOW_SIGMAS * turn_noise[y, x]
                is_same_colour = seen2 - along_levels * along_levels <= allowed * allowed
                differs[y, x] = not (ratio_min * expected <= along < expected and is_same_colour)
