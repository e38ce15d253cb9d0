"""Mattes of several cameras, each made by itself, without what only one of the cameras sees."""

from collections.abc import Mapping, Sequence
from typing import Protocol

import cv2
import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.types import ACTOR, BACKGROUND, Bytes, Trimap
from services.segmentation.lenses import Lenses
from services.segmentation.voxels import MISS, MORE_MISS, Stage

_LEAST_OTHERS = 3
"""One of the others may miss what is there, and two have to agree on where it is."""
_SUPPORTED = 0.25
"""Of a blob's area, that the others leave room for; the actor's parts have most of theirs."""


class Matte(Protocol):
    """Cuts the actor out of one camera's pictures, each by itself."""

    def trimap(self, image_bgr: Bytes, /) -> Trimap:
        """The actor in a raw picture (H, W, 3) BGR uint8: a trimap (H, W)."""
        ...


class MatteGroup:
    """A matte for each camera, none of which knows of the others."""

    def __init__(self, cameras: Sequence[Camera], mattes: Sequence[Matte]) -> None:
        self._mattes = list(mattes)
        self._lenses = Lenses.of(cameras)
        self._stage = Stage.of(cameras, self._lenses, 0.0) if len(cameras) > _LEAST_OTHERS else None

    def trimaps(self, images_bgr: Mapping[int, Bytes], /) -> dict[int, Trimap]:
        """See JointMatte.trimaps: without blobs that no other camera supports.

        Blobs are of what is surely actor; unsure pixels of the others leave room, and stay what they are. A
        camera whose picture has one blob or none stays as it is, and so does one in which nothing is
        supported: it may be the calibration that is wrong.
        """
        trimaps = {c: self._mattes[c].trimap(image) for c, image in images_bgr.items()}
        blobs = {
            c: cv2.connectedComponents((trimap == ACTOR).view(np.uint8)) for c, trimap in trimaps.items()
        }
        if self._stage is None or len(trimaps) <= _LEAST_OTHERS or all(n <= 2 for n, _ in blobs.values()):
            return trimaps
        width, height = self._lenses.sizes_px.max(axis=0)
        misses = np.full((self._lenses.n_cameras, height, width), MISS, np.uint8)
        for c, trimap in trimaps.items():
            misses[c, : trimap.shape[0], : trimap.shape[1]] = np.where(trimap == BACKGROUND, MISS, 0)
        there = np.array(sorted(trimaps), np.int32)
        for c, classes in zip(map(int, there), self._stage.classes(self._lenses, misses, there), strict=True):
            n, labels = blobs[c]
            areas_px = np.bincount(labels.ravel(), minlength=n)
            supported = np.bincount(labels[classes != MORE_MISS], minlength=n) >= _SUPPORTED * areas_px
            if n > 2 and supported[1:].any():
                trimaps[c][(labels > 0) & ~supported[labels]] = BACKGROUND
        return trimaps
