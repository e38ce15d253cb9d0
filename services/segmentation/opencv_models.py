"""OpenCV's background models, trained once and then held, so that each picture is judged by itself."""

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np

from services.mocap.energy.bitplanes import trimap_of
from services.mocap.types import Bytes, Trimap
from services.segmentation.cleanup import SegmentationSettings, cleanup

_FOREGROUND = 255
"""In OpenCV's masks; shadow has 127."""
_LEAST_LOOKS = 30
"""Looks at the plate that a model needs; a plate of fewer pictures is shown again."""


class TrainedModel:
    """Silhouettes by a background model of OpenCV's that no longer learns."""

    def __init__(self, model: Any, plate: Iterable[Bytes], settings: SegmentationSettings) -> None:
        """Plate: pictures (H, W, 3) of the empty scene, one or more, from which the model learns."""
        self._model, self._settings = model, settings
        pictures = list(plate)
        for _ in range(-(-_LEAST_LOOKS // max(len(pictures), 1))):
            for picture in pictures:
                model.apply(picture)

    def trimap(self, image_bgr: Bytes) -> Trimap:
        """See Matte.trimap; every pixel is taken as sure."""
        marked = np.asarray(self._model.apply(image_bgr, learningRate=0))
        return trimap_of(cleanup(marked == _FOREGROUND, self._settings))


def mog2(plate: Iterable[Bytes], settings: SegmentationSettings) -> TrainedModel:
    """Gaussian mixtures with a shadow test (Zivkovic 2004)."""
    return TrainedModel(cv2.createBackgroundSubtractorMOG2(detectShadows=True), plate, settings)


def bgsegm(plate: Iterable[Bytes], settings: SegmentationSettings) -> TrainedModel:
    """Gaussian mixtures without one (KaewTraKulPong 2001): the one of bgsegm that can stop learning."""
    return TrainedModel(cv2.bgsegm.createBackgroundSubtractorMOG(), plate, settings)
