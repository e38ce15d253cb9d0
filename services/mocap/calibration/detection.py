"""Finds a board's corners in pictures."""

from collections.abc import Iterable

import cv2
import numpy as np

from services.mocap.calibration.board import Board
from services.mocap.calibration.board_print import charuco_of, dictionary_of
from services.mocap.calibration.chessboard import find_chessboard
from services.mocap.calibration.markers import marker_detector, sheet_corners
from services.mocap.calibration.sightings import Sighting, Sightings, is_usable
from services.mocap.types import Bytes, Floats, Ints

_NO_SIZE = (0, 0)


class Detector:
    """Finds one board's corners."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self._charuco = cv2.aruco.CharucoDetector(charuco_of(board)) if board.kind == "charuco" else None
        self._markers = marker_detector(dictionary_of(board)) if board.kind == "aruco" else None

    def find(self, picture: Bytes) -> Sighting | None:
        """The corners in a picture (H, W, 3) or (H, W); None if too little of the board is visible."""
        grey = upright_print(picture, self.board)
        if self.board.has_markers:
            flipped = np.ascontiguousarray(grey[:, ::-1])
            return self._found(grey, is_behind=False) or self._found(flipped, is_behind=True)
        corners = find_chessboard(grey, self.board.columns - 1, self.board.rows - 1)
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
            return sheet_corners(grey, self.board, self._markers)
        if self._charuco is not None:
            points, corners, _, _ = self._charuco.detectBoard(grey)
            if corners is not None and points is not None:
                return np.ravel(corners).astype(np.int32), np.asarray(points, np.float64).reshape(-1, 2)
        return np.zeros(0, np.int32), np.zeros((0, 2))


def grey_of(picture: Bytes) -> Bytes:
    """A picture (H, W, 3) or (H, W) in grey (H, W)."""
    return picture if picture.ndim == 2 else np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)


def upright_print(picture: Bytes, board: Board) -> Bytes:
    """A picture in grey (H, W), as its negative if the board is printed white on black."""
    grey = grey_of(picture)
    return 255 - grey if board.inverted else grey


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
