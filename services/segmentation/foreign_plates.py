"""Finds clean plates that show what another camera's video shows, or what their own one shows upside down."""

from collections.abc import Iterable

import cv2
import numpy as np

from services.mocap.take.folder import Take
from services.mocap.types import Bytes, Floats

_SIZE_PX = 64, 48
_DARKEST, _BRIGHTEST, _LEAST_COMPARED = 24, 245, 0.4
"""Only pixels between these levels are compared, as darker ones are noise and brighter ones clipped; where
they are less than this share of the picture, nothing is concluded."""
_UNLIKE, _EXCHANGED = 0.04, 0.02
"""A plate whose _difference from its own camera's video is at most the first is that camera's; where plates
and videos only changed places, the second is the limit. 150 cameras of studios differ from their own plates
by at most 0.013, also if brightened or darkened to 0.67 to 1.3 times; 99 % of the pairs of different cameras
by more than 0.02."""
_ALIKE = 0.4
"""Else it is that of another camera, if it differs from that one's video by less than this share as much."""


def foreign_plates(take: Take) -> dict[str, str]:
    """Cameras whose clean plate shows the view of another camera's video -> that camera; or the same
    camera, if it shows what its own video does upside down."""
    cameras = [camera for camera in take.cameras if take.has_background(camera) and take.has_video(camera)]
    plates = [_small(take.background(camera)) for camera in cameras]
    first_frames = []
    for camera in cameras:
        with take.video(camera, 0, 1) as video:
            first_frames.append(_small(video))
    found, own = dict[str, str](), dict[str, float]()
    for camera, plate, its_own in zip(cameras, plates, first_frames, strict=True):
        off = {
            other.name: _difference(plate, seen) for other, seen in zip(cameras, first_frames, strict=True)
        }
        nearest = min(off, key=off.__getitem__)
        own[camera.name] = off[camera.name]
        is_known = np.isfinite(own[camera.name])
        turned = _difference(plate[::-1, ::-1], its_own)
        if is_known and own[camera.name] > _UNLIKE and turned < min(_ALIKE * own[camera.name], off[nearest]):
            found[camera.name] = camera.name
        elif is_known and own[camera.name] > _EXCHANGED and off[nearest] < _ALIKE * own[camera.name]:
            found[camera.name] = nearest
    are_exchanged = found.keys() == set(found.values())
    return {name: other for name, other in found.items() if are_exchanged or own[name] > _UNLIKE}


def _small(pictures: Iterable[Bytes]) -> Floats:
    """The first of some pictures (H, W, 3), small."""
    return cv2.resize(next(iter(pictures)), _SIZE_PX, interpolation=cv2.INTER_AREA).astype(np.float64)


def _difference(plate: Floats, seen: Floats) -> float:
    """The median over two small pictures of how much the logarithms of their levels differ; infinite where
    too few pixels can be compared.

    A ratio that most of the picture shares is left out: that of light that has changed. It is not taken from
    each picture's own median, which jumps where an actor stands before a floor and a wall of equal area.
    """
    both = np.stack([plate, seen])
    compared = ((both > _DARKEST) & (both < _BRIGHTEST)).all(axis=(0, 3))
    if compared.mean() < _LEAST_COMPARED:
        return np.inf
    ratio = np.log(seen[compared] / plate[compared])
    return float(np.median(np.abs(ratio - np.median(ratio, axis=0))))
