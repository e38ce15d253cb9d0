"""One camera's picture against its plate: what has changed, and what of that may be shadow."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from services.mocap.types import Bytes, Floats, Mask
from services.segmentation.colours import BINS, ActorColours, bins_of
from services.segmentation.deviation import N_PRODUCTS, UNCHANGED, compare, judge, multiply
from services.segmentation.light import light_field
from services.segmentation.patches import Part, box_of, drop_specks
from services.segmentation.pixels import Levels, Steps
from services.segmentation.plate import Plate, check_size
from services.segmentation.voxels import CLASS_PRIOR, MORE_MISS, N_CLASSES, NEAR

LIGHT_UNCERTAINTY = 0.012
"""Share of a pixel's brightness by which its light may be off after all: patches smaller than the light
field."""
CHANGED = 0.25
"""A pixel has changed where the evidence for it is more."""
_SQUARE_PX = 5
"""Squares in which shadow is told from cloth."""
_MARGIN_PX = 8
"""About what has changed, in which shadow is looked for too."""
_COUNTED_PIXELS = 300.0
"""The usual odds by what other cameras say count as much as so many pixels of the take's own."""
_TELLING_COLOUR = -8.0
"""A pixel as in the plate tells that the actor is not there only where that colour is so much rarer with the
actor: logarithm of the density over that of the plate's own colours."""
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
        self.n_changed = np.zeros(N_CLASSES)
        """Pixels that surely changed, by what the other cameras say."""
        self.n_same = np.zeros((N_CLASSES, BINS**3), np.int64)
        """Pixels that surely did not, by that and by their colour."""
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
        self.change: Levels = np.empty(shape, np.float32)
        """(H, W) evidence for a change."""
        self.part: Part | None = None
        """Rows and columns that hold all that has changed; None where nothing has."""
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
            self.channels, plate.mean, plate.whitening, gains, light, self.expected, self.deviation2,
            self.change,
        )  # fmt: skip
        cv2.blur(self.change, (3, 3), dst=self.change)
        self.ratio[:], self.state[:] = 1.0, UNCHANGED
        changed = (self.change > CHANGED).view(np.uint8)
        drop_specks(changed, plate.settings.speck_area_ppm * 1e-6 * changed.size)
        self.part = box_of(changed, _MARGIN_PX)
        if self.part is None:
            return
        rows, columns = self.part
        products: Levels = np.empty((N_PRODUCTS, *self.state[self.part].shape), np.float32)
        corner_px = rows.start, columns.start
        multiply(self.channels, self.expected, corner_px, products)
        around = np.stack([cv2.blur(plane, (_SQUARE_PX, _SQUARE_PX)) for plane in products])
        judge(self.change, CHANGED, products, around, plate.turn_noise, corner_px, self.ratio, self.state)

    def count(self, image_bgr: Bytes, classes: Bytes, surely_changed: Mask, surely_same: Mask) -> None:
        """Take in what others say (H, W) of pixels that surely changed (H, W), and of those that surely did
        not."""
        self.n_changed += np.bincount(classes[surely_changed], minlength=N_CLASSES)
        same = classes[surely_same] * np.int64(BINS**3) + bins_of(image_bgr[surely_same])
        self.n_same += np.bincount(same, minlength=self.n_same.size).reshape(self.n_same.shape)
        self.changed += surely_changed
        self.unsupported += surely_changed & (classes == MORE_MISS)
        self.moments += 1

    def _n_stage(self, telling: Mask) -> Floats:
        """How many pixels of each class show the stage; telling (BINS**3,): colours that the actor lacks.

        Well within what the others see, pixels of other colours that look as in the plate may be the actor's.
        """
        n_same = self.n_same.sum(axis=1)
        n_same[:NEAR] = self.n_same[:NEAR, telling].sum(axis=1)
        return np.asarray(n_same, np.float64)

    def learn(self, of_all: ActorColours) -> None:
        """Draw conclusions from the colours and counts so far; of_all: the colours of all cameras
        together."""
        self.log_colours = self.colours.log_density(of_all)
        share = 1.0 / (1.0 + np.exp(-CLASS_PRIOR))
        telling = self.log_colours.ravel() - float(np.median(self.plate.log_peak)) < _TELLING_COLOUR
        changed = self.n_changed + _COUNTED_PIXELS * share
        same = self._n_stage(telling) + _COUNTED_PIXELS * (1.0 - share)
        unsupported = self.n_changed[MORE_MISS] / max(float(self.n_changed.sum()), _COUNTED_PIXELS)
        least = np.interp(unsupported, _UNSUPPORTED_SHARES, _LEAST_PRIORS)
        prior = np.clip(np.log(changed / same), least, _MOST_PRIOR)
        self.class_prior = np.where(CLASS_PRIOR == 0.0, 0.0, prior).astype(np.float32)
        if self.moments >= _FEWEST_MOMENTS:
            square = np.ones((_SQUARE_PX, _SQUARE_PX), np.uint8)
            still = (self.changed >= _STILL * self.moments) & (self.unsupported >= _ALONE * self.moments)
            opened = np.asarray(cv2.morphologyEx(still.view(np.uint8), cv2.MORPH_OPEN, square), np.uint8)
            drop_specks(opened, _LEAST_MOVED * opened.size)
            self.moved = np.asarray(cv2.dilate(opened, square) > 0)
