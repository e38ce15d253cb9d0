"""One camera's picture against its plate: what has changed, and what of that may be shadow."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from services.mocap.types import Bytes, Mask
from services.segmentation.colours import ActorColours
from services.segmentation.deviation import N_PRODUCTS, compare, judge
from services.segmentation.light import light_field
from services.segmentation.patches import drop_specks
from services.segmentation.pixels import Levels, Steps
from services.segmentation.plate import Plate, check_size
from services.segmentation.voxels import CLASS_PRIOR, MORE_MISS, N_CLASSES

LIGHT_UNCERTAINTY = 0.012
"""Share of a pixel's brightness by which its light may be off after all: patches smaller than the light
field."""
CHANGED = 0.25
"""A pixel has changed where the evidence for it is more."""
_SLOPE, _EVEN_DEVIATION2 = 0.25, 8.0
"""Evidence for a change per squared deviation, and the deviation that tells nothing (three channels)."""
_LEAST, _MOST = -1.5, 4.0
_SQUARE_PX = 5
"""Squares in which shadow is told from cloth."""
_COUNTED_PIXELS = 300.0
"""The usual odds by what other cameras say count as much as so many pixels of the take's own."""
_FEWEST_MOMENTS, _STILL, _ALONE = 6, 0.9, 0.5
"""Something was moved where nearly all of so many moments show a change that in half of them no other camera
confirms."""
_LEAST_MOVED = 0.003
"""Of the picture: shoes of somebody who stands still are smaller, and no voxel reaches down to them."""
_MOST_PRIOR = 1.0
"""Others' word is the same for many pixels that lie together, so that it may not count as much for each."""
_UNSUPPORTED_SHARES, _LEAST_PRIORS = (0.02, 0.15), (-5.0, -2.0)
"""The more of what surely changed no other camera confirms, the less it means: cameras are badly calibrated,
or do not see the same places."""


@dataclass(eq=False)
class View:
    """One camera: its plate, what was learnt of the actor in it, and room for the picture in work."""

    plate: Plate
    colours: ActorColours = field(default_factory=ActorColours)

    def __post_init__(self) -> None:
        shape = self.plate.shape
        self.counts = np.zeros((2, N_CLASSES))
        """Pixels that surely changed, and that surely did not, by what the other cameras say."""
        self.changed, self.unsupported = np.zeros((2, *shape), np.uint16)
        """(H, W) in how many moments a pixel had changed, and in how many of these no other camera saw
        anything along its ray."""
        self.moments = 0
        self.moved: Mask = np.zeros(shape, np.bool_)
        """(H, W) where something stands since the plate was recorded, or no longer does."""
        self.log_colours = self.colours.log_density(self.colours)
        self.class_prior = CLASS_PRIOR
        self.channels: Bytes = np.empty((3, *shape), np.uint8)
        self.expected: Steps = np.empty((3, *shape), np.int16)
        self.deviation2: Levels = np.empty(shape, np.float32)
        self.products: Levels = np.empty((N_PRODUCTS, *shape), np.float32)
        self.change: Levels = np.empty(shape, np.float32)
        """(H, W) evidence for a change."""
        self.ratio: Levels = np.empty(shape, np.float32)
        """(H, W) brightness of the square about a pixel over what is expected."""
        self.state: Bytes = np.empty(shape, np.uint8)
        """(H, W) what a pixel shows: see deviation."""

    def look(self, image_bgr: Bytes) -> None:
        """Compare a picture (H, W, 3) with the plate; raises UserError where it is of another size."""
        plate = self.plate
        height, width = plate.shape
        check_size(image_bgr, plate.shape, "image", "the clean plate")
        gains = plate.gauge.gains(image_bgr, plate.settings.flicker_limit)
        cv2.split(image_bgr, list(self.channels))
        light = np.ascontiguousarray(light_field(self.channels, plate.mean, gains)[:height, :width])
        compare(
            self.channels,
            plate.mean,
            plate.whitening,
            gains,
            light,
            self.expected,
            self.deviation2,
            self.products,
        )
        evidence = np.clip(_SLOPE * (self.deviation2 - np.float32(_EVEN_DEVIATION2)), _LEAST, _MOST)
        cv2.blur(evidence, (3, 3), dst=self.change)
        around = np.stack([cv2.blur(plane, (_SQUARE_PX, _SQUARE_PX)) for plane in self.products])
        judge(self.change, CHANGED, self.products, around, plate.turn_noise, self.ratio, self.state)

    def count(self, classes: Bytes, surely_changed: Mask, surely_same: Mask) -> None:
        """Take in a moment's classes (H, W) of pixels that surely changed (H, W), and that surely did not."""
        self.counts[0] += np.bincount(classes[surely_changed], minlength=N_CLASSES)
        self.counts[1] += np.bincount(classes[surely_same], minlength=N_CLASSES)
        self.changed += surely_changed
        self.unsupported += surely_changed & (classes == MORE_MISS)
        self.moments += 1

    def learn(self, of_all: ActorColours) -> None:
        """Draw conclusions from the colours and counts so far; of_all: the colours of all cameras
        together."""
        self.log_colours = self.colours.log_density(of_all)
        share = 1.0 / (1.0 + np.exp(-CLASS_PRIOR))
        changed = self.counts[0] + _COUNTED_PIXELS * share
        same = self.counts[1] + _COUNTED_PIXELS * (1.0 - share)
        unsupported = self.counts[0][MORE_MISS] / max(float(self.counts[0].sum()), _COUNTED_PIXELS)
        least = np.interp(unsupported, _UNSUPPORTED_SHARES, _LEAST_PRIORS)
        prior = np.clip(np.log(changed / same), least, _MOST_PRIOR)
        self.class_prior = np.where(CLASS_PRIOR == 0.0, 0.0, prior).astype(np.float32)
        if self.moments >= _FEWEST_MOMENTS:
            square = np.ones((_SQUARE_PX, _SQUARE_PX), np.uint8)
            still = (self.changed >= _STILL * self.moments) & (self.unsupported >= _ALONE * self.moments)
            opened = np.asarray(cv2.morphologyEx(still.view(np.uint8), cv2.MORPH_OPEN, square), np.uint8)
            drop_specks(opened, _LEAST_MOVED * opened.size)
            self.moved = np.asarray(cv2.dilate(opened, square) > 0)
