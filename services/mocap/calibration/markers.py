"""Finds ArUco markers in pictures, and the corners of a sheet of them."""

import cv2
import numpy as np

from services.mocap.calibration.board import Board
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


def marker_detector(dictionary: cv2.aruco.Dictionary) -> cv2.aruco.ArucoDetector:
    """A detector of single markers whose corners are refined."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.relativeCornerRefinmentWinSize = _WINDOW_MODULES
    parameters.perspectiveRemovePixelPerCell = _READ_PX
    return cv2.aruco.ArucoDetector(dictionary, parameters)


def markers_in(grey: Bytes, detector: cv2.aruco.ArucoDetector) -> tuple[Ints, Floats]:
    """Numbers (n,) and corners (n, 4, 2) of all markers in a picture (H, W), from their upper left
    clockwise."""
    corners, ids, _ = detector.detectMarkers(grey)
    if ids is None:
        return np.zeros(0, np.int32), np.zeros((0, 4, 2))
    return np.ravel(ids).astype(np.int32), np.asarray(corners, np.float64).reshape(-1, 4, 2)


def sheet_corners(grey: Bytes, board: Board, detector: cv2.aruco.ArucoDetector) -> tuple[Ints, Floats]:
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
