"""Undistorted silhouettes of a take's cameras, frame by frame, without a socket."""

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import Undistorter
from services.mocap.energy.bitplanes import CAMERAS_PER_PLANE, n_planes
from services.mocap.errors import UserError
from services.mocap.take.folder import Take
from services.mocap.types import Bytes, Mask
from services.segmentation.clean_plate import CleanPlate
from services.segmentation.cleanup import SegmentationSettings


class Segmenter(Protocol):
    """Makes the undistorted silhouettes of one camera."""

    def silhouettes(self, start: int, stop: int) -> Iterator[Mask]:
        """Masks (h, w) of frames start up to and without stop."""
        ...


class CleanPlateSegmenter:
    """Silhouettes from a camera's video and its clean plate (the paper, section 3.1)."""

    def __init__(self, take: Take, camera: Camera, settings: SegmentationSettings) -> None:
        self._take, self._camera = take, camera
        self._undistorter = Undistorter(camera)
        try:
            self._plate = CleanPlate.learn(take.background(camera), settings)
        except UserError as error:
            raise UserError(f"{take.folder}: clean plate of {camera.name}: {error}") from None

    def silhouettes(self, start: int, stop: int) -> Iterator[Mask]:
        """See Segmenter.silhouettes."""
        return map(self._undistorter.mask, self.raw_silhouettes(start, stop))

    def raw_silhouettes(self, start: int, stop: int) -> Iterator[Mask]:
        """Masks (h, w) of the pictures as they are, not undistorted."""
        with self._take.video(self._camera, start, stop) as video:
            for picture in video:
                yield self._plate.silhouette(picture)


class ReadySegmenter:
    """The take's own silhouettes."""

    def __init__(self, take: Take, camera: Camera) -> None:
        self._take, self._camera = take, camera
        self._undistorter = Undistorter(camera)

    def silhouettes(self, start: int, stop: int) -> Iterator[Mask]:
        """See Segmenter.silhouettes."""
        for mask in self._take.silhouettes(self._camera, start, stop):
            yield self._undistorter.mask(mask)


def make_segmenter(take: Take, camera: Camera, settings: SegmentationSettings) -> Segmenter:
    """The segmenter that suits what the take has of a camera; learns the clean plate."""
    if take.source == "silhouettes":
        return ReadySegmenter(take, camera)
    return CleanPlateSegmenter(take, camera, settings)


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
