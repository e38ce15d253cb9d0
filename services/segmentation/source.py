"""Undistorted silhouettes of a take's cameras, frame by frame, without a socket."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from typing import Protocol

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import Undistorter
from services.mocap.energy.bitplanes import CAMERAS_PER_PLANE, TriPlanes, n_planes
from services.mocap.take.folder import Take
from services.mocap.types import ACTOR, UNSURE, Bytes, Mask, Trimap


class Segmenter(Protocol):
    """Makes the silhouettes of some cameras of a take. A frame is the same wherever reading starts."""

    def trimaps(self, start: int, stop: int) -> Iterator[list[Trimap]]:
        """Undistorted trimaps (h, w), one per camera, of frames start up to and without stop."""
        ...

    def raw_trimaps(self, start: int, stop: int) -> Iterator[list[Trimap]]:
        """Trimaps (h, w) of the pictures as they are, not undistorted."""
        ...


class JointMatte(Protocol):
    """Cuts the actor out of the pictures that several cameras took at one moment."""

    def trimaps(self, images_bgr: Mapping[int, Bytes], /) -> dict[int, Trimap]:
        """The actor in raw pictures (H, W, 3) by the camera's place: trimaps (H, W). Cameras may be
        missing."""
        ...


class GroupUndistorter:
    """Makes undistorted trimaps of a group's raw ones."""

    def __init__(self, cameras: Sequence[Camera]) -> None:
        self._undistorters = [Undistorter(camera) for camera in cameras]

    def undistorted(self, raw: Mapping[int, Trimap]) -> list[Trimap]:
        """Trimaps (h, w) of the cameras that have one, by their place."""
        return [self._undistorters[c].trimap(raw[c]) for c in sorted(raw)]


class VideoSegmenter:
    """Silhouettes that a matte makes of some cameras' videos."""

    def __init__(self, take: Take, cameras: Sequence[Camera], matte: JointMatte) -> None:
        self._take, self._cameras, self._matte = take, list(cameras), matte
        self._undistorter = GroupUndistorter(cameras)

    def trimaps(self, start: int, stop: int) -> Iterator[list[Trimap]]:
        """See Segmenter.trimaps."""
        for images in pictures_of(self._take, self._cameras, start, stop):
            yield self._undistorter.undistorted(self._matte.trimaps(images))

    def raw_trimaps(self, start: int, stop: int) -> Iterator[list[Trimap]]:
        """See Segmenter.raw_trimaps."""
        for images in pictures_of(self._take, self._cameras, start, stop):
            found = self._matte.trimaps(images)
            yield [found[c] for c in range(len(self._cameras))]


class ReadySegmenter:
    """The take's own silhouettes."""

    def __init__(self, take: Take, cameras: Sequence[Camera]) -> None:
        self._take, self._cameras = take, list(cameras)
        self._undistorter = GroupUndistorter(cameras)

    def trimaps(self, start: int, stop: int) -> Iterator[list[Trimap]]:
        """See Segmenter.trimaps."""
        for raw in self.raw_trimaps(start, stop):
            yield self._undistorter.undistorted(dict(enumerate(raw)))

    def raw_trimaps(self, start: int, stop: int) -> Iterator[list[Trimap]]:
        """See Segmenter.raw_trimaps."""
        readers = [self._take.trimaps(camera, start, stop) for camera in self._cameras]
        for trimaps in zip(*readers, strict=True):
            yield list(trimaps)


def pictures_of(take: Take, cameras: Sequence[Camera], start: int, stop: int) -> Iterator[dict[int, Bytes]]:
    """Raw pictures (H, W, 3) of some cameras by their place, frame by frame, start up to and without stop."""
    with ExitStack() as closing:
        videos = [closing.enter_context(take.video(camera, start, stop)) for camera in cameras]
        for images in zip(*videos, strict=True):
            yield dict(enumerate(images))


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
