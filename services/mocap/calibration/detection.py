"""Finds a board's corners in pictures, and single ArUco markers."""

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from services.mocap.calibration.board import Board, charuco_of, dictionary_of
from services.mocap.calibration.sightings import Sighting, Sightings, is_usable
from services.mocap.types import Bytes, Floats, Ints, Mask

_WINDOW_MODULES = 0.4
"""Reach of the window in which a corner is refined, in modules of a marker: OpenCV's 0.3 leaves corners of
small markers where they were, more reaches the bits. Rendered boards: median error 0.14 px (0.3: 0.17)."""
_READ_PX = 8
"""Pixels of a module in which its bit is read: with OpenCV's 4, some slanted markers cannot be read."""
_OFF_SIDES = 0.5
"""How far a sheet's marker may be off a plane's picture, in sides of a marker: lenses bend by less."""
_FEWEST_PX = 3.0
_FEWEST_COMPARED = 3
"""Of fewer markers nothing says which is misread."""
_SECTOR_FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
_OLDER_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
_UNTIL = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
_WINDOW_SHARE, _WIDEST_PX = 0.25, 11
"""Reach of the window in which a corner is refined, as a share of the smallest square, and in pixels: it must
not touch the next corners."""
_NO_ZONE = (-1, -1)
_OFF_SQUARES, _FEWEST_CORNER_PX = 0.2, 1.0
"""How far a corner of the older detector may be off its place, in sides of a square, or else in pixels."""


class Detector:
    """Finds one board's corners."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self._charuco = cv2.aruco.CharucoDetector(charuco_of(board)) if board.kind == "charuco" else None
        self._markers = marker_detector(board.dictionary) if board.kind == "aruco" else None

    def find(self, picture: Bytes) -> Sighting | None:
        """The corners in a picture (H, W, 3) or (H, W); None if too little of the board is visible."""
        grey = upright_print(picture, self.board)
        if self.board.has_markers:
            flipped = np.ascontiguousarray(grey[:, ::-1])
            return self._found(grey, is_behind=False) or self._found(flipped, is_behind=True)
        corners = _chessboard_corners(grey, self.board.columns - 1, self.board.rows - 1)
        found = Sighting(*corners) if corners is not None else None
        return found if found is not None and is_usable(found, self.board) else None

    def _found(self, grey: Bytes, *, is_behind: bool) -> Sighting | None:
        """A board with markers in a picture (H, W); is_behind: if the picture was flipped left to right."""
        corners, points_px = self._corners(grey)
        if is_behind:
            points_px = points_px * (-1, 1) + (grey.shape[1] - 1, 0)
        found = Sighting(corners, points_px, is_behind)
        return found if is_usable(found, self.board) else None

    def _corners(self, grey: Bytes) -> tuple[Ints, Floats]:
        """Numbers (n,) and places (n, 2) of the corners of a board with markers."""
        if self._markers is not None:
            return _sheet_corners(grey, self.board, self._markers)
        if self._charuco is not None:
            points, corners, _, _ = self._charuco.detectBoard(grey)
            if corners is not None and points is not None:
                return np.ravel(corners).astype(np.int32), np.asarray(points, np.float64).reshape(-1, 2)
        return np.zeros(0, np.int32), np.zeros((0, 2))


def upright_print(picture: Bytes, board: Board) -> Bytes:
    """A picture (H, W, 3) or (H, W) in grey, as its negative if the board is printed white on black."""
    grey = picture if picture.ndim == 2 else np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)
    return 255 - grey if board.inverted else grey


def look_through(camera: str, pictures: Iterable[tuple[int, Bytes]], detector: Detector) -> Sightings:
    """All sightings in a camera's numbered pictures."""
    by_frame: dict[int, Sighting] = {}
    size_px, n_looked_at, best, most = (0, 0), 0, None, 0
    for frame, picture in pictures:
        size_px, n_looked_at = (picture.shape[1], picture.shape[0]), n_looked_at + 1
        found = detector.find(picture)
        if found is not None:
            by_frame[frame] = found
            if len(found.corners) > most:
                best, most = picture, len(found.corners)
    return Sightings(camera, size_px, by_frame, n_looked_at, best)


def marker_detector(dictionary: str) -> cv2.aruco.ArucoDetector:
    """A detector of the single markers of a dictionary; it refines their corners."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.relativeCornerRefinmentWinSize = _WINDOW_MODULES
    parameters.perspectiveRemovePixelPerCell = _READ_PX
    return cv2.aruco.ArucoDetector(dictionary_of(dictionary), parameters)


def markers_in(grey: Bytes, detector: cv2.aruco.ArucoDetector) -> tuple[Ints, Floats]:
    """Numbers (n,) and corners (n, 4, 2) of all markers in a picture (H, W), from their upper left
    clockwise."""
    corners, ids, _ = detector.detectMarkers(grey)
    if ids is None:
        return np.zeros(0, np.int32), np.zeros((0, 4, 2))
    return np.ravel(ids).astype(np.int32), np.asarray(corners, np.float64).reshape(-1, 4, 2)


def _sheet_corners(grey: Bytes, board: Board, detector: cv2.aruco.ArucoDetector) -> tuple[Ints, Floats]:
    """Numbers (n,), increasing, and places (n, 2) of the corners of a sheet's markers in a picture (H, W)."""
    ids, quads_px = markers_in(grey, detector)
    numbers, first, counts = np.unique(ids - board.first_id, return_index=True, return_counts=True)
    # of a number that is there twice, something else in the room has one: nothing says which is the sheet's
    held = (counts == 1) & (numbers >= 0) & (numbers < board.n_markers)
    corners = (4 * numbers[held, None] + np.arange(4)).astype(np.int32)
    quads_px = quads_px[first[held]]
    kept = _rightly_read(board.corners_m[corners, :2], quads_px)
    return corners[kept].ravel(), quads_px[kept].reshape(-1, 2)


def _rightly_read(places_m: Floats, quads_px: Floats) -> Mask:
    """(n,) markers (n, 4, 2) that lie where the sheet has them: others are misread."""
    if len(quads_px) < _FEWEST_COMPARED:
        return np.ones(len(quads_px), bool)
    side_px = float(np.median(np.linalg.norm(quads_px[:, 1] - quads_px[:, 0], axis=1)))
    limit_px = max(_FEWEST_PX, _OFF_SIDES * side_px)
    fits = _in_one_plane(places_m.reshape(-1, 2), quads_px.reshape(-1, 2), limit_px)
    return np.asarray(fits.reshape(-1, 4).all(axis=1))


def _in_one_plane(places: Floats, points_px: Floats, limit_px: float) -> Mask:
    """(N,) points (N, 2) that are where a plane's picture has their places (N, 2); none if there is no such
    picture."""
    _, fits = cv2.findHomography(places, points_px, cv2.RANSAC, limit_px)
    return np.zeros(len(places), bool) if fits is None else np.asarray(fits, bool).ravel()


def _chessboard_corners(grey: Bytes, columns: int, rows: int) -> tuple[Ints, Floats] | None:
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
    limit_px = max(_FEWEST_CORNER_PX, _OFF_SQUARES * _least_side_px(grid))
    return _in_one_plane(places, grid.reshape(-1, 2), limit_px)


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
    return grid[::-1, ::-1] if level[like_first].mean() > level[~like_first].mean() else grid
