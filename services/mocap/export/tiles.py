"""Pictures for the overlay: the model drawn over one camera's picture, and how tiles share a sheet."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from services.mocap.camera.camera import Camera
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Bytes, Mask, Trimap

# Distinguishable with colour blindness (after Okabe and Ito).
CENTRE_BGR = (120, 220, 90)
LEFT_BGR = (0, 94, 243)
RIGHT_BGR = (240, 150, 30)
MISSED_BGR, BEYOND_BGR = (0, 235, 255), (255, 0, 255)
"""Colours of actor without model, and of model without actor."""
DOUBTFUL_BGR = (40, 40, 230)
"""Hatching over parts whose pose is doubtful."""
DOUBTFUL_TEXT_BGR = (110, 110, 255)
"""Brighter, for text on black."""
_HATCH_PX, _HATCH_LINE_PX = 7, 3
_HATCH_EDGE_BGR = (235, 235, 255)
"""Beside every line of the hatching, as red alone is hardly seen on orange."""
UNSURE_BGR = (255, 255, 0)
"""Pixels that may be actor or background."""
CLASSES_BGR = (
    *((0, 159, 230), (233, 180, 86), (115, 158, 0), (66, 228, 240)),
    *((178, 114, 0), (0, 94, 213), (167, 121, 204)),
)
"""Of the colour classes 1 to 7."""
_OPACITY = 0.5
_OUTLINE_BGR = (255, 255, 255)
_HALO_BGR = (0, 0, 0)
"""Around the outline, so that it shows on a bright picture."""

_SMOOTHING_PX = 0.75
"""How far the outline may deviate from the border's pixels, so that it is smooth."""

SILHOUETTE_GREY = 128
SILHOUETTE_GROUND_GREY = 24
UNSURE_GREY = 76
_SCREEN_SHAPE = (16, 9)
_FULL_GRID_ZOOM = 0.7
"""How much smaller than in the best grid the tiles may be, to avoid gaps in the grid."""

_MISSED, _BEYOND, _UNSURE = 4, 5, 6
# By the values of a segment mask, and these three.
_COLOURS = np.array(
    [(0, 0, 0), CENTRE_BGR, LEFT_BGR, RIGHT_BGR, MISSED_BGR, BEYOND_BGR, UNSURE_BGR], np.float32
)
# By the values of a segment mask: the fill's colour times its coverage (3) and the coverage (1), 0 to 255, in
# one number, which is looked up ten times as fast.
_FILL = np.column_stack([_COLOURS[:4], (0, 255, 255, 255)]).astype(np.uint8).view(np.uint32)[:, 0]
_OPACITIES = np.array([0.0, 0.4, 0.4, 0.4, 0.9, 0.9, 0.5], np.float32)


@dataclass(frozen=True)
class Grid:
    """Tiles of one size in rows, filled from the top left."""

    columns: int
    rows: int
    tile_width_px: int
    tile_height_px: int

    def place(self, sheet: Bytes, index: int) -> Bytes:
        """The part of a sheet (H, W, 3) that a tile is to fill."""
        row, column = divmod(index, self.columns)
        y, x = row * self.tile_height_px, column * self.tile_width_px
        return sheet[y : y + self.tile_height_px, x : x + self.tile_width_px]


def grid_for(cameras: Sequence[Camera], tile_width_px: int) -> Grid:
    """The grid with the largest tiles on a wide screen; one without gaps may have slightly smaller tiles.

    A tile has the median shape of the cameras' pictures, and even sides, as video requires.
    """
    shape = float(np.median([camera.height_px / camera.width_px for camera in cameras]))
    width_px = max(2, 2 * round(tile_width_px / 2))
    height_px = max(2, 2 * round(tile_width_px * shape / 2))
    count = len(cameras)
    grids = [Grid(columns, -(-count // columns), width_px, height_px) for columns in range(count, 0, -1)]

    def zoom(grid: Grid) -> float:
        screen_width, screen_height = _SCREEN_SHAPE
        return min(screen_width / grid.columns, screen_height / (grid.rows * shape))

    enough = _FULL_GRID_ZOOM * max(map(zoom, grids))
    full = [grid for grid in grids if grid.columns * grid.rows == count and zoom(grid) >= enough]
    return max(full or grids, key=lambda grid: (round(zoom(grid), 6), -grid.columns * grid.rows))


def trimap_picture(trimap: Trimap) -> Bytes:
    """A trimap (H, W) drawn in greys, as a picture (H, W, 3)."""
    greys = np.full(256, SILHOUETTE_GROUND_GREY, np.uint8)
    greys[[UNSURE, ACTOR]] = UNSURE_GREY, SILHOUETTE_GREY
    return np.repeat(greys[trimap][..., None], 3, axis=-1)


def differing_pixels(trimap: Trimap, segment_mask: Bytes) -> Mask:
    """(H, W) where model and silhouette differ; unsure pixels never do."""
    model = segment_mask > 0
    differing: Mask = (model & (trimap == BACKGROUND)) | (~model & (trimap == ACTOR))
    return differing


def draw_tile(picture: Bytes, segment_mask: Bytes, grid: Grid, doubtful: Mask | None = None) -> Bytes:
    """A tile (tile_height_px, tile_width_px, 3): the picture in the middle, the model over it.

    picture: (H, W, 3). segment_mask: (H, W), 0 = no model, 1 = centre, 2 = left limb, 3 = right limb.
    doubtful: (H, W), which pixels are hatched. Where the shape of the picture is not the tile's, black bars
    fill the rest.
    """
    size = _fitting(segment_mask.shape, grid)
    drawn, fill = _resized(picture, size), _resized(_FILL.take(segment_mask)[..., None].view(np.uint8), size)
    _lay_over(drawn, fill)
    _hatch(drawn, doubtful)
    _outline(drawn, fill[..., 3], _OUTLINE_BGR)
    return _centred(drawn, grid)


@numba.njit(cache=True, nogil=True)
def _lay_over(picture: Bytes, fill: Bytes) -> None:
    """Lay a fill (H, W, 4), three colours times its coverage and the coverage, 0 to 255, over a picture
    (H, W, 3)."""
    for y in range(fill.shape[0]):
        for x in range(fill.shape[1]):
            if fill[y, x, 3] > 0:
                left = 1.0 - _OPACITY * fill[y, x, 3] / 255.0
                for k in range(3):
                    picture[y, x, k] = np.uint8(np.rint(left * picture[y, x, k] + _OPACITY * fill[y, x, k]))


def draw_difference(
    picture: Bytes, trimap: Trimap, segment_mask: Bytes, grid: Grid, doubtful: Mask | None = None
) -> Bytes:
    """A tile: the picture with the model over it, and every differing pixel, however small, over both.

    Arguments as draw_tile's, and the trimap (H, W) that the model is compared with. Actor without model is
    yellow, model without actor magenta; unsure pixels are cyan. Differing pixels are not hatched.
    """
    kinds = np.where(trimap == UNSURE, _UNSURE, segment_mask)
    differing = np.where(segment_mask == 0, _MISSED, _BEYOND)
    differs = differing_pixels(trimap, segment_mask)
    kinds = np.where(differs, differing, kinds)
    return _draw_kinds(picture, kinds, grid, None if doubtful is None else doubtful & ~differs)


def draw_classes(picture: Bytes, classes: Bytes, segment_mask: Bytes, grid: Grid) -> Bytes:
    """A tile: the picture with the colour classes (H, W) of its pixels, 0 for none, and the model's outer
    outline over them. Other arguments as draw_tile's."""
    size = _fitting(classes.shape, grid)
    drawn, shown = _resized(picture, size), cv2.resize(classes, size, interpolation=cv2.INTER_NEAREST)
    coloured = np.array([(0, 0, 0), *CLASSES_BGR], np.uint8)[shown]
    drawn = np.where(shown[..., None] > 0, coloured, drawn)
    _outline(drawn, _resized(np.asarray((segment_mask > 0) * 255, np.uint8), size), _OUTLINE_BGR)
    return _centred(drawn, grid)


def draw_unsure(picture: Bytes, trimap: Trimap, grid: Grid) -> Bytes:
    """A tile: the picture (H, W, 3) with a tint over the unsure pixels of a trimap (H, W)."""
    return _draw_kinds(picture, np.where(trimap == UNSURE, _UNSURE, 0), grid)


def _draw_kinds(
    picture: Bytes, kinds: NDArray[np.integer[Any]], grid: Grid, doubtful: Mask | None = None
) -> Bytes:
    """A tile: the picture, and over it the colours of kinds (H, W), and hatching."""
    size = _fitting(kinds.shape, grid)
    shown = cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR).astype(np.float32)
    resized = cv2.resize(kinds.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    opacity = _OPACITIES[resized][..., None]
    drawn = np.rint((1 - opacity) * shown + opacity * _COLOURS[resized]).astype(np.uint8)
    _hatch(drawn, doubtful)
    return _centred(drawn, grid)


def draw_outline(picture: Bytes, segment_mask: Bytes, grid: Grid, doubtful: Mask | None = None) -> Bytes:
    """A tile as draw_tile's with the model's outline alone: left and right limbs in their colours."""
    size = _fitting(segment_mask.shape, grid)
    drawn = _resized(picture, size)
    model = cv2.resize(segment_mask, size, interpolation=cv2.INTER_NEAREST)
    for value, colour_bgr in ((1, CENTRE_BGR), (2, LEFT_BGR), (3, RIGHT_BGR)):
        _outline(drawn, np.asarray((model == value) * 255, np.uint8), colour_bgr)
    _hatch(drawn, doubtful)  # over the outlines, which cover most of an arm in a small tile
    return _centred(drawn, grid)


def _hatch(drawn: Bytes, doubtful: Mask | None) -> None:
    """Draw slanting lines where a picture (h, w, 3), which may have been resized, is doubtful (H, W)."""
    if doubtful is None or not doubtful.any():
        return
    height, width = drawn.shape[:2]
    shown = _resized(np.asarray(doubtful * 255, np.uint8), (width, height)) > 127
    phase = (np.arange(height)[:, None] + np.arange(width)) % _HATCH_PX
    drawn[shown & (phase < _HATCH_LINE_PX)] = DOUBTFUL_BGR
    drawn[shown & (phase == _HATCH_LINE_PX)] = _HATCH_EDGE_BGR


def _fitting(shape: tuple[int, ...], grid: Grid) -> tuple[int, int]:
    """Width and height of a picture (H, W) scaled to fit a tile."""
    height, width = shape
    zoom = min(grid.tile_width_px / width, grid.tile_height_px / height)
    return max(1, round(width * zoom)), max(1, round(height * zoom))


def _centred(shown: Bytes, grid: Grid) -> Bytes:
    """A picture in the middle of a tile."""
    right, below = grid.tile_width_px - shown.shape[1], grid.tile_height_px - shown.shape[0]
    tile = cv2.copyMakeBorder(
        shown, below // 2, below - below // 2, right // 2, right - right // 2, cv2.BORDER_CONSTANT
    )
    return np.asarray(tile, np.uint8)


def _resized(picture: Bytes, size: tuple[int, int]) -> Bytes:
    shrinks = size[0] < picture.shape[1]
    resized = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    return np.asarray(resized, np.uint8)


def _outline(drawn: Bytes, coverage: Bytes, colour_bgr: tuple[int, int, int]) -> None:
    """Draw the smoothed border of a coverage (H, W) of 0 to 255, with a dark halo."""
    smooth = cv2.threshold(cv2.GaussianBlur(coverage, (5, 5), 0), 127, 255, cv2.THRESH_BINARY)[1]
    steps, _ = cv2.findContours(smooth, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    contours = [cv2.approxPolyDP(contour, _SMOOTHING_PX, closed=True) for contour in steps]
    cv2.drawContours(drawn, contours, -1, _HALO_BGR, 3, cv2.LINE_AA)
    cv2.drawContours(drawn, contours, -1, colour_bgr, 1, cv2.LINE_AA)
