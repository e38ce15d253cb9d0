"""Sheets of all cameras: a fit over what they saw, before and after; what cannot be told from background."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.export.text import WHITE_BGR, write_text
from services.mocap.export.tiles import (
    BEYOND_BGR,
    MISSED_BGR,
    UNSURE_BGR,
    Grid,
    draw_difference,
    draw_unsure,
    grid_for,
)
from services.mocap.types import ACTOR, Bytes, Floats, Mask, Trimap

_SCREEN_WIDTH_PX = 1920
_NARROWEST_PX, _WIDEST_PX = 240, 480
_HEADER_PX, _GAP_PX = 34, 10
_MARGIN = 0.08
"""Round the actor, as a share of the actor's height and width in the picture."""
_TEXT_SCALE = 0.55


@dataclass(frozen=True, eq=False)
class Seen:
    """One camera's picture of the actor."""

    camera: Camera
    picture: Bytes
    """(H, W, 3) undistorted."""
    trimap: Trimap
    """(H, W)"""


@dataclass(frozen=True, eq=False)
class Shown:
    """One state of the fit in all cameras."""

    title: str
    segment_masks: Sequence[Bytes]
    """Per camera (H, W): 0 = no model, 1 = centre, 2 = left limb, 3 = right limb."""
    ious: Floats
    """(C,) overlap of model and silhouette in each camera (IoU)."""


def draw_fit(seen: Sequence[Seen], states: Sequence[Shown]) -> Bytes:
    """The sheet (H, W, 3): for each state its title, and a tile for each camera, cut round the actor.

    Silhouette without model is yellow, model without silhouette magenta, unsure pixels cyan.
    """
    grid = _sheet_grid(seen)
    cuts = [
        _cut((one.trimap == ACTOR) | np.any([state.segment_masks[c] > 0 for state in states], axis=0), grid)
        for c, one in enumerate(seen)
    ]
    return np.vstack([_block(seen, state, cuts, grid) for state in states])[:-_GAP_PX]


def draw_unsure_sheet(seen: Sequence[Seen], titles: Sequence[str]) -> Bytes:
    """The sheet (H, W, 3): a tile with its title for each camera, unsure pixels cyan."""
    grid = _sheet_grid(seen)
    sheet: Bytes = np.zeros((grid.rows * grid.tile_height_px, grid.columns * grid.tile_width_px, 3), np.uint8)
    for c, (one, title) in enumerate(zip(seen, titles, strict=True)):
        tile = draw_unsure(one.picture, one.trimap, grid)
        write_text(tile, title, (8, 20), UNSURE_BGR, _TEXT_SCALE)
        grid.place(sheet, c)[:] = tile
    return sheet


def _sheet_grid(seen: Sequence[Seen]) -> Grid:
    """The grid of a sheet that is as wide as a screen, or less where cameras are few."""
    cameras = [one.camera for one in seen]
    columns = grid_for(cameras, _WIDEST_PX).columns
    return grid_for(cameras, int(np.clip(_SCREEN_WIDTH_PX / columns, _NARROWEST_PX, _WIDEST_PX)))


def _block(seen: Sequence[Seen], state: Shown, cuts: list[tuple[slice, slice]], grid: Grid) -> Bytes:
    width_px, height_px = grid.columns * grid.tile_width_px, grid.rows * grid.tile_height_px
    block: Bytes = np.zeros((_HEADER_PX + height_px + _GAP_PX, width_px, 3), np.uint8)
    end = write_text(block, state.title, (10, _HEADER_PX - 11), WHITE_BGR, _TEXT_SCALE)
    for text, colour_bgr in (("missed", MISSED_BGR), ("beyond", BEYOND_BGR), ("unsure", UNSURE_BGR)):
        end = write_text(block, text, (end + 20, _HEADER_PX - 11), colour_bgr, _TEXT_SCALE)
    for c, one in enumerate(seen):
        model, cut = state.segment_masks[c], cuts[c]
        tile = draw_difference(one.picture[cut], one.trimap[cut], model[cut], grid)
        write_text(tile, f"{one.camera.name}  IoU {state.ious[c]:.3f}", (8, 20), WHITE_BGR, _TEXT_SCALE)
        grid.place(block[_HEADER_PX:], c)[:] = tile
    return block


def _cut(shown: Mask, grid: Grid) -> tuple[slice, slice]:
    """Rows and columns of a picture that contain everything to show, in the shape of a tile if possible."""
    rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    if not rows.size:
        return slice(None), slice(None)
    height_px = (1 + 2 * _MARGIN) * (rows[-1] - rows[0] + 1)
    width_px = (1 + 2 * _MARGIN) * (columns[-1] - columns[0] + 1)
    shape = grid.tile_height_px / grid.tile_width_px
    height_px, width_px = max(height_px, shape * width_px), max(width_px, height_px / shape)
    middles = (rows[0] + rows[-1]) / 2, (columns[0] + columns[-1]) / 2
    return _span(middles[0], height_px, shown.shape[0]), _span(middles[1], width_px, shown.shape[1])


def _span(middle: float, length: float, limit: int) -> slice:
    """A range around the middle, shifted into the picture."""
    length = min(round(length), limit)
    start = int(np.clip(round(middle - length / 2), 0, limit - length))
    return slice(start, start + length)
