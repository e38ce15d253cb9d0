"""Is a clean plate clean? Somebody in it would be missing from the silhouettes, or stay in all of them."""

from dataclasses import dataclass

import cv2
import numpy as np

from services.mocap.types import Bytes, Ints, Mask
from services.segmentation.pixels import Levels
from services.segmentation.plate import Gauge
from services.segmentation.take_plate import agreeing, median_picture, plate_of_samples

LOOKS = 12
"""Pictures of a plate, and of a take, that are looked at, at least where there are so many."""
_FLICKER_LIMIT = 0.25
_DIFFERENT_LEVELS = 16.0
"""In one channel at least; less may be a codec's or a light's doing."""
_LEAST_SHARE = 0.002
"""Of the picture; what is smaller than 154 pixels of 320x240 is no person."""
_STILL = 0.9
"""Of a plate's pictures, that have to agree where nothing moves."""
_SEEN_EMPTY = 0.5
"""Of the take's pictures, that show the same where something of the plate is gone."""
_EDGE_RATIO = 1.3
"""How much stronger the outline of what is gone is in the plate than in the take."""


@dataclass(frozen=True)
class Ghost:
    """What should not be in a clean plate."""

    moves: bool
    """Whether it moves in the plate; else it stands there and is gone in the take."""
    share: float
    """Of the picture, 0 to 1."""
    centre: tuple[float, float]
    """Column and row of the middle of its largest part, over the picture's width."""

    def centre_px(self, width_px: int) -> tuple[int, int]:
        """The same in a picture of a width."""
        column, row = (round(width_px * part) for part in self.centre)
        return column, row


def find_ghost(plate: Bytes, samples: Bytes) -> Ghost | None:
    """The largest thing in a plate (N, H, W, 3) that is not the empty scene of samples (M, H, W, 3).

    None where there is none, as far as these pictures tell: whoever stands in the plate and for the whole
    take in the same place is part of the scene.
    """
    still = plate_of_samples(plate)
    moving = _patches(np.asarray(still.support < _STILL))
    if moving:
        return _ghost(True, moving)
    return _gone(median_picture(plate), samples)


def _gone(plate: Bytes, samples: Bytes) -> Ghost | None:
    """What stands in a plate (H, W, 3) and in no sample (M, H, W, 3).

    An actor who never leaves a place differs from the plate there as well, but brings the outline along,
    which a place that somebody has left does not have.
    """
    gauge = Gauge.on(plate.astype(np.float32))
    evened = np.array([gauge.evened(sample, _FLICKER_LIMIT) for sample in samples])
    differs: Mask = np.asarray(~agreeing(evened, plate, _DIFFERENT_LEVELS).any(axis=0))
    usual = median_picture(evened)
    same = agreeing(evened, usual, _DIFFERENT_LEVELS).mean(axis=0)
    in_plate, in_take = _edges(plate), np.mean([_edges(sample) for sample in evened], axis=0)
    gone = []
    for patch in _patches(differs):
        rim = cv2.morphologyEx(patch.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
        if same[patch].mean() >= _SEEN_EMPTY and in_plate[rim].mean() > _EDGE_RATIO * in_take[rim].mean():
            gone.append(patch)
    return _ghost(False, gone) if gone else None


def _edges(picture: Bytes) -> Levels:
    """How steep the brightness of a picture (H, W, 3) is: (H, W)."""
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.float32)
    steepness: Levels = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    return steepness


def _patches(mask: Mask) -> list[Mask]:
    """The connected patches of a mask (H, W) that are as large as somebody, the largest first."""
    _, labels, table, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    areas: Ints = np.asarray(table[1:, cv2.CC_STAT_AREA], np.int32)
    large = [k for k in np.argsort(-areas, kind="stable") if areas[k] >= _LEAST_SHARE * mask.size]
    return [np.asarray(labels == 1 + k) for k in large]


def _ghost(moves: bool, patches: list[Mask]) -> Ghost:
    rows, columns = np.nonzero(patches[0])
    share = float(np.sum([patch.mean() for patch in patches]))
    width_px = patches[0].shape[1]
    return Ghost(moves, share, (float(columns.mean()) / width_px, float(rows.mean()) / width_px))
