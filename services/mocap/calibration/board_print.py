"""The print of a board: OpenCV's description of it, and the picture."""

import cv2
import numpy as np

from services.mocap.calibration.board import Board, dictionary_of
from services.mocap.types import Bytes

_MARGIN_PITCHES = 0.5
"""White margin around a drawn board, which detection needs."""


def charuco_of(board: Board) -> cv2.aruco.CharucoBoard:
    """The ChArUco board of the same print."""
    size = (board.columns, board.rows)
    dictionary = dictionary_of(board.dictionary)
    charuco = cv2.aruco.CharucoBoard(size, board.pitch_m, board.marker_side_m, dictionary)
    charuco.setLegacyPattern(board.legacy)
    return charuco


def drawn(board: Board, pitch_px: int) -> Bytes:
    """The print (H, W) in grey, to be put on a plate, with a margin of half a pitch around it.

    pitch_px: from one square to the next; of an ArUco sheet, from one marker to the next.
    """
    margin_px = round(_MARGIN_PITCHES * pitch_px)
    if board.kind == "chessboard":
        row, column = np.indices((board.rows, board.columns))
        squares = np.where((row + column) % 2, 255, 0).astype(np.uint8)
        print_ = np.kron(squares, np.ones((pitch_px, pitch_px), np.uint8))
        return np.pad(print_, margin_px, constant_values=255)
    gap_px = round(board.gap_m / board.pitch_m * pitch_px) if board.gap_m else 0
    width_px, height_px = (n * pitch_px - gap_px + 2 * margin_px for n in (board.columns, board.rows))
    print_of = _sheet_of(board) if board.kind == "aruco" else charuco_of(board)
    print_ = np.asarray(print_of.generateImage((width_px, height_px), marginSize=margin_px), np.uint8)
    return 255 - print_ if board.inverted else print_


def _sheet_of(board: Board) -> cv2.aruco.GridBoard:
    ids = np.arange(board.first_id, board.first_id + board.n_markers)
    size, dictionary = (board.columns, board.rows), dictionary_of(board.dictionary)
    return cv2.aruco.GridBoard(size, board.marker_side_m, board.gap_m or 0.0, dictionary, ids)
