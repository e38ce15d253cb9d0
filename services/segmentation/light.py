"""How the light on the stage differs from the plate's at the picture's exposure: a smooth field over the
picture that is blind to whoever stands there."""

from functools import cache

import cv2
import numba
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from services.mocap.types import Bytes, Floats, Ints, Mask
from services.segmentation.pixels import MEAN_STEPS, Levels, Steps

_TILES_ACROSS = 20
_SAMPLED_ROWS, _SAMPLED_COLUMNS = 4, 8
"""Of a tile: so many are sampled."""
_BINS = 64
_LEAST_RATIO, _MOST_RATIO = 0.8, 1.25
"""Range of the brightness ratio to the plate at equal exposure; a ratio outside is not a drift of the
light."""
_BINS_PER_RATIO = _BINS / (_MOST_RATIO - _LEAST_RATIO)
_DARKEST = 40.0
"""Sum of three channels, in levels; darker pixels say nothing about the light."""
_LEAST_SAMPLES = 8
_FAR_APART, _APART = 0.06, 0.03
"""A tile this far from the median of its neighbourhood, or later from the present estimate, shows a person or
a shadow."""
_NEAR_TILES, _FAR_TILES = 1.2, 4.0
"""Deviations of the Gaussians by which tiles are smoothed."""
_VARIED = 0.03
"""Range of the field (5 to 95 %) from which light has probably moved over the stage, so that narrow bands are
looked for."""
_BANDS = 4
"""Flat tiles in the height of one tile."""
_BAND_TILES = 7
"""A band is wider than half of so many tiles, and than somebody who stands."""
_BAND_APART = 0.02
"""A flat tile this far from the median of its row's neighbours shows a person."""
_HARDLY_LIGHT, _FADES = 0.015, 0.045
"""Light that a flat tile may have beside a band, and at the end of a band that fades."""
_BAND_REACHES = (0.7, 1.0)
"""Deviations of the Gaussian by which flat tiles are smoothed, in their heights and widths."""
_BAND_WEIGHT = 0.05
"""Weight of no band at all."""
_LEAST_TILES = 5
_LEAST_WEIGHT = np.float32(1e-3)
_FAR_WEIGHT = 0.02
"""Weight of the wide average, for tiles whose neighbours say nothing."""


def light_field(channels: Bytes, mean: Steps, gains: Levels) -> Levels:
    """How much brighter than the plate at its gains a picture is: (H, W) or more, to full tiles.

    With r a tile's median ratio, w its weight (0 for tiles that show somebody) and S the smoothing of what
    is weighed, f = 1 + S[w (r - 1)]. Smoothing takes the tops off; done again to what it left, it puts them
    back: f + S[w' (r - f)]. Where light has moved over the stage, narrow bands are added (see _with_bands).

    channels, mean (3, H, W): the picture and the plate; gains (3,): of the whole picture's channels.
    """
    width = channels.shape[2]
    tile_px = max(8, round(width / _TILES_ACROSS))
    levels = gains / np.float32(MEAN_STEPS)
    ratios, weights = _tiles(channels, mean, levels, (tile_px, tile_px))
    size_px = ratios.shape[1] * tile_px, ratios.shape[0] * tile_px
    if min(ratios.shape) < _LEAST_TILES:
        return np.ones(size_px[::-1], np.float32)
    usual = weights * (np.abs(ratios - cv2.medianBlur(ratios, 5)) < _FAR_APART)
    field = 1 + _smoothed(ratios - 1, usual)
    left = ratios - field
    field += _smoothed(left, weights * (np.abs(left) < _APART))
    if np.ptp(np.percentile(field, (5, 95))) > _VARIED:
        flat_px = -(-tile_px // _BANDS)
        ratios, weights = _tiles(channels, mean, levels, (flat_px, tile_px))
        at = ((np.arange(len(ratios)) + 0.5) * flat_px / tile_px - 0.5).clip(0, len(field) - 1)
        field = _with_bands(_between_rows(field, at), ratios, weights)
        size_px = field.shape[1] * tile_px, field.shape[0] * flat_px
    return np.asarray(cv2.resize(field, size_px, interpolation=cv2.INTER_LINEAR), np.float32)


def _between_rows(field: Levels, at: Floats) -> Levels:
    """Rows (n, w) of a field (h, w) between its own, which are at 0 to h - 1."""
    above = np.minimum(at.astype(int), len(field) - 2)
    share = (at - above)[:, None]
    return np.asarray((1 - share) * field[above] + share * field[above + 1], np.float32)


def _with_bands(field: Levels, ratios: Levels, weights: Levels) -> Levels:
    """A field at flat tiles (h, w) with the bands that full tiles are too high for.

    Far away on the floor, and where it meets the wall, the light changes within a few rows of the picture,
    along a line that is wider than most people. So a row's neighbours are asked, by their median, whether a
    flat tile shows light; arms and people who lie end abruptly. field, ratios, weights (h, w).
    """
    left = np.where(weights > 0, ratios / field - 1, 0)
    beside = np.pad(left, ((0, 0), (_BAND_TILES // 2,) * 2), mode="symmetric")
    usual = np.median(sliding_window_view(beside, _BAND_TILES, axis=1), axis=2)
    is_light = weights * (np.abs(left - usual) < _BAND_APART) * _fading(left)
    down, across = (_smoothing(n, reach) for n, reach in zip(ratios.shape, _BAND_REACHES, strict=True))
    bands = (down @ (left * is_light) @ across) / (down @ is_light @ across + _BAND_WEIGHT)
    return np.asarray(field * (1 + bands), np.float32)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _fading(left: Levels) -> Mask:
    """Which flat tiles (h, w) of some light left may be light: in their row it fades at one end, or goes on
    beyond the picture."""
    height, width = left.shape
    may_be = np.ones((height, width), np.bool_)
    for row in range(height):
        column = 0
        while column < width:
            first, sign = column, np.sign(left[row, column])
            while column < width and sign * left[row, column] > _HARDLY_LIGHT:
                column += 1
            if column == first:
                column += 1
                continue
            begins = first == 0 or abs(left[row, first]) < _FADES
            ends = column == width or abs(left[row, column - 1]) < _FADES
            may_be[row, first:column] = begins or ends
    return may_be


def _tiles(channels: Bytes, mean: Steps, levels: Levels, tile_px: tuple[int, int]) -> tuple[Levels, Levels]:
    """Tiles' (h, w) median ratios of the brightness to the plate's, and weights; tile_px: rows, columns."""
    height, width = channels.shape[1:]
    ratios = np.ones((-(-height // tile_px[0]), -(-width // tile_px[1])), np.float32)
    weights = np.zeros_like(ratios)
    _tile_medians(channels, mean, levels, tile_px, ratios, weights)
    return ratios, weights


def _smoothed(tiles: Levels, weights: Levels) -> Levels:
    """Smoothed tiles (h, w); without weighted tiles nearby, from distant ones; otherwise 0."""
    near, far = (
        [
            _smoothing(len(part), reach) @ part @ _smoothing(part.shape[1], reach)
            for part in (tiles * weights, weights)
        ]
        for reach in (_NEAR_TILES, _FAR_TILES)
    )
    around = far[0] / np.maximum(far[1], _LEAST_WEIGHT)
    return np.asarray((near[0] + _FAR_WEIGHT * around) / (near[1] + _FAR_WEIGHT), np.float32)


@cache
def _smoothing(n: int, reach: float) -> Levels:
    """The matrix (n, n) that smooths a row of n tiles by a Gaussian, with zeros beyond the ends."""
    apart = np.subtract.outer(np.arange(n), np.arange(n)) / reach
    matrix: Floats = np.exp(-0.5 * apart**2) / (reach * np.sqrt(2 * np.pi))
    return np.where(matrix > _LEAST_WEIGHT**2, matrix, 0).astype(np.float32)  # denormal numbers are slow


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _tile_medians(
    channels: Bytes, mean: Steps, levels: Levels, tile_px: tuple[int, int], ratios: Levels, weights: Levels
) -> None:
    """Write to ratios (h, w) the median of the brightness over the plate's, and to weights the share of valid
    pixels."""
    height, width = channels.shape[1:]
    tile_rows, tile_columns = tile_px
    rows_apart, columns_apart = max(tile_rows // _SAMPLED_ROWS, 1), max(tile_columns // _SAMPLED_COLUMNS, 1)
    places, counts = np.empty(width, np.int32), np.empty((ratios.shape[1], _BINS + 1), np.int32)
    for row in range(ratios.shape[0]):
        counts[:] = 0
        for y in range(row * tile_rows, min((row + 1) * tile_rows, height), rows_apart):
            _find_bins(channels, mean, levels, y, places)
            for column in range(ratios.shape[1]):
                for x in range(column * tile_columns, min((column + 1) * tile_columns, width), columns_apart):
                    counts[column, places[x]] += 1
        for column in range(ratios.shape[1]):
            seen = counts[column].sum()
            n = seen - counts[column, _BINS]
            if n < _LEAST_SAMPLES:
                continue
            below, place = 0, 0
            while below + counts[column, place] <= n // 2:
                below += counts[column, place]
                place += 1
            inside = (n / 2 - below) / counts[column, place]
            ratios[row, column] = _LEAST_RATIO + (place + inside) / _BINS_PER_RATIO
            weights[row, column] = n / seen


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _find_bins(channels: Bytes, mean: Steps, levels: Levels, y: int, places: Ints) -> None:
    """Write the bin (W,) of each pixel's ratio in a row; _BINS where it says nothing about the light."""
    blue, green, red = channels[0, y], channels[1, y], channels[2, y]
    plate_b, plate_g, plate_r = mean[0, y], mean[1, y], mean[2, y]
    for x in range(places.size):
        plate = levels[0] * plate_b[x] + levels[1] * plate_g[x] + levels[2] * plate_r[x]
        light = float(blue[x]) + float(green[x]) + float(red[x])
        place = (light / plate - _LEAST_RATIO) * _BINS_PER_RATIO
        places[x] = int(place if (plate >= _DARKEST) & (place > -1) & (place < _BINS) else _BINS)
