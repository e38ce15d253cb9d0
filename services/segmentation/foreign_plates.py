"""Finds clean plates that show what another camera's video shows: files that were given to wrong cameras."""

from collections.abc import Iterable

import cv2
import numpy as np

from services.mocap.take.folder import Take
from services.mocap.types import Bytes, Floats

_SIZE_PX = 64, 48
_UNLIKE_LEVELS = 8.0
"""A plate that differs less from its own camera's video, by the median over the picture, is that camera's."""
_ALIKE = 0.4
"""Else it is that of another camera, if it differs from that one's video by less than this share as much."""


def foreign_plates(take: Take) -> dict[str, str]:
    """Cameras whose clean plate shows the view of another camera's video -> that camera."""
    cameras = [camera for camera in take.cameras if take.has_background(camera) and take.has_video(camera)]
    plates = [_small(take.background(camera)) for camera in cameras]
    first_frames = []
    for camera in cameras:
        with take.video(camera, 0, 1) as video:
            first_frames.append(_small(video))
    found = {}
    for camera, plate in zip(cameras, plates, strict=True):
        off = {
            other.name: float(np.median(np.abs(plate - seen)))
            for other, seen in zip(cameras, first_frames, strict=True)
        }
        nearest = min(off, key=off.__getitem__)
        if off[camera.name] > _UNLIKE_LEVELS and off[nearest] < _ALIKE * off[camera.name]:
            found[camera.name] = nearest
    return found


def _small(pictures: Iterable[Bytes]) -> Floats:
    """The first of some pictures (H, W, 3), small, without its level: that of the light may have changed."""
    small = cv2.resize(next(iter(pictures)), _SIZE_PX, interpolation=cv2.INTER_AREA).astype(np.float64)
    return np.asarray(small - np.median(small, axis=(0, 1)))
