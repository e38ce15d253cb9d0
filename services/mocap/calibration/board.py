"""The calibration board: what is printed on it, the positions of its corners, and its picture.

Board frame, in metres: the origin in the middle of the board, x to the right and y up as the print is read, z
out of the print towards the reader. Of chessboards and ChArUco boards the square at the upper left is black,
and corners are those at which four squares meet, numbered row by row from the upper left. Of a sheet of ArUco
markers they are the markers' corners, marker by marker in the same order, each from its upper left clockwise.
"""

from typing import Literal, Self, TypeAlias

import cv2
import numpy as np
from pydantic import Field, model_validator

from services.mocap.errors import StrictModel, nearest
from services.mocap.types import Bytes, Floats, Ints

BoardKind: TypeAlias = Literal["charuco", "aruco", "chessboard"]
DICTIONARIES: dict[str, int] = {
    name.removeprefix("DICT_").lower(): getattr(cv2.aruco, name)
    for name in dir(cv2.aruco)
    if name.startswith("DICT_") and name == name.upper()
}
FEWEST_SQUARES = 4
"""Least number of squares in each direction of a chessboard, whose detector needs three inner corners."""
_FEWEST_CHARUCO = 3
_FEWEST_MARKERS = 2
"""Least number of markers of a sheet: one alone has too few corners for a reliable pose."""
_MARGIN_PITCHES = 0.5
"""White margin around a drawn board, which detection needs."""


def dictionary_of(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of markers."""
    return cv2.aruco.getPredefinedDictionary(DICTIONARIES[name])


class Board(StrictModel):
    """A flat board; a description states a field's valid values."""

    kind: BoardKind = Field(
        default="charuco",
        description='"charuco" (a chessboard with markers in its white squares), "aruco" (a sheet of markers '
        'with gaps between them) or "chessboard"',
    )
    columns: int = Field(ge=1, le=50, description="the number of squares (aruco: markers) in a row, up to 50")
    rows: int = Field(ge=1, le=50, description="the number of rows of squares (aruco: of markers), up to 50")
    square_m: float | None = Field(
        default=None, gt=0.002, lt=2.0, description="the side of a square in metres, 0.002 to 2"
    )
    marker_m: float | None = Field(
        default=None, gt=0.001, lt=2.0, description="the side of a marker's black frame in metres"
    )
    gap_m: float | None = Field(
        default=None, gt=0.0002, lt=2.0, description="the gap between an ArUco sheet's markers in metres"
    )
    dictionary: str = Field(default="5x5_100", description="the markers' dictionary, such as 5x5_100")
    first_id: int = Field(default=0, ge=0, description="the number of an ArUco sheet's first marker")
    inverted: bool | None = Field(
        default=None,
        description="true for white markers on black, false for black on white; tried if it is not given",
    )
    legacy: bool = Field(
        default=False, description="true for boards drawn by OpenCV before 4.6 with an even number of rows"
    )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        self._check_lengths()
        if self.kind == "chessboard":
            self._check_chessboard()
            return self
        if self.dictionary not in DICTIONARIES:
            raise ValueError(
                f"dictionary: unknown {self.dictionary}: {nearest(self.dictionary, DICTIONARIES)}"
            )
        if self.kind == "charuco" and min(self.columns, self.rows) < _FEWEST_CHARUCO:
            raise ValueError(f"columns: expected {_FEWEST_CHARUCO} or more squares each way")
        if self.kind == "aruco" and self.n_markers < _FEWEST_MARKERS:
            raise ValueError(f"columns: expected {_FEWEST_MARKERS} or more markers on a sheet")
        held = len(dictionary_of(self.dictionary).bytesList)
        if held < self.first_id + self.n_markers:
            raise ValueError(
                f"dictionary: {self.dictionary} holds {held} markers, but {self.in_words(short=True)} needs "
                f"{self.first_id + self.n_markers}: give the dictionary that the board was made with"
            )
        return self

    def _check_lengths(self) -> None:
        is_aruco = self.kind == "aruco"
        needed = ("marker_m", "gap_m") if is_aruco else ("square_m",)
        for name in needed:
            if getattr(self, name) is None:
                raise ValueError(f"{name}: is missing: expected {type(self).model_fields[name].description}")
        for name in ("square_m",) if is_aruco else ("gap_m",):
            if getattr(self, name) is not None:
                raise ValueError(f"{name}: {self.kind} boards have none: expected {', '.join(needed)}")
        if not is_aruco and self.first_id:
            raise ValueError("first_id: expected 0: only sheets of ArUco markers may begin with another")
        if self.kind == "charuco" and not 0.3 * self.pitch_m <= self.marker_side_m < self.pitch_m:
            raise ValueError(
                f"marker_m: expected 0.3 to 1 times the square's {self.pitch_m:g}, found "
                f"{self.marker_side_m:g}"
            )

    def _check_chessboard(self) -> None:
        if min(self.columns, self.rows) < FEWEST_SQUARES:
            raise ValueError(f"columns: expected {FEWEST_SQUARES} or more squares each way of a chessboard")
        if (self.columns + self.rows) % 2 == 0:
            raise ValueError(
                f"columns: {self.columns} x {self.rows} squares look the same when the board is rotated "
                "by half a turn, so its ends cannot be told apart: expected one even and one odd "
                "number of squares (not of inner corners)"
            )

    @property
    def has_markers(self) -> bool:
        """Whether its corners are told apart by markers, so that part of the board is enough."""
        return self.kind != "chessboard"

    @property
    def pitch_m(self) -> float:
        """From one square to the next; of an ArUco sheet, from one marker to the next."""
        if self.square_m is not None:
            return self.square_m
        return (self.marker_m or 0.0) + (self.gap_m or 0.0)

    @property
    def marker_side_m(self) -> float:
        """The side of a marker; by default three quarters of a square's."""
        return 0.75 * self.pitch_m if self.marker_m is None else self.marker_m

    @property
    def n_markers(self) -> int:
        """How many markers a board holds: ChArUco boards have one in every white square."""
        squares = self.columns * self.rows
        if self.kind == "aruco":
            return squares
        return squares - squares // 2 if self.legacy and self.rows % 2 == 0 else squares // 2

    @property
    def marker_cells(self) -> Ints:
        """(n_markers, 2) column and row of each marker, in the order of their numbers."""
        row, column = np.indices((self.rows, self.columns))
        white = (row + column) % 2 == (not (self.legacy and self.rows % 2 == 0))
        held = np.ones_like(white) if self.kind == "aruco" else white
        return np.stack([column[held], row[held]], axis=1).astype(np.int32)

    @property
    def n_corners(self) -> int:
        """The number of corners: of a sheet's markers, or inner ones."""
        return 4 * self.n_markers if self.kind == "aruco" else (self.columns - 1) * (self.rows - 1)

    @property
    def corners_m(self) -> Floats:
        """(n_corners, 3) in the board frame, z = 0."""
        if self.kind == "aruco":
            half = 0.5 * self.marker_side_m / self.pitch_m
            around = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
            cells = (self.marker_cells[:, None] + 0.5 + around).reshape(-1, 2)
        else:
            row, column = np.divmod(np.arange(self.n_corners), self.columns - 1)
            cells = np.stack([column, row], axis=1) + 1.0
        x_m, y_m = ((cells - (self.columns / 2, self.rows / 2)) * self.pitch_m * (1, -1)).T
        return np.stack([x_m, y_m, np.zeros(self.n_corners)], axis=1)

    @property
    def outline_m(self) -> Floats:
        """(4, 3) the outer corners of its squares or markers, in the same order as a marker's."""
        gap_m = self.gap_m or 0.0
        x_m, y_m = ((n * self.pitch_m - gap_m) / 2 for n in (self.columns, self.rows))
        return np.array([[-x_m, y_m, 0.0], [x_m, y_m, 0.0], [x_m, -y_m, 0.0], [-x_m, -y_m, 0.0]])

    def in_words(self, *, short: bool = False) -> str:
        """A description of the board, for sentences; short: without the dictionary."""
        size = f"{self.columns}x{self.rows}"
        if self.kind == "chessboard":
            return f"a chessboard of {size} squares"
        what = f"a sheet of {size} markers" if self.kind == "aruco" else f"a ChArUco board of {size} squares"
        if short:
            return what
        first = f" from {self.first_id} on" if self.first_id else ""
        return f"{what}, {self.dictionary}{first}"


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
