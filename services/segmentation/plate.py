"""The empty stage as seen by one camera: colour, noise and outlines of every pixel."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from services.mocap.types import Bytes
from services.segmentation.exposure import Gauge
from services.segmentation.pixels import (
    BB,
    GG,
    MEAN_STEPS,
    RR,
    WHITENING_STEPS,
    Levels,
    Steps,
)
from services.segmentation.plate_noise import PAIRS, add_lacking_noise, statistics_of
from services.segmentation.plate_tone import plate_tone
from services.segmentation.steadying import Anchors

LIGHT_UNCERTAINTY = 0.012
"""Share of a pixel's brightness by which its light may still differ, in patches smaller than the light field
resolves."""
LEAST_RATIO, MOST_RATIO = np.float32(0.35), np.float32(0.97)
"""Brightness in shadow over that in light."""
MOST_EDGE_RATIO = np.float32(1.02)
"""The same of a single pixel at a shadow's edge, whose noise may hide the shadow."""
_LOG_GAUSSIAN = np.float32(1.5 * np.log(2 * np.pi))
_ROOT_TWO_PI = np.float32(np.sqrt(2 * np.pi))
_SHADOW_SPAN = np.float32(MOST_RATIO - LEAST_RATIO)
_SHIFT_PX = 0.35
"""A plate may lie so far off the pictures, by compression or a camera that was touched."""


@dataclass(frozen=True, eq=False)
class Plate:
    """Statistics of the empty stage. Made by `learn`."""

    mean: Steps
    """(3, H, W) blue, green and red at the exposure of the plate's first frame, MEAN_STEPS a level."""
    whitening: Steps
    """(6, H, W) lower triangle of the matrix that turns differences in colour into standard deviations,
    WHITENING_STEPS to one."""
    noise2: Levels
    """(H, W) squared deviation of the noise, the mean of the channels, in levels."""
    turn_noise: Levels
    """(H, W) deviation of the noise across the direction of the background's colour, in levels."""
    slack: Levels
    """(H, W) 0 to 1: weight of a squared deviation, less where the plate may be off by a fraction of a
    pixel."""
    log_peak: Levels
    """(H, W) log density of colours, per cubic level, at zero deviation."""
    log_slack: Levels
    """(H, W) the expected loss of log density of an unchanged pixel."""
    log_span: Levels
    """(H, W) logarithm of a density of one darkness over that of any darkness that shadows have."""
    gauge: Gauge
    anchors: Anchors
    has_other_tone: bool
    """Whether its contrast was another one than that of the take's pictures, and was changed to that."""

    @staticmethod
    def learn(
        frames: Iterable[Bytes], light_uncertainty: float = 0.0, picture: Bytes | None = None
    ) -> "Plate":
        """The plate from BGR uint8 frames (H, W, 3) of the empty stage; a single picture is enough.

        light_uncertainty: share of each pixel's brightness by which the light may vary, treated as noise.
        picture: (H, W, 3) of the take, which may have another contrast and more noise than the plate.

        Flicker between the frames is removed first, so that it does not count as noise. Each pixel's
        covariance is shrunk towards the picture's mean, more for fewer frames. Raises UserError if there are
        no frames or their sizes differ.
        """
        mean, covariance = statistics_of(frames)
        comparable = picture if picture is not None and picture.shape[:2] == mean.shape[1:] else None
        tone = None if comparable is None else plate_tone(mean, comparable)
        if tone is not None:
            mean, slopes = tone.of(mean)
            covariance *= np.stack([slopes[i] * slopes[j] for i, j in PAIRS])
        if comparable is not None:
            add_lacking_noise(comparable, mean, covariance)
        for diagonal in (BB, GG, RR):
            covariance[diagonal] += (light_uncertainty * mean.mean(axis=0)) ** 2
        whitening, turn_noise = _whitening(covariance), _turn_noise(mean, covariance)
        noise2 = (covariance[BB] + covariance[GG] + covariance[RR]) / 3
        slack, brightness = _slack(mean, noise2), np.linalg.norm(mean, axis=0)
        return Plate(
            mean=np.rint(mean * MEAN_STEPS).clip(0, 255 * MEAN_STEPS).astype(np.int16),
            whitening=np.rint(whitening * WHITENING_STEPS).clip(-32768, 32767).astype(np.int16),
            noise2=noise2,
            turn_noise=turn_noise,
            slack=slack,
            log_slack=np.float32(1.5) * np.log(slack),
            log_span=np.log(_ROOT_TWO_PI * turn_noise / (_SHADOW_SPAN * brightness + 1)),
            log_peak=np.log(whitening[BB] * whitening[GG] * whitening[RR]) - _LOG_GAUSSIAN,
            gauge=Gauge.on(np.moveaxis(mean, 0, 2)),
            anchors=Anchors.on(np.moveaxis(mean, 0, 2)),
            has_other_tone=tone is not None,
        )

    def with_noise(self, levels: float) -> "Plate":
        """The plate with more noise. levels: its deviation in each channel; correlations stay as they are."""
        if levels == 0:
            return self
        growth = 1 + np.float32(levels**2) / self.noise2
        slack = growth * self.slack / (1 + (growth - 1) * self.slack)
        return replace(
            self,
            whitening=np.rint(self.whitening / np.sqrt(growth)).astype(np.int16),
            noise2=self.noise2 * growth,
            turn_noise=self.turn_noise * np.sqrt(growth),
            slack=slack,
            log_slack=np.float32(1.5) * np.log(slack),
            log_span=self.log_span + np.log(growth) / 2,
            log_peak=self.log_peak - np.float32(1.5) * np.log(growth),
        )

    @cached_property
    def usual_noise2(self) -> float:
        """Squared deviation of the noise at most pixels."""
        return float(np.median(self.turn_noise[::4, ::4]) ** 2)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.turn_noise.shape[0], self.turn_noise.shape[1]


def _whitening(covariance: Levels) -> Levels:
    """The inverse (6, H, W) of the Cholesky factor of a covariance (6, H, W), both lower triangles."""
    bb, gb, gg, rb, rg, rr = covariance
    l0 = np.sqrt(bb)
    l1, l3 = gb / l0, rb / l0
    l2 = np.sqrt(gg - l1 * l1)
    l4 = (rg - l3 * l1) / l2
    l5 = np.sqrt(rr - l3 * l3 - l4 * l4)
    w1, w4 = -l1 / (l0 * l2), -l4 / (l2 * l5)
    return np.asarray(np.stack([1 / l0, w1, 1 / l2, -(l3 / l0 + l4 * w1) / l5, w4, 1 / l5]))


def _turn_noise(mean: Levels, covariance: Levels) -> Levels:
    """Deviation (H, W) of the noise across the direction of the colour, per axis."""
    b, g, r = mean / np.maximum(np.linalg.norm(mean, axis=0), 1)
    bb, gb, gg, rb, rg, rr = covariance
    along = b * b * bb + g * g * gg + r * r * rr + 2 * (b * g * gb + b * r * rb + g * r * rg)
    return np.asarray(np.sqrt(np.maximum(bb + gg + rr - along, 0) / 2))


def _slack(mean: Levels, noise2: Levels) -> Levels:
    """Noise over noise plus what a shift by `_SHIFT_PX` changes (H, W): 1 on even ground, less at
    outlines."""
    grey = mean.mean(axis=0)
    across, down = (cv2.Sobel(grey, cv2.CV_32F, *axis, scale=1 / 8) for axis in ((1, 0), (0, 1)))
    slope2 = across**2 + down**2
    return np.asarray(noise2 / (noise2 + _SHIFT_PX**2 * slope2))
