"""What every way to segment pictures has in common: those of one camera, and those of a moment."""

from collections.abc import Mapping, Sequence
from typing import Protocol

import cv2
import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.types import ACTOR, BACKGROUND, Bytes, Mask, Trimap
from services.segmentation.lenses import Lenses
from services.segmentation.voxels import MISS, MORE_MISS, VoxelGrid

_LEAST_OTHERS = 3
"""One of the other cameras may miss an object, and two must agree on its position."""
_SUPPORTED = 0.25
"""Share of a blob's area that the others must leave room for; the actor's parts have most of theirs."""


class Matte(Protocol):
    """Segments one camera's pictures, each independently."""

    def trimap(self, image_bgr: Bytes, /) -> Trimap:
        """The actor in a raw picture (H, W, 3) BGR uint8: a trimap (H, W)."""
        ...


class GroupMatte(Protocol):
    """Segments the pictures that several cameras took at one moment."""

    def trimaps(self, images_bgr: Mapping[int, Bytes], /) -> dict[int, Trimap]:
        """The actor in raw pictures (H, W, 3) by the camera's place: trimaps (H, W). Cameras may be
        missing."""
        ...

    @property
    def moved(self) -> list[Mask]:
        """Per camera (H, W): where an object was added or removed since the plate was recorded, if this looks
        for some."""
        ...

    @property
    def blind(self) -> list[Mask]:
        """Per camera (H, W): where something seems to hide the actor, whom nearly all others see along these
        rays, if this looks for that."""
        ...


class SeparateMattes:
    """A matte for each camera, none of which knows of the others; blobs that only one camera sees go."""

    def __init__(self, cameras: Sequence[Camera], mattes: Sequence[Matte]) -> None:
        self._mattes = list(mattes)
        has_enough = len(cameras) > _LEAST_OTHERS
        self._voxels = VoxelGrid.of(cameras, Lenses.of(cameras), 0.0) if has_enough else None
        self.moved: list[Mask] = [np.zeros(camera.shape_px, np.bool_) for camera in cameras]
        self.blind = self.moved

    def trimaps(self, images_bgr: Mapping[int, Bytes], /) -> dict[int, Trimap]:
        """See GroupMatte.trimaps: without blobs that no other camera supports.

        Blobs consist of certain actor pixels; other cameras' unsure pixels leave room, and are not changed. A
        picture with at most one blob is not changed, nor one in which no blob is supported, because the
        calibration may be wrong.
        """
        trimaps = {c: self._mattes[c].trimap(image) for c, image in images_bgr.items()}
        blobs = {
            c: cv2.connectedComponents((trimap == ACTOR).view(np.uint8)) for c, trimap in trimaps.items()
        }
        if self._voxels is None or len(trimaps) <= _LEAST_OTHERS or all(n <= 2 for n, _ in blobs.values()):
            return trimaps
        width, height = self._voxels.lenses.sizes_px.max(axis=0)
        misses = np.full((len(self._mattes), height, width), MISS, np.uint8)
        for c, trimap in trimaps.items():
            misses[c, : trimap.shape[0], : trimap.shape[1]] = np.where(trimap == BACKGROUND, MISS, 0)
        there = np.array(sorted(trimaps), np.int32)
        for c, classes in zip(map(int, there), self._voxels.classes(misses, there), strict=True):
            n, labels = blobs[c]
            areas_px = np.bincount(labels.ravel(), minlength=n)
            supported = np.bincount(labels[classes != MORE_MISS], minlength=n) >= _SUPPORTED * areas_px
            if n > 2 and supported[1:].any():
                trimaps[c][(labels > 0) & ~supported[labels]] = BACKGROUND
        return trimaps
