"""Finds a classic chessboard's inner corners by either of OpenCV's detectors."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from services.mocap.types import Bytes, Floats, Ints, Mask

_SECTOR_FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
_OLDER_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
_UNTIL = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
_WINDOW_SHARE, _WIDEST_PX = 0.25, 11
"""Reach of the window in which a corner is refined, as a share of the smallest square, and in pixels: it must
not touch the next corners."""
_NO_ZONE = (-1, -1)
_OFF_SIDES, _FEWEST_PX = 0.2, 1.0
"""How far a corner of the older detector may be off its place, in sides of a square, or else in pixels."""


def find_chessboard(grey: Bytes, columns: int, rows: int) -> tuple[Ints, Floats] | None:
    """Numbers (n,), increasing, and places (n, 2) of the inner corners in a picture (H, W), in the board's
    order.

    Where OpenCV's newer detector, of sectors, finds nothing, the older one, of black squares, is asked: it
    finds boards in glare (of 13 rendered ones 9, the newer 1), and those of its corners are left out that it
    could not place. None if neither finds a board.
    """
    found, points = cv2.findChessboardCornersSB(grey, (columns, rows), flags=_SECTOR_FLAGS)
    if found and points is not None and len(points) == columns * rows:
        grid = _in_order(grey, np.asarray(points, np.float64).reshape(rows, columns, 2))
        return np.arange(columns * rows, dtype=np.int32), grid.reshape(-1, 2)
    older = _by_squares(grey, columns, rows)
    if older is None:
        return None
    grid = _in_order(grey, older)
    placed = np.flatnonzero(_on_grid(grid)).astype(np.int32)
    return placed, grid.reshape(-1, 2)[placed]


def _by_squares(grey: Bytes, columns: int, rows: int) -> Floats | None:
    """(rows, columns, 2) by the older detector."""
    found, points = cv2.findChessboardCorners(grey, (columns, rows), flags=_OLDER_FLAGS)
    if not found or points is None or len(points) != columns * rows:
        return None
    start = np.asarray(points, np.float32)
    side_px = _least_side_px(start.reshape(rows, columns, 2))
    reach_px = int(np.clip(_WINDOW_SHARE * side_px, 1, _WIDEST_PX))
    exact = cv2.cornerSubPix(grey, start, (reach_px, reach_px), _NO_ZONE, _UNTIL)
    return np.asarray(exact, np.float64).reshape(rows, columns, 2)


def _least_side_px(grid: NDArray[np.floating[Any]]) -> float:
    """The least distance of neighbours in a grid (rows, columns, 2)."""
    return float(min(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1)))


def _on_grid(grid: Floats) -> Mask:
    """(rows * columns,) corners of a grid (rows, columns, 2) that lie where the others' plane has them."""
    places = np.indices(grid.shape[:2], np.float64)[::-1].reshape(2, -1).T
    limit_px = max(_FEWEST_PX, _OFF_SIDES * _least_side_px(grid))
    _, fits = cv2.findHomography(places, grid.reshape(-1, 2), cv2.RANSAC, limit_px)
    return np.zeros(len(places), bool) if fits is None else np.asarray(fits, bool).ravel()


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
