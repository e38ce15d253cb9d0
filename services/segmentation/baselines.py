"""Published background tests, to compare with: the paper's and OpenCV's, each camera by itself.

The paper's (section 3): statistics of the clean plate, pixel by pixel, tell foreground from background, and a
limit on the turn of the colour tells cast shadow from the actor.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import radians, tan
from typing import Any

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from services.mocap.energy.bitplanes import trimap_of
from services.mocap.types import Bytes, Mask, Trimap
from services.segmentation.cleanup import cleanup
from services.segmentation.pixels import BB, GB, GG, MEAN_STEPS, RB, RG, RR, WHITENING_STEPS, Levels, Steps
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


@dataclass(frozen=True, eq=False)
class PaperTest:
    """Compares a camera's pictures with its clean plate. Made by `learn`."""

    plate: Plate
    channels: Bytes
    """(3, H, W) buffer for the current picture: blue, green and red."""

    @staticmethod
    def learn(frames: Iterable[Bytes]) -> "PaperTest":
        """From BGR uint8 frames (H, W, 3) of the empty stage; raises UserError as Plate.learn does."""
        plate = Plate.learn(frames, of_codec=False)
        return PaperTest(plate, np.empty((3, *plate.shape), np.uint8))

    def trimap(self, image_bgr: Bytes) -> Trimap:
        """See Matte.trimap; depends on this image alone. Raises UserError where it is not of the plate's
        size."""
        return trimap_of(cleanup(self.foreground(image_bgr)))

    def foreground(self, image_bgr: Bytes) -> Mask:
        """The pixels that differ from the plate and are not shadow: a mask (H, W), including specks."""
        plate = self.plate
        check_size(image_bgr, plate.shape, "image", "the clean plate")
        gains = plate.gauge.gains(image_bgr)
        height, width = plate.shape
        whole = np.zeros((height, -(-width // 8) * 8), np.uint8)
        cv2.split(image_bgr, list(self.channels))
        _mark_differences(self.channels, gains, plate.mean, plate.whitening, _DISTANCE_SIGMAS, whole)
        _drop_shadow(
            whole, whole.view(np.uint64), self.channels, gains, plate.mean, plate.turn_noise,
            _SHADOW_RATIO_MIN, tan(radians(_SHADOW_ANGLE_DEG)),
        )  # fmt: skip
        return whole[:, :width].view(np.bool_)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _mark_differences(
    channels: Bytes, gains: Levels, mean: Steps, whitening: Steps, sigmas: float, mask: Bytes
) -> None:
    """Set a mask (H, W or more) to 1 where channels (3, H, W) differ from gains * mean by more than noise.

    gains (3,), mean (3, H, W), whitening (6, H, W): see Plate. The inner loop has no branch, so that it is
    vectorised.
    """
    blue, green, red = gains / np.float32(MEAN_STEPS)
    top = np.float32(255)
    limit = np.float32((sigmas * WHITENING_STEPS) ** 2)
    for y in range(channels.shape[1]):
        for x in range(channels.shape[2]):
            m0, m1, m2 = blue * mean[0, y, x], green * mean[1, y, x], red * mean[2, y, x]
            d0 = np.float32(channels[0, y, x]) - (m0 if m0 < top else top)
            d1 = np.float32(channels[1, y, x]) - (m1 if m1 < top else top)
            d2 = np.float32(channels[2, y, x]) - (m2 if m2 < top else top)
            e0 = whitening[BB, y, x] * d0
            e1 = whitening[GB, y, x] * d0 + whitening[GG, y, x] * d1
            e2 = whitening[RB, y, x] * d0 + whitening[RG, y, x] * d1 + whitening[RR, y, x] * d2
            mask[y, x] = e0 * e0 + e1 * e1 + e2 * e2 > limit


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _drop_shadow(
    mask: Bytes, words: NDArray[np.uint64], channels: Bytes, gains: Levels, mean: Steps,
    turn_noise: Levels, ratio_min: float, tangent: float,
) -> None:  # fmt: skip
    """Clear pixels of a mask (H, W or more) that show background in shadow: darker, not too dark, same
    colour.

    words: the mask's memory, eight pixels each; channels (3, H, W): the picture, gains (3,) brighter than the
    mean (3, H, W).

    The turn of colour is the angle between the BGR vectors. Hue itself is undefined on grey walls and
    noisy near them, while a grey wall's vector is as well defined as any: navy before grey turns it by
    tens of degrees, shadow by hardly any. Noise turns dark colours further than bright ones, so its
    share is granted in levels, not in degrees.
    """
    levels = gains / np.float32(MEAN_STEPS)
    darkest, turn = np.float32(ratio_min), np.float32(tangent)
    for y in range(words.shape[0]):
        first, last = 0, words.shape[1]
        while first < last and words[y, first] == 0:
            first += 1
        while last > first and words[y, last - 1] == 0:
            last -= 1
        if first < last:
            end = min(8 * last, channels.shape[2])
            _drop_in_row(mask, channels, mean, turn_noise, y, 8 * first, end, levels, darkest, turn)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _drop_in_row(
    mask: Bytes, channels: Bytes, mean: Steps, turn_noise: Levels, y: int, begin: int, end: int,
    levels: Levels, ratio_min: np.float32, tangent: np.float32,
) -> None:  # fmt: skip
    """Clear what is shadow in a part of a row; without a branch, so that many pixels go at a time."""
    white = np.float32(255)
    blue, green, red = channels[0, y, begin:end], channels[1, y, begin:end], channels[2, y, begin:end]
    mean_b, mean_g, mean_r = mean[0, y, begin:end], mean[1, y, begin:end], mean[2, y, begin:end]
    noise, marked = turn_noise[y, begin:end], mask[y, begin:end]
    for x in range(marked.size):
        b, g, r = np.float32(blue[x]), np.float32(green[x]), np.float32(red[x])
        mb, mg, mr = levels[0] * mean_b[x], levels[1] * mean_g[x], levels[2] * mean_r[x]
        along = b * mb + g * mg + r * mr
        expected = min(mb, white) * mb + min(mg, white) * mg + min(mr, white) * mr
        length2 = max(mb * mb + mg * mg + mr * mr, np.float32(1))
        along_levels = along / np.sqrt(length2)
        across2 = b * b + g * g + r * r - along_levels * along_levels
        allowed = along_levels * tangent + _SHADOW_SIGMAS * noise[x]
        is_shadow = (along < expected) & (along >= ratio_min * expected) & (across2 <= allowed * allowed)
        marked[x] &= not is_shadow
