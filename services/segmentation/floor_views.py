"""Which places on the floor each camera sees, told by the colours of the empty stage.

The floor has the same colours in all cameras, but for a gain of each. Where a camera shows another colour
than most of the others, furniture or a wall stands before the floor.
"""

from collections.abc import Sequence

import numba
import numpy as np

from services.mocap.types import Bytes, Floats, Ints
from services.segmentation.lenses import Lenses, Pixels, raw_pixel
from services.segmentation.pixels import MEAN_STEPS, Steps

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
    middles_m: Floats = np.linspace(-REACH_M, REACH_M, N_CELLS, endpoint=False, dtype=np.float64) + CELL_M / 2
    colours = np.full((3, len(plate_means), N_CELLS, N_CELLS), np.nan)
    for c, mean in enumerate(plate_means):
        radius_px = max(1, round(_PATCH * mean.shape[2]))
        _sample(middles_m, height_m, lenses.P_px_world[c], lenses.sizes_px[c], lenses.raw_px[c], mean,
                radius_px, colours[:, c])  # fmt: skip
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


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sample(
    middles_m: Floats, height_m: float, P_px_world: Floats, size_px: Ints, raw_px: Pixels, mean: Steps,
    radius_px: int, colours: Floats,
) -> None:  # fmt: skip
    """Write the mean colours (3, N, N) of the patches that one camera shows of cells; NaN stays elsewhere."""
    for i, y_m in enumerate(middles_m):
        for j, x_m in enumerate(middles_m):
            column, row = raw_pixel(P_px_world, size_px, raw_px, x_m, y_m, height_m)
            if column < 0:
                continue
            top, bottom = max(row - radius_px, 0), min(row + radius_px + 1, mean.shape[1])
            left, right = max(column - radius_px, 0), min(column + radius_px + 1, mean.shape[2])
            for channel in range(3):
                total = 0.0
                for v in range(top, bottom):
                    for u in range(left, right):
                        total += mean[channel, v, u]
                colours[channel, i, j] = total / ((bottom - top) * (right - left))


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def is_hidden(hidden: Bytes, camera: int, x_m: float, y_m: float) -> bool:
    """Whether something stands before a place on the floor, seen from a camera; not so outside the square."""
    column, row = int(np.floor((x_m + REACH_M) / CELL_M)), int(np.floor((y_m + REACH_M) / CELL_M))
    inside = 0 <= column < N_CELLS and 0 <= row < N_CELLS
    return inside and hidden[camera, row, column] != 0


def nothing_hidden(n_cameras: int) -> Bytes:
    """(C, N_CELLS, N_CELLS) of cameras that see the whole floor, as far as is known."""
    return np.zeros((n_cameras, N_CELLS, N_CELLS), np.uint8)
