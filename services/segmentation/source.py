"""Undistorted silhouettes of a take's cameras, frame by frame, without a socket."""

from collections.abc import Iterator, Sequence
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import Undistorter
from services.mocap.energy.bitplanes import CAMERAS_PER_PLANE, TriPlanes, n_planes
from services.mocap.take.folder import Take
from services.mocap.types import ACTOR, UNSURE, Bytes, Mask, Trimap

_Pixel = TypeVar("_Pixel", np.bool_, np.uint8)


class Segmenter(Protocol):
    """Makes the silhouettes of one camera of a take. The same frame is the same wherever reading starts."""

    def trimaps(self, start: int, stop: int) -> Iterator[Trimap]:
        """Undistorted trimaps (h, w) of frames start up to and without stop."""
        ...

    def raw_trimaps(self, start: int, stop: int) -> Iterator[Trimap]:
        """Trimaps (h, w) of the pictures as they are, not undistorted."""
        ...


class Matte(Protocol):
    """Cuts the actor out of one camera's pictures, each by itself."""

    def trimap(self, image_bgr: Bytes, /) -> Trimap:
        """The actor in a raw picture (H, W, 3) BGR uint8: a trimap (H, W)."""
        ...


class VideoSegmenter:
    """Silhouettes that a matte makes of a camera's video."""

    def __init__(self, take: Take, camera: Camera, matte: Matte) -> None:
        self._take, self._camera, self._matte = take, camera, matte
        self._undistorter = Undistorter(camera)

    def trimaps(self, start: int, stop: int) -> Iterator[Trimap]:
        """See Segmenter.trimaps."""
        return map(self._undistorter.trimap, self.raw_trimaps(start, stop))

    def raw_trimaps(self, start: int, stop: int) -> Iterator[Trimap]:
        """See Segmenter.raw_trimaps."""
        with self._take.video(self._camera, start, stop) as video:
            for picture in video:
                yield self._matte.trimap(picture)


class ReadySegmenter:
    """The take's own silhouettes."""

    def __init__(self, take: Take, camera: Camera) -> None:
        self._take, self._camera = take, camera
        self._undistorter = Undistorter(camera)

    def trimaps(self, start: int, stop: int) -> Iterator[Trimap]:
        """See Segmenter.trimaps."""
        return map(self._undistorter.trimap, self.raw_trimaps(start, stop))

    def raw_trimaps(self, start: int, stop: int) -> Iterator[Trimap]:
        """See Segmenter.raw_trimaps."""
        return iter(self._take.trimaps(self._camera, start, stop))


def packed(trimaps: Sequence[Trimap], width_px: int, height_px: int) -> TriPlanes:
    """Planes (P, height_px, width_px) of trimaps (h, w); smaller ones lie in the upper left.

    One trimap after the other: `pack_trimaps` would first have to stack them.
    """
    shape = (n_planes(len(trimaps)), height_px, width_px)
    planes = TriPlanes(np.zeros(shape, np.uint8), np.zeros(shape, np.uint8))
    for c, trimap in enumerate(trimaps):
        _set_camera(planes.silhouettes, c, trimap == ACTOR)
        _set_camera(planes.unsure, c, trimap == UNSURE)
    return planes


def _set_camera(planes: Bytes, camera: int, mask: Mask) -> None:
    """Set one camera's bit in planes (P, H, W) where a mask (h, w) is."""
    plane = planes[camera // CAMERAS_PER_PLANE, : mask.shape[0], : mask.shape[1]]
    np.bitwise_or(plane, np.left_shift(mask.view(np.uint8), camera % CAMERAS_PER_PLANE), out=plane)


def in_common_size(picture: NDArray[_Pixel], width_px: int, height_px: int) -> NDArray[_Pixel]:
    """A mask or trimap (h, w) in the upper left of an empty one, for cameras of different sizes."""
    if picture.shape == (height_px, width_px):
        return picture
    padded = np.zeros((height_px, width_px), picture.dtype)
    padded[: picture.shape[0], : picture.shape[1]] = picture
    return padded
