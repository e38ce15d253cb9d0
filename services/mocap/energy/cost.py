"""What a differing pixel costs, and what a camera's pixels together: plain XOR, and two variations of it."""

from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.picture import Picture
from services.mocap.types import Floats, Mask

Counts: TypeAlias = NDArray[np.int32]

DISTANCE_STEPS = 16
"""Distances count in sixteenths of a pixel, so that sums are whole numbers and the same on every backend."""
_BEYOND_CONTOUR_PX = 0.5  # a contour runs half-way between two pixel centres


@dataclass(frozen=True)
class Cost:
    """How differing pixels add up to an energy; the default is the paper's: every one counts 1."""

    distance_cap_px: float = 0.0
    """If positive, a differing pixel costs its distance to the input silhouette's contour, at most this, in
    pixels of the whole picture."""
    camera_weights: tuple[float, ...] = ()
    """One factor per camera; none at all: all 1."""
    camera_cap: float = 0.0
    """If positive, a camera's energy E enters as cap E / (cap + E), with cap this share of the foreground in
    a middling camera: one whose silhouette is wrong by more than that hardly pulls."""

    def tally(self, picture: Picture) -> "Tally":
        """Turn a picture into what a model's covered pixels add to its energy; raises ValueError where the
        number of weights is not that of cameras."""
        n_cameras = len(picture.region.origin_px)
        if self.camera_weights and len(self.camera_weights) != n_cameras:
            raise ValueError(f"camera_weights: expected {n_cameras}, one per camera, or none")
        on_input, counted = unpack(picture.silhouettes, n_cameras), ~unpack(picture.ignored, n_cameras)
        price, steps = np.where(counted, np.int32(1), np.int32(0)), 1
        if self.distance_cap_px > 0:
            steps = DISTANCE_STEPS
            price *= _distance_steps(on_input, self.distance_cap_px * picture.region.scale)
        weights = np.array(self.camera_weights or (1.0,) * n_cameras, np.float64)
        foreground_px = np.count_nonzero(on_input & counted, axis=(1, 2))
        cap_px = self.camera_cap * float(np.median(foreground_px)) if self.camera_cap > 0 else np.inf
        return Tally(
            gain=np.where(on_input, -price, price),
            blank=np.sum(price, axis=(1, 2), where=on_input, dtype=np.int64),
            weights=weights / steps,
            cap=max(cap_px, 1.0) * steps,
        )


@dataclass(frozen=True, eq=False)
class Tally:
    """A picture as costs: camera c's E_c = blank_c + the sum of gain_c over all pixels that the model covers.

    The energy is the sum of weights_c E_c / (1 + E_c / cap).
    """

    gain: Counts
    """(C, h, w) -cost on the input, +cost off it, 0 where ignored; in steps of a pixel."""
    blank: NDArray[np.int64]
    """(C,) what an empty model costs, in steps."""
    weights: Floats
    """(C,) pixels per step, times the camera's weight."""
    cap: float
    """In steps; infinity for none."""

    @property
    def is_sum(self) -> bool:
        """Whether the energy is a plain sum of the cameras' E_c."""
        return bool(self.cap == np.inf and np.all(self.weights == self.weights[0]))

    def energies(self, per_camera: NDArray[np.int64]) -> Floats:
        """Energies (N,) in pixels of cameras' E_c (N, C) in steps."""
        energies: Floats = (per_camera / (1.0 + per_camera / self.cap)) @ self.weights
        return energies


def _distance_steps(on_input: Mask, cap_px: float) -> Counts:
    """Each pixel's distance to the contour (C, h, w) in steps, at most cap_px."""
    distances_px = [_contour_distance_px(mask.astype(np.uint8)) for mask in on_input]
    capped = np.minimum(np.array(distances_px) - _BEYOND_CONTOUR_PX, cap_px)
    steps: Counts = np.rint(capped * DISTANCE_STEPS).astype(np.int32)
    return steps


def _contour_distance_px(mask: NDArray[np.uint8]) -> NDArray[np.float32]:
    """From every pixel's centre to the nearest centre on the other side."""
    inside, outside = (
        cv2.distanceTransform(side, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for side in (mask, 1 - mask)
    )
    return np.asarray(inside + outside, np.float32)
