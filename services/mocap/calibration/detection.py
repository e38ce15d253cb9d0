"""Finding the board in pictures."""

from collections.abc import Iterable

import cv2
import numpy as np

from services.mocap.calibration.board import Board
from services.mocap.calibration.sightings import Sighting, Sightings, is_usable
from services.mocap.types import Bytes, Floats

_CHESS_FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
_NO_SIZE = (0, 0)


class Detector:
    """Finds one board's corners."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self._charuco = cv2.aruco.CharucoDetector(board.charuco()) if board.kind == "charuco" else None

    def find(self, picture: Bytes) -> Sighting | None:
        """The corners in a picture (H, W, 3) or (H, W); None where too little of the board is to be seen."""
        grey = grey_of(picture)
        found = self._with_markers(grey) if self._charuco is not None else self._chessboard(grey)
        return found if found is not None and is_usable(found, self.board) else None

    def _with_markers(self, grey: Bytes) -> Sighting | None:
        assert self._charuco is not None  # noqa: S101 (for the type checker)
        points, corners, _, _ = self._charuco.detectBoard(grey)
        if corners is None or points is None:
            return None
        return Sighting(np.ravel(corners).astype(np.int32), np.asarray(points, np.float64).reshape(-1, 2))

    def _chessboard(self, grey: Bytes) -> Sighting | None:
        columns, rows = self.board.columns - 1, self.board.rows - 1
        found, points = cv2.findChessboardCornersSB(grey, (columns, rows), flags=_CHESS_FLAGS)
        if not found or points is None or len(points) != columns * rows:
            return None
        grid = np.asarray(points, np.float64).reshape(rows, columns, 2)
        grid = in_order(grey, grid)
        return Sighting(np.arange(columns * rows, dtype=np.int32), grid.reshape(-1, 2))


def in_order(grey: Bytes, grid: Floats) -> Floats:
    """A chessboard's corners (rows, columns, 2) in the order of the board, whichever way they were found.

    Which end of the board is which is told by colour: the square at the upper left is black.
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


def grey_of(picture: Bytes) -> Bytes:
    """A picture (H, W, 3) or (H, W) in grey (H, W)."""
    return picture if picture.ndim == 2 else np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)


def look_through(camera: str, pictures: Iterable[tuple[int, Bytes]], detector: Detector) -> Sightings:
    """All sightings in a camera's numbered pictures."""
    by_frame: dict[int, Sighting] = {}
    size_px, n_looked_at = _NO_SIZE, 0
    for frame, picture in pictures:
        size_px, n_looked_at = (picture.shape[1], picture.shape[0]), n_looked_at + 1
        found = detector.find(picture)
        if found is not None:
            by_frame[frame] = found
    return Sightings(camera, size_px, by_frame, n_looked_at)
