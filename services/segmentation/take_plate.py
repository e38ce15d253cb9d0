"""A clean plate made of the take itself, for takes without one; and whether a recorded one is clean.

A plate of the take is what most of the pictures show. Where the actor stands in most of them, the background
is unknown; the result includes the share of the picture for which this may be so. Somebody in a recorded
plate (a ghost) would be missing from the silhouettes, or stay in all of them.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from services.mocap.types import Bytes, Ints, Mask
from services.segmentation.exposure import Gauge
from services.segmentation.pixels import MAD_SIGMA, Levels
from services.segmentation.plate_shift import grey_of, slopes_of

SAMPLES = 48
"""Most pictures for a plate."""
LOOKS = 12
"""Pictures of a plate, and of a take, in which a ghost is looked for, at least where there are so many."""
_FLICKER_LIMIT = 0.25
_LEAST_TOLERANCE = 8.0
"""In levels; pictures that differ by less look the same."""
_SIGMAS = 4.0
_STILL = 0.9
"""Share of the pictures that must agree where nothing moves."""
_ROWS_AT_ONCE = 64
_DIFFERENT_LEVELS = 16.0
"""Least difference in one channel; a codec or a change of light may cause smaller ones."""
_LEAST_SHARE = 0.002
"""Share of the picture; what is smaller than 154 pixels of 320x240 is no person."""
_SEEN_EMPTY = 0.5
"""Share of the take's pictures that show the same where something of the plate is gone."""
_LEAVES_AFTER = (0.0, 0.25, 0.5)
"""Somebody who stands in the plate may stand there in the first pictures of the take as well: these shares of
the take are left out in turn."""
_EDGE_RATIO = 1.3
"""How much stronger the outline of a missing object is in the plate than in the take."""


@dataclass(frozen=True, eq=False)
class TakePlate:
    """The estimated empty scene of one camera."""

    frames: Bytes
    """(N, H, W, 3) the samples at one exposure; where the actor was, an earlier look at the background."""
    support: Levels
    """(H, W) the share of the samples, 0 to 1, that agree at a pixel."""

    @property
    def unsure_share(self) -> float:
        """Of the pixels where something moves, the share that fewer than half of the samples show empty."""
        return float((self.support < 0.5).sum() / max(int((self.support < _STILL).sum()), 1))


def plate_of_samples(samples: Bytes) -> TakePlate:
    """The plate of pictures (N, H, W, 3) of a camera that stands still, over which the actor moves.

    A pixel's background is the median of its samples if half of them agree with it, else the most frequent
    colour.
    """
    gauge = Gauge.on(_median_picture(samples).astype(np.float32))
    evened = np.array([gauge.evened(sample, _FLICKER_LIMIT) for sample in samples])
    background = _median_picture(evened)
    noise = float(np.median([float(np.median(cv2.absdiff(sample, background))) for sample in evened]))
    tolerance = max(_LEAST_TOLERANCE, _SIGMAS * MAD_SIGMA * noise)
    agree = _agreeing(evened, background, tolerance)
    doubtful = agree.mean(axis=0) < 0.5
    if doubtful.any():
        looks = evened[:, doubtful]
        counts = np.array([_agreeing(looks, look, tolerance).sum(axis=0) for look in looks], np.int32)
        background[doubtful] = looks[counts.argmax(axis=0), np.arange(looks.shape[1])]
        agree[:, doubtful] = _agreeing(looks, background[doubtful], tolerance)
    support = agree.mean(axis=0).astype(np.float32)
    before = background
    for sample, is_background in zip(evened, agree, strict=True):
        sample[~is_background] = before[~is_background]
        before = sample
    return TakePlate(evened, support)


def _median_picture(samples: Bytes) -> Bytes:
    """The lower median (H, W, 3) over samples (N, H, W, 3), some rows at a time, to spare memory."""
    middle = (len(samples) - 1) // 2
    rows = range(0, samples.shape[1], _ROWS_AT_ONCE)
    parts = [np.partition(samples[:, y : y + _ROWS_AT_ONCE], middle, axis=0)[middle] for y in rows]
    return np.concatenate(parts)


def _agreeing(samples: Bytes, background: Bytes, tolerance: float) -> Mask:
    """Which samples (N, …, 3) show a background (…, 3): (N, …)."""
    agree: Mask = np.empty(samples.shape[:-1], np.bool_)
    for n, sample in enumerate(samples):
        difference = cv2.absdiff(sample.reshape(-1, 3), background.reshape(-1, 3)) <= tolerance
        blue, green, red = difference.T
        agree[n] = (blue & green & red).reshape(background.shape[:-1])
    return agree


@dataclass(frozen=True)
class Ghost:
    """Something that should not be in a clean plate."""

    moves: bool
    """Whether it moves in the plate; otherwise it stands there and is gone in the take."""
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

    None if these pictures show none. A person who stands in the same place in the plate and in the whole take
    is part of the scene.
    """
    moving = _patches(np.asarray(plate_of_samples(plate).support < _STILL))
    gone = [] if moving else _gone(_median_picture(plate), samples)
    patches = moving or gone
    if not patches:
        return None
    rows, columns = np.nonzero(patches[0])
    share = float(np.sum([patch.mean() for patch in patches]))
    width_px = patches[0].shape[1]
    return Ghost(bool(moving), share, (float(columns.mean()) / width_px, float(rows.mean()) / width_px))


def _gone(plate: Bytes, samples: Bytes) -> list[Mask]:
    """Patches of what stands in a plate (H, W, 3) and in no later sample (M, H, W, 3).

    An actor who never leaves a place differs from the plate there as well, but has an outline there in the
    take, which a place that a person has left does not have. Medians along the outline: the border of a wall
    that crosses it is no outline.
    """
    gauge = Gauge.on(plate.astype(np.float32))
    evened = np.array([gauge.evened(sample, _FLICKER_LIMIT) for sample in samples])
    as_in_plate = _agreeing(evened, plate, _DIFFERENT_LEVELS)
    usual = _median_picture(evened)
    same = _agreeing(evened, usual, _DIFFERENT_LEVELS).mean(axis=0)
    in_plate, in_take = slopes_of(grey_of(plate)), np.mean([slopes_of(grey_of(s)) for s in evened], axis=0)

    def is_gone(patch: Mask) -> bool:
        rim = cv2.morphologyEx(patch.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
        outline, in_takes = (float(np.median(slopes[rim])) for slopes in (in_plate, in_take))
        return same[patch].mean() >= _SEEN_EMPTY and outline > _EDGE_RATIO * in_takes

    for share in _LEAVES_AFTER:
        differs: Mask = np.asarray(~as_in_plate[round(share * len(samples)) :].any(axis=0))
        if gone := [patch for patch in _patches(differs) if is_gone(patch)]:
            return gone
    return []


def _patches(mask: Mask) -> list[Mask]:
    """The connected patches of a mask (H, W) that are large enough for a person, the largest first."""
    _, labels, table, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    areas: Ints = np.asarray(table[1:, cv2.CC_STAT_AREA], np.int32)
    large = [k for k in np.argsort(-areas, kind="stable") if areas[k] >= _LEAST_SHARE * mask.size]
    return [np.asarray(labels == 1 + k) for k in large]
