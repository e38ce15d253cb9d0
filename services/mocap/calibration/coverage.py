"""The picture of a calibration: the positions of the detected corners, and their errors."""

from dataclasses import replace

import cv2
import numpy as np

from services.mocap.calibration.rig_solving import Solution
from services.mocap.calibration.sightings import CELLS, share_of_cells
from services.mocap.export.tiles import grid_for
from services.mocap.types import Bytes, Floats

_SHEET_WIDTH_PX, _WIDEST_TILE_PX = 1920, 640
_HEADER_PX, _LEGEND_PX, _GAP_PX = 30, 34, 6
_GROUND_BGR, _LINE_BGR, _TEXT_BGR = (30, 30, 30), (52, 52, 52), (235, 235, 235)
_FULL_RED_PX = 1.5
_DARKENED = 0.55
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def covered_share(solution: Solution, camera: int) -> float:
    """The share of a camera's picture, in cells of an eighth of its sides, in which corners were seen."""
    one = solution.cameras[camera]
    points_px = solution.corners.points_px[solution.corners.camera == camera]
    return share_of_cells(points_px, one.size_px)


def draw_coverage(solution: Solution) -> Bytes:
    """The sheet (H, W, 3): a tile per camera with every corner that was used, red where it is 1.5 px off.

    Below them is the picture in which most of the board was seen.
    """
    cameras = solution.cameras
    columns = grid_for(cameras, _WIDEST_TILE_PX).columns
    grid = grid_for(cameras, min(_WIDEST_TILE_PX, _SHEET_WIDTH_PX // columns))
    grid = replace(grid, tile_height_px=grid.tile_height_px + _HEADER_PX)
    size_px = grid.columns * grid.tile_width_px, _LEGEND_PX + grid.rows * grid.tile_height_px
    sheet: Bytes = np.zeros((size_px[1], size_px[0], 3), np.uint8)
    _draw_legend(sheet)
    for c in range(len(cameras)):
        _draw_tile(grid.place(sheet[_LEGEND_PX:], c), solution, c)
    return sheet


def _draw_tile(tile: Bytes, solution: Solution, c: int) -> None:
    """One camera on a black tile (H, W, 3), over its picture if there is one, darkened."""
    camera, (height_px, width_px, _) = solution.cameras[c], tile.shape
    zoom = min((width_px - _GAP_PX) / camera.width_px, (height_px - _HEADER_PX - _GAP_PX) / camera.height_px)
    shown_px = round(camera.width_px * zoom), round(camera.height_px * zoom)
    picture: Bytes = np.full((shown_px[1], shown_px[0], 3), _GROUND_BGR, np.uint8)
    if solution.pictures and (seen := solution.pictures[c]) is not None:
        small = cv2.resize(seen, shown_px, interpolation=cv2.INTER_AREA)
        picture[:] = _DARKENED * np.atleast_3d(small)
    for i in range(1, CELLS):
        x, y = i * shown_px[0] // CELLS, i * shown_px[1] // CELLS
        cv2.line(picture, (x, 0), (x, shown_px[1]), _LINE_BGR)
        cv2.line(picture, (0, y), (shown_px[0], y), _LINE_BGR)
    of_camera = solution.corners.camera == c
    off_px = np.linalg.norm(solution.residuals_px[of_camera], axis=1)
    order = np.argsort(off_px)  # the worst on top
    points = np.rint(solution.corners.points_px[of_camera][order] * zoom * 8).astype(int)
    for (x, y), colour in zip(points.tolist(), _colours(off_px[order]).tolist(), strict=True):
        cv2.circle(picture, (x, y), 2 * 8, colour, cv2.FILLED, cv2.LINE_AA, shift=3)
    tile[_HEADER_PX : _HEADER_PX + shown_px[1], : shown_px[0]] = picture
    words = (
        f"{camera.name}  {solution.error_px(c):.2f} px  {solution.n_views[c]} views  "
        f"{100 * covered_share(solution, c):.0f}% covered"
    )
    cv2.putText(tile, words, (6, _HEADER_PX - 9), _FONT, 0.5, _TEXT_BGR, 1, cv2.LINE_AA)


def _draw_legend(sheet: Bytes) -> None:
    words = "corners used, by their error:"
    cv2.putText(sheet, words, (6, 22), _FONT, 0.5, _TEXT_BGR, 1, cv2.LINE_AA)
    x = 6 + cv2.getTextSize(words, _FONT, 0.5, 1)[0][0] + 16
    for off_px in (0.0, _FULL_RED_PX / 2, _FULL_RED_PX):
        cv2.circle(sheet, (x, 17), 5, _colours(np.array([off_px]))[0].tolist(), cv2.FILLED, cv2.LINE_AA)
        more = " or more" if off_px == _FULL_RED_PX else ""
        cv2.putText(sheet, f"{off_px:g} px{more}", (x + 12, 22), _FONT, 0.5, _TEXT_BGR, 1, cv2.LINE_AA)
        x += 90


def _colours(off_px: Floats) -> Bytes:
    """(N, 3) BGR from blue over yellow to red."""
    ramp_bgr = np.array([(230, 160, 70), (60, 220, 240), (60, 60, 240)], np.float64)
    places = (0.0, _FULL_RED_PX / 2, _FULL_RED_PX)
    colours = np.stack([np.interp(off_px, places, of) for of in ramp_bgr.T], axis=1)
    return np.asarray(np.rint(colours), np.uint8)
