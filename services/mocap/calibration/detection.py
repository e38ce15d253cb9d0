"""Finds a board's corners in pictures, and single ArUco markers."""

from collections.abc import Iterable

import cv2
import numpy as np

from services.mocap.calibration.board import Board, dictionary_of
from services.mocap.calibration.board_print import charuco_of
from services.mocap.calibration.chessboard import find_chessboard
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
    size_px, n_looked_at = (0, 0), 0
    for frame, picture in pictures:
        size_px, n_looked_at = (picture.shape[1], picture.shape[0]), n_looked_at + 1
        found = detector.find(picture)
        if found is not None:
            by_frame[frame] = found
    return Sightings(camera, size_px, by_frame, n_looked_at)


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
    kept = _in_one_plane(board.corners_m[corners, :2], quads_px)
    return corners[kept].ravel(), quads_px[kept].reshape(-1, 2)


def _in_one_plane(places_m: Floats, quads_px: Floats) -> Mask:
    """(n,) markers (n, 4, 2) that lie where the sheet has them: others are misread."""
    kept: Mask = np.ones(len(quads_px), bool)
    if len(quads_px) >= _FEWEST_COMPARED:
        side_px = float(np.median(np.linalg.norm(quads_px[:, 1] - quads_px[:, 0], axis=1)))
        limit_px = max(_FEWEST_PX, _OFF_SIDES * side_px)
        planes = places_m.reshape(-1, 2), quads_px.reshape(-1, 2)
        _, fits = cv2.findHomography(*planes, cv2.RANSAC, limit_px)
        kept &= False if fits is None else np.asarray(fits, bool).reshape(-1, 4).all(axis=1)
    return kept
