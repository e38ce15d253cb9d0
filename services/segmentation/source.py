"""Undistorted silhouettes of a take's cameras, frame by frame, without a socket."""

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import Undistorter
from services.mocap.energy.bitplanes import CAMERAS_PER_PLANE, n_planes
from services.mocap.take.folder import Take
from services.mocap.types import Bytes, Mask


class Segmenter(Protocol):
    """Makes the silhouettes of one camera of a take. The same frame is the same wherever reading starts."""

    def silhouettes(self, start: int, stop: int) -> Iterator[Mask]:
        """Undistorted masks (h, w) of frames start up to and without stop."""
        ...

    def raw_silhouettes(self, start: int, stop: int) -> Iterator[Mask]:
        """Masks (h, w) of the pictures as they are, not undistorted."""
        ...


class Matte(Protocol):
    """Cuts the actor out of one camera's pictures, each by itself."""

    def silhouette(self, image_bgr: Bytes, /) -> Mask:
        """The actor in a raw picture (H, W, 3) BGR uint8: a mask (H, W)."""
        ...


class VideoSegmenter:
    """Silhouettes that a matte makes of a camera's video."""

    def __init__(self, take: Take, camera: Camera, matte: Matte) -> None:
        self._take, self._camera, self._matte = take, camera, matte
        self._undistorter = Undistorter(camera)

    def silhouettes(self, start: int, stop: int) -> Iterator[Mask]:
        """See Segmenter.silhouettes."""
        return map(self._undistorter.mask, self.raw_silhouettes(start, stop))

    def raw_silhouettes(self, start: int, stop: int) -> Iterator[Mask]:
        """See Segmenter.raw_silhouettes."""
        with self._take.video(self._camera, start, stop) as video:
            for picture in video:
                yield self._matte.silhouette(picture)


class ReadySegmenter:
    """The take's own silhouettes."""

    def __init__(self, take: Take, camera: Camera) -> None:
        self._take, self._camera = take, camera
        self._undistorter = Undistorter(camera)

    def silhouettes(self, start: int, stop: int) -> Iterator[Mask]:
        """See Segmenter.silhouettes."""
        return map(self._undistorter.mask, self.raw_silhouettes(start, stop))

    def raw_silhouettes(self, start: int, stop: int) -> Iterator[Mask]:
        """See Segmenter.raw_silhouettes."""
        return iter(self._take.silhouettes(self._camera, start, stop))


def packed(masks: Sequence[Mask], width_px: int, height_px: int) -> Bytes:
    """Bit-planes (P, height_px, width_px) of masks (h, w); smaller ones lie in the upper left.

    One mask after the other, in the bytes that they are: `pack` would first have to stack them.
    """
    planes: Bytes = np.zeros((n_planes(len(masks)), height_px, width_px), np.uint8)
    for c, mask in enumerate(masks):
        plane = planes[c // CAMERAS_PER_PLANE, : mask.shape[0], : mask.shape[1]]
        np.bitwise_or(plane, np.left_shift(mask.view(np.uint8), c % CAMERAS_PER_PLANE), out=plane)
    return planes


def in_common_size(mask: Mask, width_px: int, height_px: int) -> Mask:
    """A mask (h, w) in the upper left of an empty one, for cameras of different sizes."""
    if mask.shape == (height_px, width_px):
        return mask
    padded: Mask = np.zeros((height_px, width_px), bool)
    padded[: mask.shape[0], : mask.shape[1]] = mask
    return padded
