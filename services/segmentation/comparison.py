"""One camera's picture against its clean plate: what has changed, and what of that may be shadow.

With z a pixel's colour, m the plate's mean, W its whitening matrix (W'W is the inverse of the noise's
covariance), g the picture's gains and f the light field:

    d² = |W (z - g f m)|²           squared deviation; 3 on average where nothing has changed
    change = slope (d² - even)      evidence for a change, within limits, then averaged over 3x3 pixels

In shadow the background keeps its colour and its texture: it is ρ times as bright as expected. By least
squares over the 5x5 pixels about a pixel, or over the pixel alone, with μ = g f m:

    ρ = Σ z·μ / Σ (|μ|² + 1)
    misfit = Σ |z|² - ρ Σ z·μ       what is left once the plate is darkened; noise, if it is shadow
"""

import cv2
import numba
import numpy as np

from services.mocap.types import Bytes
from services.segmentation.cleanup import SPECK_AREA_PPM, Part, box_of, drop_specks
from services.segmentation.light import light_field
from services.segmentation.pixels import BB, GB, GG, MEAN_STEPS, RB, RG, RR, WHITENING_STEPS, Levels, Steps
from services.segmentation.plate import LEAST_RATIO, MOST_EDGE_RATIO, MOST_RATIO, Plate
from services.segmentation.plate_noise import check_size
from services.segmentation.plate_shift import shifted

UNSEEN, UNCHANGED, CHANGED, PERHAPS_EDGE, PERHAPS_SHADOW = range(5)
"""State of a pixel: not examined; lit stage; changed; possibly a shadow's edge; possibly shadow."""
LEAST_CHANGE = 0.25
"""A pixel has changed if the evidence for it is larger."""
_SQUARE_PX = 5
"""Size of the squares in which shadow is separated from cloth."""
_MARGIN_PX = 8
"""Margin around changed pixels in which shadow is searched."""
_SLOPE, _EVEN_DEVIATION2 = np.float32(0.25), np.float32(8.0)
"""Evidence for a change per squared deviation, and the neutral deviation (three channels)."""
_LEAST, _MOST = np.float32(-1.5), np.float32(4.0)
"""Bound of the evidence for a change in one pixel."""
_MOST_MISFIT = np.float32(8.0 / 3.0)
"""Largest squared deviation in shadow, in units of the noise, averaged over three channels."""
_MOST_OWN_MISFIT = np.float32(16.0)
"""The same for one pixel, summed over three channels."""
_N_PRODUCTS = 3
_SEEN, _BOTH, _KNOWN = range(_N_PRODUCTS)
"""Planes of a pixel's products: |z|², z·μ and |μ|² + 1."""


class Comparison:
    """One camera's plate, and room for the picture in work."""

    def __init__(self, plate: Plate) -> None:
        self.plate, shape = plate, plate.shape
        self.channels: Bytes = np.empty((3, *shape), np.uint8)
        self.expected: Steps = np.empty((3, *shape), np.int16)
        """(3, H, W) the colours that the plate should have in the picture's light, MEAN_STEPS a level."""
        self.deviation2: Levels = np.empty(shape, np.float32)
        self.change: Levels = np.empty(shape, np.float32)
        """(H, W) evidence for a change."""
        self.part: Part | None = None
        """Bounding rows and columns of all changes; None if there are none."""
        self.ratio: Levels = np.empty(shape, np.float32)
        """(H, W) brightness of the square around a pixel over the expected brightness."""
        self.state: Bytes = np.empty(shape, np.uint8)
        """(H, W) what a pixel shows, UNSEEN to PERHAPS_SHADOW."""

    def look(self, image_bgr: Bytes) -> None:
        """Compare a picture (H, W, 3), moved back where a camera shakes, with the plate; raises UserError if
        its size differs."""
        plate = self.plate
        check_size(image_bgr, plate.shape, "image", "the clean plate")
        right_px, down_px = plate.anchors.shift_px(image_bgr)
        self.compare(next(shifted([image_bgr], (-right_px, -down_px))), light_varies=True)
        cv2.blur(self.change, (3, 3), dst=self.change)
        self.ratio[:], self.state[:] = 1.0, UNCHANGED
        changed = (self.change > LEAST_CHANGE).view(np.uint8)
        drop_specks(changed, SPECK_AREA_PPM * 1e-6 * changed.size)
        self.part = box_of(changed, _MARGIN_PX)
        if self.part is None:
            return
        rows, columns = self.part
        products: Levels = np.empty((_N_PRODUCTS, *self.state[self.part].shape), np.float32)
        corner_px = rows.start, columns.start
        _multiply(self.channels, self.expected, corner_px, products)
        around = np.stack([cv2.blur(plane, (_SQUARE_PX, _SQUARE_PX)) for plane in products])
        _judge(self.change, products, around, plate.turn_noise, corner_px, self.ratio, self.state)

    def compare(self, image_bgr: Bytes, *, light_varies: bool) -> Levels:
        """Write `expected`, `deviation2` and `change` by pixel; returns the picture's gains (3,)."""
        plate = self.plate
        height, width = plate.shape
        gains = plate.gauge.gains(image_bgr)
        cv2.split(image_bgr, list(self.channels))
        light = np.ones(plate.shape, np.float32)
        if light_varies:
            light = np.ascontiguousarray(light_field(self.channels, plate.mean, gains)[:height, :width])
        _compare(
            self.channels, plate.mean, plate.whitening, gains, light, self.expected, self.deviation2,
            self.change,
        )  # fmt: skip
        return gains


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _compare(
    channels: Bytes, mean: Steps, whitening: Steps, gains: Levels, field: Levels, expected: Steps,
    deviation2: Levels, change: Levels,
) -> None:  # fmt: skip
    """Compare a picture (3, H, W) with its plate under a light field (H, W) at gains (3,).

    Writes the colours that the plate should have (3, H, W), in steps; squared deviations (H, W) from these;
    and each pixel's evidence for a change (H, W).
    """
    for y in range(channels.shape[1]):
        for c in range(3):
            _expect(mean[c, y], gains[c], field[y], expected[c, y])
        _deviate(channels, expected, whitening, y, deviation2[y])
        for x in range(deviation2.shape[1]):
            evidence = _SLOPE * (deviation2[y, x] - _EVEN_DEVIATION2)
            evidence = evidence if evidence > _LEAST else _LEAST
            change[y, x] = evidence if evidence < _MOST else _MOST


# One loop per result over contiguous rows, so that the compiler vectorises it.


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _expect(mean: Steps, gain: np.float32, field: Levels, expected: Steps) -> None:
    """Write a row (W,) of one channel that the plate should have."""
    top = np.float32(255 * MEAN_STEPS)
    for x in range(field.size):
        level = gain * field[x] * np.float32(mean[x])
        expected[x] = np.int16(level if level < top else top)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _deviate(channels: Bytes, expected: Steps, whitening: Steps, y: int, deviation2: Levels) -> None:
    """Write a row (W,) of squared deviations."""
    scale, whiten = np.float32(1 / MEAN_STEPS), np.float32(1 / WHITENING_STEPS)
    blue, green, red = channels[0, y], channels[1, y], channels[2, y]
    plate_b, plate_g, plate_r = expected[0, y], expected[1, y], expected[2, y]
    bb, gb, gg = whitening[BB, y], whitening[GB, y], whitening[GG, y]
    rb, rg, rr = whitening[RB, y], whitening[RG, y], whitening[RR, y]
    for x in range(deviation2.size):
        d0 = whiten * (np.float32(blue[x]) - scale * np.float32(plate_b[x]))
        d1 = whiten * (np.float32(green[x]) - scale * np.float32(plate_g[x]))
        d2 = whiten * (np.float32(red[x]) - scale * np.float32(plate_r[x]))
        e0 = np.float32(bb[x]) * d0
        e1 = np.float32(gb[x]) * d0 + np.float32(gg[x]) * d1
        e2 = np.float32(rb[x]) * d0 + np.float32(rg[x]) * d1 + np.float32(rr[x]) * d2
        deviation2[x] = e0 * e0 + e1 * e1 + e2 * e2


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _multiply(channels: Bytes, expected: Steps, corner_px: tuple[int, int], products: Levels) -> None:
    """Write the products (_N_PRODUCTS, h, w) of a picture's part; corner_px: its first row and column."""
    top, left = corner_px
    for i in range(products.shape[1]):
        _multiply_row(channels, expected, top + i, left, products[:, i])


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _multiply_row(channels: Bytes, expected: Steps, y: int, left: int, products: Levels) -> None:
    """Write the products (_N_PRODUCTS, w) of a part of a row."""
    seen, both, known = products[_SEEN], products[_BOTH], products[_KNOWN]
    scale, columns = np.float32(1 / MEAN_STEPS), slice(left, left + seen.size)
    blue, green, red = channels[0, y, columns], channels[1, y, columns], channels[2, y, columns]
    plate_b, plate_g, plate_r = expected[0, y, columns], expected[1, y, columns], expected[2, y, columns]
    for x in range(seen.size):
        b, g, r = np.float32(blue[x]), np.float32(green[x]), np.float32(red[x])
        m0 = scale * np.float32(plate_b[x])
        m1 = scale * np.float32(plate_g[x])
        m2 = scale * np.float32(plate_r[x])
        seen[x] = b * b + g * g + r * r
        both[x] = b * m0 + g * m1 + r * m2
        known[x] = m0 * m0 + m1 * m1 + m2 * m2 + np.float32(1)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _judge(
    change: Levels, products: Levels, around: Levels, turn_noise: Levels, corner_px: tuple[int, int],
    ratio: Levels, state: Bytes,
) -> None:  # fmt: skip
    """Write what pixels show (H, W), and the brightness (H, W) of the square about each over the expected.

    change (H, W): the evidence for one. products (_N_PRODUCTS, h, w) of the pixels in a part of the
    picture, and around them on average; corner_px: its first row and column.
    """
    for i in range(products.shape[1]):
        for k in range(products.shape[2]):
            y, x = corner_px[0] + i, corner_px[1] + k
            noise2 = turn_noise[y, x] * turn_noise[y, x]
            share = around[_BOTH, i, k] / around[_KNOWN, i, k]
            left = (around[_SEEN, i, k] - share * around[_BOTH, i, k]) / np.float32(3)
            own = products[_BOTH, i, k] / products[_KNOWN, i, k]
            own_left = products[_SEEN, i, k] - own * products[_BOTH, i, k]
            is_shadow = (share > LEAST_RATIO) & (share < MOST_RATIO) & (left < _MOST_MISFIT * noise2)
            is_edge = (own > LEAST_RATIO) & (own < MOST_EDGE_RATIO) & (own_left < _MOST_OWN_MISFIT * noise2)
            changed = change[y, x] > LEAST_CHANGE
            dark = PERHAPS_SHADOW if is_shadow else (PERHAPS_EDGE if is_edge else CHANGED)
            ratio[y, x] = share
            state[y, x] = dark if changed else UNCHANGED
