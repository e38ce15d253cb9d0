"""Pictures out of the overlay, for a page."""

import base64
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from services.mocap.errors import TakeError
from services.mocap.take.video import VideoReader, index_video
from services.mocap.types import Bytes, Floats

_WIDTH_PX = 1200
_QUALITY = 78


@dataclass(frozen=True)
class KeyFrame:
    """A picture of one moment."""

    caption: str
    jpeg: str
    """In base64."""


def key_frames(overlay: Path, frames: list[int], energies_px: Floats) -> list[KeyFrame]:
    """The first, middle and last frame of an overlay, and the one of the largest energy.

    frames: (N,) the numbers of the overlay's frames; energies_px: (N,) theirs. None where there is no overlay
    of these frames.
    """
    if not overlay.exists():
        return []
    try:
        index = index_video(overlay)
        if index.n_frames != len(frames):
            return []
        last, worst = len(frames) - 1, int(np.argmax(energies_px))
        named = {0: "first", last // 2: "middle", last: "last", worst: "largest energy"}
        shown = []
        for row, why in sorted(named.items()):
            with VideoReader(index, row, row + 1) as video:
                picture = next(iter(video))
            caption = f"{why}: frame {frames[row]}, {energies_px[row]:.0f} pixels"
            shown.append(KeyFrame(caption, _jpeg(picture)))
        return shown
    except TakeError:
        return []  # a page without pictures is better than none


def _jpeg(picture: Bytes) -> str:
    height_px, width_px = picture.shape[:2]
    if width_px > _WIDTH_PX:
        size = (_WIDTH_PX, round(height_px * _WIDTH_PX / width_px))
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
    _, encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return base64.b64encode(encoded.tobytes()).decode("ascii")
