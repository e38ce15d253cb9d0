"""A sheet of cameras' pictures in which what cannot be told from the background is tinted."""

from collections.abc import Sequence

import numpy as np

from services.mocap.export.fit_sheet import Seen, sheet_grid, write_text
from services.mocap.export.tiles import UNSURE_BGR, draw_unsure
from services.mocap.types import Bytes


def draw_unsure_sheet(seen: Sequence[Seen], titles: Sequence[str]) -> Bytes:
    """The sheet (H, W, 3): a tile with its title for each camera, unsure pixels cyan."""
    grid = sheet_grid([one.camera for one in seen])
    sheet: Bytes = np.zeros((grid.rows * grid.tile_height_px, grid.columns * grid.tile_width_px, 3), np.uint8)
    for c, (one, title) in enumerate(zip(seen, titles, strict=True)):
        tile = draw_unsure(one.picture, one.trimap, grid)
        write_text(tile, title, (8, 20), UNSURE_BGR)
        x, y = grid.tile_origin_px(c)
        sheet[y : y + tile.shape[0], x : x + tile.shape[1]] = tile
    return sheet
