"""What is learnt of a camera: the actor's colours, how far others are believed, and what was moved."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from scipy.ndimage import convolve1d

from services.mocap.types import Bytes, Floats, Longs, Mask
from services.segmentation.cleanup import drop_specks, drop_unconfirmed, opened
from services.segmentation.pixels import Levels
from services.segmentation.plate import Plate
from services.segmentation.voxels import ALONE, CLASS_PRIOR, DEEP, MORE_MISS, N_CLASSES, NEAR

BINS = 32
"""Of a histogram of colours, per channel; a bin is 8 levels wide."""
BIN_SHIFT = 3
_BIN_VOLUME = float(8**3)
_BROAD = 1.0 / 220.0**3
"""Density of an unseen colour, per cubic level: nearly all colours are possible."""
_BROAD_SHARE = 0.1
"""Share of the actor's pixels that may have any colour: sides of the actor that were not seen yet."""
_OWN_SHARE = 0.5
"""Share of the other pixels that follow this camera's histogram; the rest follow that of all cameras."""
_LEAST_PIXELS = 200
_COUNTED_PIXELS = 300.0
"""The default odds from other cameras have the weight of this many pixels of the take."""
_TELLING_COLOUR = -8.0
"""An unchanged pixel counts against the actor only if its colour is this much rarer on the actor than in the
plate: log ratio of the densities."""
_MOST_PRIOR = 1.0
"""What the others say is the same for many pixels that lie together, so it may not count as much for each."""
_UNSUPPORTED_SHARES, _LEAST_PRIORS = (0.02, 0.15), (-5.0, -2.0)
"""The more certain changes no other camera confirms, the lower their weight: cameras are badly calibrated, or
do not see the same places."""
_FEWEST_MOMENTS, _STILL, _UNCONFIRMED = 6, 0.9, 0.5
"""An object was moved if nearly all of this many moments show a change that no other camera confirms in half
of them, or that static_objects explains."""
_MOST_MOMENTS = 32
"""When so many moments have been taken in, each counts half; from a recorded take fewer are learnt."""
_LEAST_MOVED = 0.003
"""Share of the picture: shoes of somebody who stands still are smaller, and no voxel reaches down to them."""
_BLIND_PERMILLE, _LEAST_EXPECTED, _LEAST_MISSED = 16.0, 1.5, 0.9
"""Around a pixel, in a square of so many thousandths of the picture's width, at least so many changes must be
expected, and at least this share of them missed, where something hides the actor."""
_LEAST_IN_SIGHT = 0.001
"""Share of the picture that must show the rest of somebody who is partly hidden: places that few cameras see
may be empty, though all of these see a change before or behind them."""
_AROUND_PX, _OFTEN, _MOST_OFTEN = 3, 0.5, 0.3
"""Feet that stand still, and that furniture hides from the other cameras, have a leg over them: of the pixels
this near to an object, at most this share changes in half of the moments."""


@dataclass(eq=False)
class ActorColours:
    """A histogram of the actor's colours in one camera."""

    counts: Floats = field(default_factory=lambda: np.zeros((BINS, BINS, BINS)))
    """(BINS, BINS, BINS) by blue, green and red."""

    def add(self, pixels: Bytes) -> None:
        """Add pixels (N, 3) that certainly show the actor."""
        self.counts += np.bincount(_bins_of(pixels), minlength=BINS**3).reshape(self.counts.shape)

    @property
    def n_pixels(self) -> int:
        """Number of pixels so far."""
        return int(self.counts.sum())

    def log_density(self, of_all: "ActorColours") -> Levels:
        """(BINS, BINS, BINS) logarithm of the density of colours, per cubic level.

        of_all: what all cameras saw together: clothes that one camera sees in front of a wall of the same
        colour, another camera sees in front of something else.
        """
        known = [
            (h, w) for h, w in ((self, _OWN_SHARE), (of_all, 1 - _OWN_SHARE)) if h.n_pixels >= _LEAST_PIXELS
        ]
        density = np.full(self.counts.shape, _BROAD * (_BROAD_SHARE if known else 1.0))
        total = sum(weight for _, weight in known)
        for histogram, weight in known:
            share = (1 - _BROAD_SHARE) * weight / total
            density += share * _smoothed(histogram.counts) / (histogram.n_pixels * _BIN_VOLUME)
        return np.asarray(np.log(density).astype(np.float32))


def _bins_of(pixels: Bytes) -> Longs:
    """The bins (N,) of pixels' colours (N, 3), the three axes flattened."""
    blue, green, red = (pixels >> BIN_SHIFT).T.astype(np.int64)
    return np.asarray((blue * BINS + green) * BINS + red)


def _smoothed(counts: Floats) -> Floats:
    """Counts (B, B, B), smoothed along every axis with weights 1/4, 1/2, 1/4."""
    for axis in range(3):
        counts = convolve1d(counts, (0.25, 0.5, 0.25), axis, mode="constant")
    return counts


class Learnt:
    """What was learnt of one camera's pictures; `add` takes in, `conclude` makes it count."""

    def __init__(self, shape_px: tuple[int, int], moved: Mask | None = None) -> None:
        """shape_px: of a picture. moved: (H, W) where an object is known to have been moved."""
        self.colours = ActorColours()
        self._n_changed = np.zeros(N_CLASSES)
        """Number of certainly changed pixels, by the class from the other cameras."""
        self._n_same = np.zeros((N_CLASSES, BINS**3), np.int64)
        """Number of certainly unchanged pixels, by class and colour."""
        self._changed, self._unsupported = np.zeros((2, *shape_px), np.uint16)
        """(H, W) number of moments in which a pixel had changed, and of those in which no other camera saw a
        change along its ray."""
        self._expected, self._missed = np.zeros((2, *shape_px), np.uint16)
        """(H, W) number of moments in which nearly all other cameras see a change along a pixel's ray, and of
        those in which this one surely sees none."""
        self._moments = 0
        self.log_colours = self.colours.log_density(self.colours)
        """(BINS, BINS, BINS) see ActorColours.log_density."""
        self.class_prior = CLASS_PRIOR
        """(N_CLASSES,) logarithm of the odds of the actor, by what the other cameras say."""
        self.moved: Mask = np.zeros(shape_px, np.bool_) if moved is None else moved
        """(H, W) where an object was added or removed after the plate was recorded."""
        self.blind: Mask = np.zeros(shape_px, np.bool_)
        """(H, W) where something before the actor hides what the other cameras see."""

    def add(self, image_bgr: Bytes, classes: Bytes, changed: Mask, same: Mask) -> None:
        """Take in a picture (H, W, 3), what the others say of its pixels (H, W), and which of them surely
        changed (H, W), and surely did not."""
        self._changed += changed
        self._unsupported += changed & (classes == MORE_MISS)
        expected = (classes <= DEEP).view(np.uint8)
        drop_unconfirmed(expected, changed.view(np.uint8), _LEAST_IN_SIGHT * expected.size)
        self._expected += expected
        self._missed += expected & same
        self._moments += 1
        if self._moments == _MOST_MOMENTS:  # live: what changed long ago counts less and less
            for counts in (self._changed, self._unsupported, self._expected, self._missed):
                counts >>= 1
            self._moments //= 2
        changed, same = changed & ~self.moved, same & ~self.moved
        self._n_changed += np.bincount(classes[changed], minlength=N_CLASSES)
        bins = classes[same] * np.int64(BINS**3) + _bins_of(image_bgr[same])
        self._n_same += np.bincount(bins, minlength=self._n_same.size).reshape(self._n_same.shape)
        seen_by_others = (classes <= NEAR) | (classes == ALONE)
        sure = cv2.erode((changed & seen_by_others).view(np.uint8), np.ones((3, 3), np.uint8)) > 0
        self.colours.add(image_bgr[sure])

    def conclude(self, plate: Plate, of_all: ActorColours, objects: Mask) -> None:
        """Draw conclusions from what was taken in so far.

        plate: of this camera. of_all: the colours of all cameras together. objects: where (H, W) all cameras
        see an object.

        With n and n' the pixels of a class that changed and did not, p the usual share of the former and k
        the weight of that, the prior is log((n + k p) / (n' + k (1 - p))), within limits.
        """
        self.log_colours = self.colours.log_density(of_all)
        share = 1.0 / (1.0 + np.exp(-CLASS_PRIOR))
        # Well within what the others see, a pixel as in the plate may be the actor's if it has such a colour.
        telling = self.log_colours.ravel() - float(np.median(plate.log_peak)) < _TELLING_COLOUR
        n_same = self._n_same.sum(axis=1)
        n_same[:NEAR] = self._n_same[:NEAR, telling].sum(axis=1)
        odds = (self._n_changed + _COUNTED_PIXELS * share) / (n_same + _COUNTED_PIXELS * (1.0 - share))
        unsupported = self._n_changed[MORE_MISS] / max(float(self._n_changed.sum()), _COUNTED_PIXELS)
        least = np.interp(unsupported, _UNSUPPORTED_SHARES, _LEAST_PRIORS)
        prior = np.clip(np.log(odds), least, _MOST_PRIOR)
        self.class_prior = np.where(CLASS_PRIOR == 0.0, 0.0, prior).astype(np.float32)
        if self._moments >= _FEWEST_MOMENTS:
            self.blind = self._hidden_places()
            still = self._changed >= _STILL * self._moments
            unconfirmed = opened(still & (self._unsupported >= _UNCONFIRMED * self._moments), 5)
            moved = opened(still & objects, 5) | self._on_their_own(unconfirmed)
            drop_specks(moved, _LEAST_MOVED * moved.size)
            self.moved = np.asarray(cv2.dilate(moved, np.ones((5, 5), np.uint8)) > 0)

    def _hidden_places(self) -> Mask:
        """(H, W) where changes are expected, but hardly ever seen."""
        size_px = 1 + 2 * round(_BLIND_PERMILLE * 1e-3 * self._expected.shape[1] / 2)
        expected, missed = (
            cv2.blur(counts.astype(np.float32), (size_px, size_px))
            for counts in (self._expected, self._missed)
        )
        blind = (expected >= _LEAST_EXPECTED) & (missed >= _LEAST_MISSED * expected)
        return np.asarray(opened(blind, size_px) > 0)

    def _on_their_own(self, patches: Bytes) -> Bytes:
        """Those patches (H, W) around which little changes often."""
        drop_specks(patches, _LEAST_MOVED * patches.size)
        changes_often = self._changed >= _OFTEN * self._moments
        square, kept = np.ones((2 * _AROUND_PX + 1,) * 2, np.uint8), np.zeros_like(patches)
        n_patches, labels = cv2.connectedComponents(patches)
        for label in range(1, n_patches):
            patch = (labels == label).view(np.uint8)
            around = cv2.dilate(patch, square) > patch
            if np.count_nonzero(changes_often & around) <= _MOST_OFTEN * np.count_nonzero(around):
                kept |= patch
        return kept
