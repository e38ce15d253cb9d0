"""The empty stage as seen by one camera: colour, noise and outlines of every pixel."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import cv2
import numba
import numpy as np

from services.mocap.errors import UserError
from services.mocap.types import Bytes, Mask
from services.segmentation.light import Gauge
from services.segmentation.pixels import (
    BB,
    GB,
    GG,
    MAD_SIGMA,
    MEAN_STEPS,
    RB,
    RG,
    RR,
    WHITENING_STEPS,
    Levels,
    Steps,
)
from services.segmentation.plate_tone import plate_tone
from services.segmentation.steadying import Anchors

LIGHT_UNCERTAINTY = 0.012
"""Share of a pixel's brightness by which its light may still differ, in patches smaller than the light field
resolves."""
LEAST_RATIO, MOST_RATIO = np.float32(0.35), np.float32(0.97)
"""Brightness in shadow over that in light."""
MOST_EDGE_RATIO = np.float32(1.02)
"""The same of a single pixel at a shadow's edge, whose noise may hide the shadow."""
_NOISE_FLOOR_LEVELS = 1.5
"""Deviation per channel that a plate does not show: rounding, a codec's still scene."""
_PLATE_NOISE_LEVELS, _CODEC_NOISE_LEVELS = (0.1, 0.8), (5.0, _NOISE_FLOOR_LEVELS)
"""The same, by the deviation that the plate shows, where a codec may have removed some: the more it
compresses, the less noise of a still scene is left, and the larger are its errors where something moves."""
_CLIPPED = (1, 254)
"""Levels from which on noise is cut off."""
_LEAST_WHOLE = 0.2
"""Share of the picture; if fewer pixels of a stage are not clipped, the actor's are most of them."""
_ASSUMED_NOISE_LEVELS = 2.5
"""Deviation per channel, assumed where the plate is a single picture."""
_PRIOR_FRAMES = 10.0
"""A pixel's own covariance counts as much as the picture's mean one after so many."""
_PAIRS = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))
"""Channels whose products make up the planes BB to RR."""
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
        frames: Iterable[Bytes],
        light_uncertainty: float = 0.0,
        picture: Bytes | None = None,
        *,
        of_codec: bool = True,
    ) -> "Plate":
        """The plate from BGR uint8 frames (H, W, 3) of the empty stage; a single picture is enough.

        light_uncertainty: share of each pixel's brightness by which the light may vary, treated as noise.
        picture: (H, W, 3) of the take, which may have another contrast and more noise than the plate.
        of_codec: whether pictures may differ from the plate by errors of a codec that it does not show.

        Flicker between the frames is removed first, so that it does not count as noise. Each pixel's
        covariance is shrunk towards the picture's mean, more for fewer frames. Raises UserError if there are
        no frames or their sizes differ.
        """
        mean, covariance = _statistics(frames, of_codec=of_codec)
        comparable = picture if picture is not None and picture.shape[:2] == mean.shape[1:] else None
        tone = None if comparable is None else plate_tone(mean, comparable)
        if tone is not None:
            mean, slopes = tone.of(mean)
            covariance *= np.stack([slopes[i] * slopes[j] for i, j in _PAIRS])
        if comparable is not None:
            _add_lacking_noise(comparable, mean, covariance)
        for diagonal in (BB, GG, RR):
            covariance[diagonal] += (light_uncertainty * mean.mean(axis=0)) ** 2
        whitening, turn_noise = _whitening(covariance), _turn_noise(mean, covariance)
        slack, brightness = _slack(mean, covariance), np.linalg.norm(mean, axis=0)
        return Plate(
            mean=np.rint(mean * MEAN_STEPS).clip(0, 255 * MEAN_STEPS).astype(np.int16),
            whitening=np.rint(whitening * WHITENING_STEPS).clip(-32768, 32767).astype(np.int16),
            turn_noise=turn_noise,
            slack=slack,
            log_slack=np.float32(1.5) * np.log(slack),
            log_span=np.log(_ROOT_TWO_PI * turn_noise / (_SHADOW_SPAN * brightness + 1)),
            log_peak=np.log(whitening[BB] * whitening[GG] * whitening[RR]) - _LOG_GAUSSIAN,
            gauge=Gauge.on(np.moveaxis(mean, 0, 2)),
            anchors=Anchors.on(np.moveaxis(mean, 0, 2)),
            has_other_tone=tone is not None,
        )

    @cached_property
    def usual_noise2(self) -> float:
        """Squared deviation of the noise at most pixels."""
        return float(np.median(self.turn_noise[::4, ::4]) ** 2)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.turn_noise.shape[0], self.turn_noise.shape[1]


def _statistics(frames: Iterable[Bytes], *, of_codec: bool) -> tuple[Levels, Levels]:
    """Mean (3, H, W), and the lower triangle (6, H, W) of a new picture's covariance about it.

    With S a pixel's scatter matrix over n frames, C the picture's mean covariance and k _PRIOR_FRAMES, the
    covariance is (1 + 1/n) (S + k C) / (n - 1 + k) + f^2, where the noise floor f follows from C if the
    pictures may be of a codec.
    """
    count = 0
    for frame in frames:  # only sums are kept, so that long plates of large pictures fit into memory
        if count == 0:
            first = frame.astype(np.float32)
            gauge = Gauge.on(first)
            total = np.zeros((3, frame[..., 0].size), np.float32)
            products = np.zeros((6, frame[..., 0].size), np.float32)
        check_size(frame, first.shape, f"clean plate, frame {count}", "its first frame")
        # Differences from the first frame are small, which keeps sums in single precision exact enough.
        scales = np.float32(1) / gauge.gains(frame)
        pixels = np.ascontiguousarray(frame).reshape(-1, 3)
        _add_products(pixels, scales, first.reshape(-1, 3), total, products)
        count += 1
    if count == 0:
        raise UserError("clean plate: no frames: expected one picture or more of the empty scene")
    shift, extra = total / count, count - 1
    scatter = products - count * np.stack([shift[i] * shift[j] for i, j in _PAIRS])
    one = np.array([float(i == j) for i, j in _PAIRS], np.float32)[:, None]
    common = one * _ASSUMED_NOISE_LEVELS**2
    if extra:  # the mean of all pixels but those that are clipped, and those where something moved
        spread = np.maximum(scatter[BB] + scatter[GG] + scatter[RR], 0)  # rounding can make it negative
        is_whole = _is_whole(first).ravel()
        counted = is_whole if is_whole.any() else np.ones_like(is_whole)
        counted = counted & (spread <= 4 * np.median(spread[counted]))
        common = scatter[:, counted].mean(axis=1, keepdims=True) / extra
    covariance = (scatter + _PRIOR_FRAMES * common) / (extra + _PRIOR_FRAMES)
    covariance *= 1 + 1 / count  # the mean's own noise adds to the new picture's
    noise_levels = np.sqrt(max(float((common[BB] + common[GG] + common[RR])[0]), 0.0) / 3)
    floor_levels = np.interp(noise_levels, _PLATE_NOISE_LEVELS, _CODEC_NOISE_LEVELS)
    covariance += one * (floor_levels if of_codec else _NOISE_FLOOR_LEVELS) ** 2
    height, width = first.shape[:2]
    mean = np.moveaxis(first, 2, 0) + shift.reshape(3, height, width)
    return mean.astype(np.float32), covariance.reshape(6, height, width).astype(np.float32)


def _is_whole(picture: Bytes | Levels) -> Mask:
    """Where no channel of a picture (H, W, 3) is clipped: (H, W)."""
    return np.asarray(((picture > _CLIPPED[0]) & (picture < _CLIPPED[1])).all(axis=2))


def _add_lacking_noise(picture: Bytes, mean: Levels, covariance: Levels) -> None:
    """Add to a covariance (6, H, W) about a mean (3, H, W) the noise that a picture (H, W, 3) has beyond it.

    Noise is told by how far most pixels are off the plate, beside their neighbours: light and an actor in the
    picture hardly change that.
    """
    expected = np.moveaxis(mean, 0, 2)
    expected = expected * Gauge.on(expected).gains(picture)
    off = picture - expected
    off -= cv2.blur(off, (3, 3))  # which leaves 8/9 of the noise's variance
    is_whole = _is_whole(picture) & _is_whole(np.moveaxis(mean, 0, 2))
    if is_whole.mean() < _LEAST_WHOLE:
        return
    noise2 = 9 / 8 * (MAD_SIGMA * np.median(np.abs(off[is_whole]), axis=0)) ** 2
    for diagonal, seen in zip((BB, GG, RR), noise2, strict=True):
        covariance[diagonal] += max(float(seen - np.median(covariance[diagonal])), 0.0)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _add_products(frame: Bytes, scales: Levels, first: Levels, total: Levels, products: Levels) -> None:
    """Add the difference of a frame (N, 3), its channels scaled (3,), from the first (N, 3) to running sums.

    total (3, N): of the difference; products (6, N): of the lower triangle of its outer product.
    """
    for i in range(frame.shape[0]):
        blue = np.float32(frame[i, 0]) * scales[0] - first[i, 0]
        green = np.float32(frame[i, 1]) * scales[1] - first[i, 1]
        red = np.float32(frame[i, 2]) * scales[2] - first[i, 2]
        total[0, i] += blue
        total[1, i] += green
        total[2, i] += red
        products[BB, i] += blue * blue
        products[GB, i] += green * blue
        products[GG, i] += green * green
        products[RB, i] += red * blue
        products[RG, i] += red * green
        products[RR, i] += red * red


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


def _slack(mean: Levels, covariance: Levels) -> Levels:
    """Noise over noise plus what a shift by `_SHIFT_PX` changes (H, W): 1 on even ground, less at
    outlines."""
    grey = mean.mean(axis=0)
    across, down = (cv2.Sobel(grey, cv2.CV_32F, *axis, scale=1 / 8) for axis in ((1, 0), (0, 1)))
    slope2 = across**2 + down**2
    noise2 = (covariance[BB] + covariance[GG] + covariance[RR]) / 3
    return np.asarray(noise2 / (noise2 + _SHIFT_PX**2 * slope2))


def check_size(image: Bytes, shape: tuple[int, ...], what: str, like: str) -> None:
    """Raise UserError where an image is not as high and wide as `like`, whose shape is given."""
    if image.shape[:2] != shape[:2]:
        raise UserError(
            f"{what}: expected {shape[1]}x{shape[0]} pixels, the size of {like}, found "
            f"{image.shape[1]}x{image.shape[0]}: record clean plate and take at the same size"
        )
