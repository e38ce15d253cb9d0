"""Which places on the floor each camera sees, told by the colours of the empty stage.

The floor has the same colours in all cameras, but for a gain of each. Where a camera shows another colour
than most of the others, furniture or a wall stands before the floor.
"""

from collections.abc import Sequence

import cv2
import numba
import numpy as np

from services.mocap.types import Bytes, Floats
from services.segmentation.lenses import Lenses
from services.segmentation.pixels import MEAN_STEPS, Levels, Steps

REACH_M, CELL_M = 5.0, 0.1
"""Half the side of the square about the world's origin that is looked at, and of its cells."""
N_CELLS = round(2 * REACH_M / CELL_M)
"""Along a side."""
_UNALIKE = 0.3
"""Difference of the logarithms of two colours, in one of blue, green and red, from which they are of two
surfaces: with texture, noise and light from the side, colours of one differ by less."""
_PATCH = 0.006
"""Half the side of what is looked at, as a share of a picture's width; texture is finer."""
_GAIN_ROUNDS = 3
_FEW = 0.05
"""Share of the places; if fewer have about the usual colour, the camera's gain is another."""


def hidden_floor(height_m: float, lenses: Lenses, plate_means: Sequence[Steps]) -> Bytes:
    """(C, N_CELLS, N_CELLS) 1 where something stands before a place on the floor, seen from each camera.

    Rows go along y, columns along x. plate_means: per camera (3, H, W), in steps. The floor is what most
    cameras that have a place in view agree on. Where no two agree, it counts as hidden from all of them.
    """
    middles_m = np.linspace(-REACH_M, REACH_M, N_CELLS, endpoint=False) + CELL_M / 2
    y_m, x_m = np.meshgrid(middles_m, middles_m, indexing="ij")
    colours = np.full((3, len(plate_means), N_CELLS, N_CELLS), np.nan)
    pixels = lenses.project(np.stack([x_m, y_m, np.full_like(x_m, height_m)], axis=-1))
    for c, (mean, columns, rows) in enumerate(zip(plate_means, pixels[..., 0], pixels[..., 1], strict=True)):
        seen = columns >= 0
        colours[:, c, seen] = _patch_means(mean)[:, rows[seen], columns[seen]]
    logs = np.log(np.maximum(colours / MEAN_STEPS, 1.0))
    logs -= _gains(logs)[..., None, None]
    n_alike, n_unalike = np.zeros((2, *logs.shape[1:]), np.int32)
    with np.errstate(invalid="ignore"):
        for c in range(len(plate_means)):
            apart = np.maximum.reduce([np.abs(channel - channel[c]) for channel in logs])
            n_alike += apart < _UNALIKE
            n_unalike += apart >= _UNALIKE
    n_alike -= ~np.isnan(logs[0])  # each with itself
    most_alike = n_alike.max(axis=0)
    is_odd = (n_alike < most_alike) | (most_alike == 0)
    hidden: Bytes = (is_odd & (n_unalike > n_alike)).astype(np.uint8)
    return hidden


def _gains(logs: Floats) -> Floats:
    """(3, C) the logarithms of each camera's gains, of colours (3, C, N, N), NaN where a camera sees none."""
    flat = np.moveaxis(logs.reshape(3, logs.shape[1], -1), 0, -1)
    flat = flat[:, np.count_nonzero(~np.isnan(flat[..., 0]), axis=0) >= 2]
    gains: Floats = np.zeros((len(flat), 3))
    for _ in range(_GAIN_ROUNDS):
        usual = np.nanmedian(flat - gains[:, None], axis=0)
        for c, of_camera in enumerate(flat):
            off = (of_camera - usual)[~np.isnan(of_camera[:, 0])]
            # Most of what one camera sees of the floor may be furniture, which is no gain of the camera's.
            is_near = np.abs(off - gains[c]).max(axis=1, initial=0.0) < _UNALIKE
            if len(off):
                gains[c] = np.median(off[is_near] if is_near.mean() > _FEW else off, axis=0)
    return gains.T


def _patch_means(mean: Steps) -> Levels:
    """(3, H, W) the mean colours of the patches about a picture's pixels, as far as they are in it."""
    side_px = 2 * max(1, round(_PATCH * mean.shape[2])) + 1
    *totals, n = (
        cv2.boxFilter(plane, cv2.CV_32F, (side_px, side_px), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for plane in (*mean, np.ones_like(mean[0]))
    )
    return np.asarray(np.array(totals) / n)


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def is_hidden(hidden: Bytes, camera: int, x_m: float, y_m: float) -> bool:
    """Whether something stands before a place on the floor, seen from a camera; not so outside the square."""
    column, row = int(np.floor((x_m + REACH_M) / CELL_M)), int(np.floor((y_m + REACH_M) / CELL_M))
    inside = 0 <= column < N_CELLS and 0 <= row < N_CELLS
    return inside and hidden[camera, row, column] != 0


def nothing_hidden(n_cameras: int) -> Bytes:
    """(C, N_CELLS, N_CELLS) of cameras that see the whole floor, as far as is known."""
    return np.zeros((n_cameras, N_CELLS, N_CELLS), np.uint8)
