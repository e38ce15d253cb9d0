"""Decides which pixels of a silhouette's rim belong to the actor: those that the actor covers by more than
half.

A statistical test takes every pixel that differs at all, which makes silhouettes half a pixel too fat all
round. A rim pixel z mixes actor and background, z = α a + (1 - α) b, and the colours nearby tell a and b:

    a = Σ p z / Σ p                    the actor's colour; purity p = (depth in the mask)⁴
    b = μ (Σ μ·z + 1) / (Σ |μ|² + 1)   the background μ as it should be, as dark as it is beyond the rim
    α = (z - b)·(a - b) / |a - b|²     the actor's share, if z is near the line from a to b

Rows go through the passes one after the other, so that what neighbourhoods are summed over stays in cache.
"""

from math import ceil
from typing import TypeAlias

import cv2
import numba
import numpy as np

from services.mocap.types import Bytes, Floats
from services.segmentation.pixels import MEAN_STEPS, Levels, Steps

EDGE_WIDTH_PERMILLE = 4.7
"""Thousandths of the picture's width: the rim of mixed colours (1.5 px of 320)."""
_MOST_OFF_LINE2 = np.float32(0.4) * np.float32(0.4)
"""How far a mixed colour may lie off the line between its two, over their distance, squared."""
_MIN_CONTRAST_LEVELS = 15.0
"""Of |a - b|; with less contrast, noise would decide about a mixed pixel."""
_MIN_PURITY = 1e-3
_LEAST_OUTSIDE_PX = 2.0
"""So far out of the mask, at least, there may be some actor: thin limbs before noise."""
_RIM_PER_RADIUS = 1.5
_TOO_FAT_PX = 0.5
"""Masks take in pixels that the actor only touches: so much deeper in them lies the rim."""
_EVEN_LEVELS = 8.0
"""Brightness that varies by less than this shows no edge."""
_SCALE = np.float32(1 / MEAN_STEPS)
_N_SUMS = 6
_PURITY, _LIGHT, _SEEN = 3, 4, 5
"""What neighbourhoods are summed over: p z, one channel after the other, p, |μ|² and μ·z."""

_Sums: TypeAlias = tuple[float, float, float, float, float, float]


def settle_edges(
    part: Bytes, corner_px: tuple[int, int], channels: Bytes, expected: Steps, rim_px: float
) -> None:
    """Assign each pixel of a mask's rim to actor or background, whichever covers more than half of it, in
    place.

    part (h, w): the part of the mask that is set, and a margin; corner_px: its first row and column.
    channels, expected (3, H, W): the picture, and the background as it should be in the picture's light, in
    steps. The mask counts where the two sides look alike, or where no mix of their colours explains a pixel:
    it is off the line from a to b by more than 0.4 |a - b|. Shares are evened out along the edges that the
    picture shows (a guided filter), so that noise and codecs leave no ragged outline.
    """
    if rim_px <= 0 or part.size == 0:
        return
    farthest_px = rim_px + _TOO_FAT_PX + 1
    inside2, outside2 = _depths2(part, ceil(farthest_px), np.float32(farthest_px**2))
    share, on_rim = part.astype(np.float32), np.zeros_like(part)
    _mix(share, on_rim, corner_px, inside2, outside2, channels, expected, np.float32(rim_px))
    height, width = part.shape
    (top, left), radius_px = corner_px, max(1, round(rim_px / _RIM_PER_RADIUS))
    picture = cv2.merge([plane[top : top + height, left : left + width] for plane in channels])
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    evened = np.asarray(cv2.ximgproc.guidedFilter(grey, share, radius_px, _EVEN_LEVELS**2))
    near_rim = np.asarray(cv2.dilate(on_rim, np.ones((3, 3), np.uint8)))
    part[:] = np.where(near_rim > 0, evened > 0.5, part)


@numba.njit(cache=True, nogil=True)
def _depths2(mask: Bytes, reach: int, most: np.float32) -> tuple[Levels, Levels]:
    """Squared distances (H, W) of the pixels set to those not set, and the reverse; `most` if farther."""
    height, width = mask.shape
    along = _depths2_along_rows(mask, reach, most)
    depths = along.copy()
    for side in range(2):
        for y in range(height):
            for other in range(max(y - reach, 0), min(y + reach + 1, height)):
                step2 = np.float32((other - y) ** 2)
                for x in range(width):
                    depths[side, y, x] = min(depths[side, y, x], along[side, other, x] + step2)
    return depths[0], depths[1]


@numba.njit(cache=True, nogil=True)
def _depths2_along_rows(mask: Bytes, reach: int, most: np.float32) -> Levels:
    """Squared distances (2, H, W) in each row, to pixels that are not set and to pixels that are."""
    height, width = mask.shape
    along = np.empty((2, height, width), np.float32)
    for y in range(height):
        for x in range(width):
            along[0, y, x] = most * mask[y, x]
            along[1, y, x] = most - along[0, y, x]
        for x in range(1, width):
            if mask[y, x] == mask[y, x - 1]:
                continue
            to_left, to_right = mask[y, x], mask[y, x - 1]  # left of a step 1 it is far from 1, and so on
            for k in range(1, reach + 1):
                if x - k >= 0:
                    along[to_left, y, x - k] = min(along[to_left, y, x - k], k * k)
                if x + k <= width:
                    along[to_right, y, x + k - 1] = min(along[to_right, y, x + k - 1], k * k)
    return along


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _mix(
    share: Levels, on_rim: Bytes, corner_px: tuple[int, int], inside2: Levels, outside2: Levels,
    channels: Bytes, expected: Steps, rim_px: np.float32,
) -> None:  # fmt: skip
    """Mark a mask's rim (h, w), and write the actor's share in its pixels, by sums over neighbourhoods.

    share (h, w): the mask's ones and zeros before.
    """
    height, width = share.shape
    top, left = corner_px
    reach = round(1.5 * rim_px)
    size = 2 * reach + 1
    ring = np.zeros((size + 1, _N_SUMS, width), np.float32)
    columns = np.zeros((_N_SUMS, width))
    rim2, deep2 = rim_px * rim_px, (rim_px + np.float32(_TOO_FAT_PX)) ** 2
    near2 = max(np.float32(_LEAST_OUTSIDE_PX), rim_px / 2) ** 2
    for ahead in range(height + reach):
        coming, leaving = ring[ahead % (size + 1)], ring[(ahead + 1) % (size + 1)]
        if ahead < height:
            _weigh(inside2[ahead], outside2[ahead], channels, expected, top + ahead, left, rim2, coming)
        else:
            coming[:] = 0
        for k in range(_N_SUMS):
            for x in range(width):
                columns[k, x] += coming[k, x] - leaving[k, x]
        y = ahead - reach
        if y < 0:
            continue
        for x in range(width):
            if inside2[y, x] > deep2 or outside2[y, x] > near2:
                continue
            near = _sums_near(columns, max(x - reach, 0), min(x + reach + 1, width))
            if near[_PURITY] > _MIN_PURITY:
                on_rim[y, x] = 1
                share[y, x] = _share(share[y, x], channels, expected, top + y, left + x, near)


@numba.njit(cache=True, nogil=True, inline="always")
def _sums_near(columns: Floats, begin: int, end: int) -> _Sums:
    """The sums of some columns (6, w), all six in one loop, because a single sum would wait for its own
    result."""
    blue = green = red = purity = light = seen = 0.0
    for x in range(begin, end):
        blue += columns[0, x]
        green += columns[1, x]
        red += columns[2, x]
        purity += columns[_PURITY, x]
        light += columns[_LIGHT, x]
        seen += columns[_SEEN, x]
    return blue, green, red, purity, light, seen


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _weigh(
    inside2: Levels, outside2: Levels, channels: Bytes, expected: Steps, y: int, left: int, rim2: np.float32,
    values: Levels,
) -> None:  # fmt: skip
    """Write what neighbourhoods are summed over (6, w) for one row (w,); light beyond the rim only."""
    # Loops that write one row each, so that the compiler vectorises them.
    for x in range(inside2.size):
        # Colours deeper in the body are purer; in a thin limb its middle line has to do.
        values[_PURITY, x] = inside2[x] * inside2[x]
        values[_LIGHT, x] = 0
        values[_SEEN, x] = 0
    for c in range(3):
        seen, plate = channels[c, y, left : left + inside2.size], expected[c, y, left : left + inside2.size]
        for x in range(inside2.size):
            values[c, x] = values[_PURITY, x] * seen[x]
        for x in range(inside2.size):
            light = _SCALE * plate[x]
            values[_LIGHT, x] += light * light
        for x in range(inside2.size):
            values[_SEEN, x] += _SCALE * plate[x] * seen[x]
    for x in range(inside2.size):
        beyond = np.float32(outside2[x] > rim2)
        values[_LIGHT, x] *= beyond
        values[_SEEN, x] *= beyond


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _share(was: np.float32, channels: Bytes, expected: Steps, y: int, x: int, near: _Sums) -> np.float32:
    """The actor's share in a pixel, 0 to 1; unchanged if no mix explains its colour."""
    # Next to the feet the floor is in shadow, which is as dark at the rim as just beyond it.
    one = np.float32(1)
    shade, share = np.float32((near[_SEEN] + 1) / (near[_LIGHT] + 1)), np.float32(1 / near[_PURITY])
    length2 = along = offset2 = np.float32(0)
    for c in range(3):
        behind = _SCALE * expected[c, y, x] * shade
        span, offset = np.float32(near[c]) * share - behind, np.float32(channels[c, y, x]) - behind
        length2 += span * span
        along += offset * span
        offset2 += offset * offset
    off_line2 = offset2 - along * along / max(length2, one)
    if length2 <= _MIN_CONTRAST_LEVELS**2 or off_line2 >= _MOST_OFF_LINE2 * length2:
        return was
    return min(max(along / length2, np.float32(0)), one)
