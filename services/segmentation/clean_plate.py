"""Silhouettes by clean plate: what the empty scene looks like, pixel by pixel, and what differs from it.

The paper's test: per-pixel colour statistics tell foreground from background, and a limit on the turn of
the colour tells cast shadows from the actor.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import radians, tan

import cv2
import numpy as np

from services.mocap.errors import UserError
from services.mocap.types import Bytes, Ints, Mask
from services.segmentation.cleanup import Levels, SegmentationSettings, settle_edges

_PRIOR_FRAMES = 10.0  # a pixel's own covariance counts as much as the picture's mean one after so many
_SHADOW_SIGMAS = 3.0  # noise that may add to a shadow's turn of colour
_GAUGE_PIXELS = 5000  # more would not make the estimate of the exposure better
_GAUGE_LEVELS = (20.0, 245.0)  # darker pixels are noise, brighter ones may be clipped
_PAIRS = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))  # lower triangle of a (3, 3) matrix


@dataclass(frozen=True, eq=False)
class Gauge:
    """Pixels spread over the picture at which the exposure of frames is compared."""

    places: Ints
    """(n,) flat pixel indices."""
    brightness: Levels
    """(n,) sums over the channels in the reference picture."""

    @staticmethod
    def on(reference: Levels) -> "Gauge":
        """The gauge for a reference picture (H, W, 3); pixels that are nearly black or white are left out."""
        pixels = reference.reshape(-1, 3)
        low, high = _GAUGE_LEVELS
        usable = np.flatnonzero((pixels.mean(axis=1) > low) & (pixels.max(axis=1) < high))
        # By lot: a regular step could hit the same few columns in every row.
        drawn = np.random.default_rng(0).permutation(usable)[:_GAUGE_PIXELS]
        places = np.sort(drawn).astype(np.int32)
        return Gauge(places, pixels[places].sum(axis=1))

    def gain(self, image_bgr: Bytes, limit: float) -> float:
        """Exposure of an image relative to the reference's, within 1 ± limit.

        The median holds as long as more than half of the picture shows the lit background.
        """
        if self.places.size == 0:
            return 1.0
        ratios = image_bgr.reshape(-1, 3)[self.places].sum(axis=1) / self.brightness
        return float(np.clip(np.median(ratios), 1 - limit, 1 + limit))


@dataclass(frozen=True, eq=False)
class CleanPlate:
    """The empty scene as one camera sees it: colour and noise of every pixel. Made by `learn`."""

    settings: SegmentationSettings
    mean: Levels
    """(H, W, 3) BGR at the exposure of the plate's first frame."""
    whitening: Levels
    """(6, H, W) lower triangle of the matrix that turns differences in colour into standard deviations."""
    direction: Levels
    """(H, W, 3) unit BGR vector of the background's colour."""
    turn_noise: Levels
    """(H, W) deviation of the noise across `direction`, in levels."""
    gauge: Gauge

    @staticmethod
    def learn(frames: Iterable[Bytes], settings: SegmentationSettings) -> "CleanPlate":
        """The plate from BGR uint8 frames (H, W, 3) of the empty scene; a single picture is enough.

        Flicker between the frames is evened out first, so that it does not pass for noise. Each pixel's
        covariance is drawn towards the picture's mean one, the more so the fewer the frames. Raises
        UserError where there are no frames or their sizes differ.
        """
        total = _Sums(settings.flicker_limit)
        for frame in frames:
            total.add(frame)
        mean, covariance = total.statistics(settings)
        whitening = np.linalg.inv(np.linalg.cholesky(covariance))
        direction = mean / np.maximum(np.linalg.norm(mean, axis=2, keepdims=True), 1)
        along = np.einsum("hwi,hwij,hwj->hw", direction, covariance, direction)
        across = np.trace(covariance, axis1=2, axis2=3) - along
        return CleanPlate(
            settings=settings,
            mean=mean,
            whitening=np.stack([whitening[..., i, j] for i, j in _PAIRS]),
            direction=direction,
            turn_noise=np.sqrt(across / 2),
            gauge=Gauge.on(mean),
        )

    def foreground(self, image_bgr: Bytes) -> Mask:
        """What is actor in an image (H, W, 3) BGR uint8, its cast shadow left out: a mask (H, W).

        Single specks of noise are still in it; `cleanup` takes them out. Raises UserError where the
        image is not of the plate's size.
        """
        _check_size(image_bgr, self.mean.shape, "image", "the clean plate")
        gain = self.gauge.gain(image_bgr, self.settings.flicker_limit)
        picture, background = image_bgr.astype(np.float32), np.minimum(self.mean * np.float32(gain), 255)
        mask = self._differs(picture - background)
        places = np.flatnonzero(mask).astype(np.int32)
        mask.reshape(-1)[places[self._is_shadow(picture, background, places)]] = False
        return settle_edges(mask, picture, background, self.settings)

    def _differs(self, difference: Levels) -> Mask:
        """Where a difference (H, W, 3) is too large for noise."""
        blue, green, red = cv2.split(difference)
        w = self.whitening
        distance2 = (w[0] * blue) ** 2
        distance2 += (w[1] * blue + w[2] * green) ** 2
        distance2 += (w[3] * blue + w[4] * green + w[5] * red) ** 2
        differs: Mask = distance2 > self.settings.distance_sigmas**2
        return differs

    def _is_shadow(self, picture: Levels, background: Levels, places: Ints) -> Mask:
        """Which of the pixels (n,) are background in shadow: darker, not too dark, of the same colour.

        The turn of colour is the angle between the BGR vectors. Hue itself is undefined on grey walls and
        noisy near them, while a grey wall's vector is as well defined as any: navy before grey turns it by
        tens of degrees, shadow by hardly any. Noise turns dark colours further than bright ones, so its
        share is granted in levels, not in degrees.
        """
        colour = picture.reshape(-1, 3)[places]
        direction = self.direction.reshape(-1, 3)[places]
        along = np.einsum("nc,nc->n", colour, direction)
        expected = np.einsum("nc,nc->n", background.reshape(-1, 3)[places], direction)
        across = np.linalg.norm(colour - along[:, None] * direction, axis=1)
        allowed = along * tan(radians(self.settings.shadow_angle_deg))
        allowed += _SHADOW_SIGMAS * self.turn_noise.reshape(-1)[places]
        darker = (along < expected) & (along >= self.settings.shadow_ratio_min * expected)
        shadow: Mask = darker & (across <= allowed)
        return shadow


class _Sums:
    """Running sums over clean-plate frames, so that long plates of large pictures fit into memory."""

    def __init__(self, flicker_limit: float) -> None:
        self._flicker_limit = flicker_limit
        self._count = 0

    def add(self, frame: Bytes) -> None:
        """Take in one frame (H, W, 3)."""
        if self._count == 0:
            self._first = frame.astype(np.float32)
            self._gauge = Gauge.on(self._first)
            self._sum = np.zeros_like(self._first)
            self._products = np.zeros((*self._first.shape, 3), np.float32)
        _check_size(frame, self._first.shape, f"clean plate, frame {self._count}", "its first frame")
        # Differences from the first frame are small, which keeps sums in single precision exact enough.
        difference = frame / np.float32(self._gauge.gain(frame, self._flicker_limit)) - self._first
        self._sum += difference
        self._products += difference[..., :, None] * difference[..., None, :]
        self._count += 1

    def statistics(self, settings: SegmentationSettings) -> tuple[Levels, Levels]:
        """Mean (H, W, 3), and covariance (H, W, 3, 3) of a new picture's difference from it."""
        if self._count == 0:
            raise UserError("clean plate: no frames: expected one picture or more of the empty scene")
        shift, extra = self._sum / self._count, self._count - 1
        outer = shift[..., :, None] * shift[..., None, :]
        scatter = (self._products - self._count * outer).astype(np.float32, copy=False)
        one = np.eye(3, dtype=np.float32)
        common = _typical(scatter) / extra if extra else one * settings.assumed_noise_levels**2
        covariance = (scatter + _PRIOR_FRAMES * common) / (extra + _PRIOR_FRAMES)
        covariance *= 1 + 1 / self._count  # the mean has noise of its own, which adds to the new picture's
        covariance += one * settings.noise_floor_levels**2
        mean = self._first + shift
        return mean.astype(np.float32, copy=False), covariance.astype(np.float32, copy=False)


def _typical(scatter: Levels) -> Levels:
    """The mean scatter matrix (3, 3) of the pixels, without those where something moved in the plate."""
    spread = np.trace(scatter, axis1=2, axis2=3)
    typical: Levels = scatter[spread <= 4 * np.median(spread)].mean(axis=0)
    return typical


def _check_size(image: Bytes, shape: tuple[int, ...], what: str, like: str) -> None:
    """Raise UserError where an image is not as high and wide as `like`, whose shape is given."""
    if image.shape[:2] != shape[:2]:
        raise UserError(
            f"{what}: expected {shape[1]}x{shape[0]} pixels, the size of {like}, found "
            f"{image.shape[1]}x{image.shape[0]}: record clean plate and take at the same size"
        )
