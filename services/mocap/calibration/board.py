"""The calibration board: its print, and the positions of its corners.

Board frame, in metres: the origin in the middle of the board, x to the right and y up as the print is read, z
out of the print towards the reader. The square at the upper left is black. Corners are those at which four
squares meet, numbered row by row from the upper left.
"""

from typing import Literal, Self

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from services.mocap.errors import nearest
from services.mocap.types import Bytes, Floats

DICTIONARIES: dict[str, int] = {
    name.removeprefix("DICT_").lower(): getattr(cv2.aruco, name)
    for name in dir(cv2.aruco)
    if name.startswith("DICT_") and name == name.upper()
}
FEWEST_SQUARES = 4
"""Least number of squares in each direction of a chessboard, whose detector needs three inner corners."""
_MARGIN_SQUARES = 0.5
"""White margin around a drawn board, which detection needs."""


class Board(BaseModel):
    """A flat board; a description states a field's valid values."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    kind: Literal["charuco", "chessboard"] = Field(
        default="charuco",
        description='"charuco" (a chessboard with markers in its white squares) or "chessboard"',
    )
    columns: int = Field(ge=3, le=50, description="the number of squares in a row, 3 to 50")
    rows: int = Field(ge=3, le=50, description="the number of rows of squares, 3 to 50")
    square_m: float = Field(gt=0.002, lt=2.0, description="the side of a square in metres, 0.002 to 2")
    marker_m: float | None = Field(
        default=None, gt=0.001, lt=2.0, description="the side of a marker's black frame in metres"
    )
    dictionary: str = Field(default="5x5_100", description="the markers' dictionary, such as 5x5_100")
    inverted: bool | None = Field(
        default=None,
        description="true for white markers on black, false for black on white; tried if it is not given",
    )
    legacy: bool = Field(
        default=False, description="true for boards drawn by OpenCV before 4.6 with an even number of rows"
    )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.kind == "chessboard":
            if min(self.columns, self.rows) < FEWEST_SQUARES:
                raise ValueError(
                    f"columns: expected {FEWEST_SQUARES} or more squares each way of a chessboard"
                )
            if (self.columns + self.rows) % 2 == 0:
                raise ValueError(
                    f"columns: {self.columns} x {self.rows} squares look the same when the board is rotated "
                    "by half a turn, so its ends cannot be told apart: expected one even and one odd "
                    "number of squares (not of inner corners)"
                )
            return self
        if self.dictionary not in DICTIONARIES:
            raise ValueError(
                f"dictionary: unknown {self.dictionary}: {nearest(self.dictionary, DICTIONARIES)}"
            )
        if not 0.3 * self.square_m <= self.marker_side_m < self.square_m:
            raise ValueError(
                f"marker_m: expected 0.3 to 1 times the square's {self.square_m:g}, found "
                f"{self.marker_side_m:g}"
            )
        held = len(cv2.aruco.getPredefinedDictionary(DICTIONARIES[self.dictionary]).bytesList)
        if held < self.n_markers:
            raise ValueError(
                f"dictionary: {self.dictionary} holds {held} markers, but a board of "
                f"{self.columns}x{self.rows} squares has {self.n_markers}: give the dictionary that the "
                "board was made with"
            )
        return self

    @property
    def marker_side_m(self) -> float:
        """The side of a marker; by default three quarters of a square's."""
        return 0.75 * self.square_m if self.marker_m is None else self.marker_m

    @property
    def n_markers(self) -> int:
        """How many markers a ChArUco board holds: one in every white square."""
        squares = self.columns * self.rows
        return squares - squares // 2 if self.legacy and self.rows % 2 == 0 else squares // 2

    @property
    def n_corners(self) -> int:
        """The number of inner corners."""
        return (self.columns - 1) * (self.rows - 1)

    @property
    def corners_m(self) -> Floats:
        """(n_corners, 3) in the board frame, z = 0."""
        row, column = np.divmod(np.arange(self.n_corners), self.columns - 1)
        x_m = (column + 1 - self.columns / 2) * self.square_m
        y_m = (self.rows / 2 - row - 1) * self.square_m
        return np.stack([x_m, y_m, np.zeros(self.n_corners)], axis=1)

    @property
    def outline_m(self) -> Floats:
        """(4, 3) the outer corners of the squares in the board frame, from the upper left clockwise."""
        x_m, y_m = self.columns / 2 * self.square_m, self.rows / 2 * self.square_m
        return np.array([[-x_m, y_m, 0.0], [x_m, y_m, 0.0], [x_m, -y_m, 0.0], [-x_m, -y_m, 0.0]])

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's board of the same print."""
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[self.dictionary])
        size = (self.columns, self.rows)
        board = cv2.aruco.CharucoBoard(size, self.square_m, self.marker_side_m, dictionary)
        board.setLegacyPattern(self.legacy)
        return board

    def draw(self, square_px: int) -> Bytes:
        """The print (H, W) in grey, to be put on a plate, with half a square of white around it."""
        margin_px = round(_MARGIN_SQUARES * square_px)
        if self.kind == "charuco":
            size_px = (self.columns * square_px + 2 * margin_px, self.rows * square_px + 2 * margin_px)
            print_ = np.asarray(self.charuco().generateImage(size_px, marginSize=margin_px), np.uint8)
            return 255 - print_ if self.inverted else print_
        row, column = np.indices((self.rows, self.columns))
        squares = np.where((row + column) % 2, 255, 0).astype(np.uint8)
        print_ = np.kron(squares, np.ones((square_px, square_px), np.uint8))
        return np.pad(print_, margin_px, constant_values=255)

    def in_words(self) -> str:
        """A description of the board, for sentences."""
        size = f"{self.columns}x{self.rows} squares"
        return (
            f"a chessboard of {size}"
            if self.kind == "chessboard"
            else f"a ChArUco board of {size}, {self.dictionary}"
        )
