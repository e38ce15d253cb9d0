"""The cost of differing pixels, and of a camera's total: plain XOR, and two variations of it."""

from dataclasses import dataclass, field, replace
from math import ceil
from typing import TypeAlias

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from services.mocap.energy.bitplanes import CAMERAS_PER_PLANE, n_planes, unpack
from services.mocap.energy.picture import Picture
from services.mocap.types import Bytes, Floats, Ints, Longs, Mask

Counts: TypeAlias = Ints

DISTANCE_STEPS = 16
"""Distances count in sixteenths of a pixel, so that sums are whole numbers and the same on every backend."""
_EVERY_PIXEL_1: Counts = np.ones((1, 1, 1), np.int32)
_BEYOND_CONTOUR_PX = 0.5  # a contour runs half-way between two pixel centres


@dataclass(frozen=True)
class Cost:
    """How differing pixels add up to an energy; the default is the paper's: every one counts 1."""

    distance_cap_px: float = 0.0
    """If positive, a differing pixel costs its distance to the input silhouette's contour, at most this, in
    pixels of the whole picture."""
    camera_weights: tuple[float, ...] = ()
    """One factor per camera; empty: all 1."""
    camera_cap: float = 0.0
    """If positive, a camera's energy E enters as cap E / (cap + E), with cap this share of the foreground in
    the median camera (times distance_cap_px, if that is positive): one whose silhouette is wrong by more than
    that hardly pulls. Pre-rendering then no longer changes energies by a constant."""
    colour: float = field(default=1.0, compare=False)
    """What a pixel with a wrong colour class costs beside that, in pictures that have classes
    (services.mocap.energy.colours), whatever the camera's cap. No backend has to know of it, so it is left
    out when costs are compared."""

    @property
    def margin_px(self) -> int:
        """How far around a window silhouettes must be known for prices as in the whole picture."""
        return ceil(self.distance_cap_px) + 1 if self.distance_cap_px > 0 else 0

    def priced(self, picture: Picture) -> Picture:
        """The picture with the prices of its pixels, if they differ and it has none yet.

        To be done before windows are cut, or in windows that are larger by margin_px on all sides: contours
        beyond them are not seen. What is ignored by now may be foreground or not.
        """
        if self.distance_cap_px <= 0 or picture.prices is not None:
            return picture
        n_cameras, cap_px = len(picture.region.origin_px), self.distance_cap_px * picture.region.scale
        on_input, unknown = unpack(picture.silhouettes, n_cameras), unpack(picture.ignored, n_cameras)
        distances_px = [_contour_distance_px(*masks) for masks in zip(on_input, unknown, strict=True)]
        capped_px = np.minimum(np.array(distances_px) - _BEYOND_CONTOUR_PX, cap_px)
        return replace(picture, prices=np.rint(capped_px * DISTANCE_STEPS).astype(np.int32))

    def weights(self, n_cameras: int) -> Floats:
        """(C,) weight of each camera's pixels."""
        return np.array(self.camera_weights or (1.0,) * n_cameras, np.float64)

    def tally(self, picture: Picture) -> "Tally":
        """Convert a picture, with prices if needed, to the energy that each covered pixel adds.

        Raises ValueError where the number of weights is not that of cameras, where prices are missing, or
        where planes or prices are not of one size.
        """
        n_cameras = len(picture.region.origin_px)
        if self.camera_weights and len(self.camera_weights) != n_cameras:
            raise ValueError(f"camera_weights: expected {n_cameras}, one per camera, or none")
        prices, steps = (picture.prices, DISTANCE_STEPS) if self.distance_cap_px > 0 else (_EVERY_PIXEL_1, 1)
        if prices is None:
            raise ValueError("prices: the picture needs them, since pixels cost their distance")
        cap_px = np.inf
        if self.camera_cap > 0:
            on_input = unpack(picture.silhouettes, n_cameras)
            foreground_px = float(np.median(np.count_nonzero(on_input, axis=(1, 2))))
            cap_px = max(self.camera_cap * foreground_px, 1.0) * (self.distance_cap_px or 1.0)
        # Compiled code tells arrays that may be written to from others: for these it would be compiled again.
        silhouettes = np.require(picture.silhouettes, requirements=("C", "W"))
        ignored = np.require(picture.ignored, requirements=("C", "W"))
        prices = np.require(prices, requirements=("C", "W"))
        gain = np.empty((n_cameras, *silhouettes.shape[1:]), np.int32)
        blank, has_prices = np.empty(n_cameras, np.int64), self.distance_cap_px > 0
        fit = silhouettes.shape == ignored.shape == (n_planes(n_cameras), *gain.shape[1:])
        if not fit or (has_prices and prices.shape != gain.shape):
            raise ValueError("picture: expected planes of one size, and prices of that size if there are any")
        _price(silhouettes, ignored, prices, has_prices, gain, blank)
        return Tally(gain, blank, self.weights(n_cameras) / steps, cap_px * steps)


@dataclass(frozen=True, eq=False)
class Tally:
    """A picture as costs: camera c's E_c = blank_c + the sum of gain_c over all pixels that the model covers.

    The energy is the sum of weights_c E_c / (1 + E_c / cap).
    """

    gain: Counts
    """(C, h, w) -cost on the input, +cost off it, 0 where ignored; in steps of a pixel."""
    blank: Longs
    """(C,) what an empty model costs, in steps."""
    weights: Floats
    """(C,) pixels per step, times the camera's weight."""
    cap: float
    """In steps; infinity for none."""

    def energies(self, per_camera: Longs) -> Floats:
        """Energies (N,) in pixels of cameras' E_c (N, C) in steps."""
        energies: Floats = (per_camera / (1.0 + per_camera / self.cap)) @ self.weights
        return energies


@numba.njit(cache=True, nogil=True)
def _price(
    silhouettes: Bytes,
    ignored: Bytes,
    prices: Counts,
    has_prices: bool,
    gain: Counts,
    blank: Longs,
) -> None:
    """Write gain and blank of a Tally from planes (P, h, w); prices (C, h, w), or any where all are 1."""
    n_cameras, height, width = gain.shape
    for c in range(n_cameras):
        plane, bit, blank[c] = c // CAMERAS_PER_PLANE, c % CAMERAS_PER_PLANE, 0
        for y in range(height):
            on_input, left_out, to = silhouettes[plane, y], ignored[plane, y], gain[c, y]
            paid = np.int32(0)
            for x in range(width):
                price = np.int32(1 - (left_out[x] >> bit & 1))
                if has_prices:
                    price *= prices[c, y, x]
                is_on = np.int32(on_input[x] >> bit & 1)
                to[x] = price * (1 - 2 * is_on)
                paid += price * is_on
            blank[c] += paid


def _contour_distance_px(mask: Mask, unknown: Mask) -> NDArray[np.float32]:
    """From every pixel's centre to the nearest centre on the other side (H, W), unknown pixels aside."""
    inside, outside = (
        cv2.distanceTransform((side | unknown).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for side in (mask, ~mask)
    )
    return np.where(mask, inside, outside).astype(np.float32)
