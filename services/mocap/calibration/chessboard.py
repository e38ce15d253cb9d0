"""Finds a classic chessboard's inner corners by either of OpenCV's detectors."""

import cv2
import numpy as np

from services.mocap.types import Bytes, Floats

_SECTOR_FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
_OLDER_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
_UNTIL = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
_WINDOW_SHARE, _WIDEST_PX = 0.25, 11
"""Reach of the window in which a corner is refined, as a share of the smallest square, and in pixels: it must
not touch the next corners."""
_NO_ZONE = (-1, -1)


def find_chessboard(grey: Bytes, columns: int, rows: int) -> Floats | None:
    """The inner corners (rows * columns, 2) in a picture (H, W), in the board's order, or None.

    Where OpenCV's newer detector, of sectors, finds nothing, the older one, of black squares, is asked.
    """
    found, points = cv2.findChessboardCornersSB(grey, (columns, rows), flags=_SECTOR_FLAGS)
    grid = (
        np.asarray(points, np.float64).reshape(rows, columns, 2)
        if found and points is not None and len(points) == columns * rows
        else _by_squares(grey, columns, rows)
    )
    return None if grid is None else _in_order(grey, grid).reshape(-1, 2)


def _by_squares(grey: Bytes, columns: int, rows: int) -> Floats | None:
    """(rows, columns, 2) by the older detector."""
    found, points = cv2.findChessboardCorners(grey, (columns, rows), flags=_OLDER_FLAGS)
    if not found or points is None or len(points) != columns * rows:
        return None
    grid = np.asarray(points, np.float64).reshape(rows, columns, 2)
    sides_px = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1)]
    reach_px = int(np.clip(_WINDOW_SHARE * min(sides_px), 1, _WIDEST_PX))
    start = np.asarray(points, np.float32)
    exact = cv2.cornerSubPix(grey, start, (reach_px, reach_px), _NO_ZONE, _UNTIL)
    return np.asarray(exact, np.float64).reshape(rows, columns, 2)


def _in_order(grey: Bytes, grid: Floats) -> Floats:
    """A chessboard's corners (rows, columns, 2) in the order of the board, in whichever order they were
    detected.

    Colour determines the orientation: the square at the upper left is black.
    """
    along, down = grid[:, -1] - grid[:, 0], grid[-1] - grid[0]
    (ax, ay), (dx, dy) = along.mean(axis=0), down.mean(axis=0)
    if ax * dy - ay * dx < 0:
        grid = grid[:, ::-1]
    middles = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    x, y = np.moveaxis(np.rint(middles).astype(int), -1, 0)
    level = grey[y.clip(0, grey.shape[0] - 1), x.clip(0, grey.shape[1] - 1)].astype(np.float64)
    row, column = np.indices(level.shape)
    like_first = (row + column) % 2 == 0
    turned: Floats = grid[::-1, ::-1] if level[like_first].mean() > level[~like_first].mean() else grid
    return turned
