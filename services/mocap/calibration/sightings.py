"""What one camera saw of the board: finding its corners in pictures, by frame."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from services.mocap.calibration.board import Board
from services.mocap.types import Bytes, Floats, Ints

ENOUGH_CORNERS = 6
"""Fewer corners do not determine the board's pose."""
_FLATTEST = 0.02
"""Least ratio of width to length of the detected corners: a single row of corners gives no pose."""
_BENT_SHARE, _BENT_PX = 0.03, 3.0
"""How far corners may be off a plane's picture, as a share of the board's size in it: a lens bends by that
much, while corners that were taken for others are off by whole squares."""

_CHESS_FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
_NO_SIZE = (0, 0)


@dataclass(frozen=True, eq=False)
class Sighting:
    """The board's corners in one picture."""

    corners: Ints
    """(n,) their numbers on the board, increasing."""
    points_px: Floats
    """(n, 2) where they are in the raw picture, pixel centres at whole coordinates."""
    is_behind: bool = False
    """Seen on the back of a board that is printed on both sides, whose print is the front's mirror image."""


@dataclass(frozen=True, eq=False)
class Sightings:
    """The board in one camera's pictures."""

    camera: str
    size_px: tuple[int, int]
    """Width and height of the pictures."""
    by_frame: Mapping[int, Sighting]
    """Pictures of one number show one moment in all cameras; negative numbers are this camera's alone."""
    n_looked_at: int
    """The number of pictures in which the board was searched."""

    @property
    def is_behind(self) -> bool:
        """Whether it mostly sees a board's back, or its pictures are mirrored."""
        return 2 * sum(view.is_behind for view in self.by_frame.values()) > len(self.by_frame)


def is_usable(sighting: Sighting, board: Board) -> bool:
    """Whether a sighting can be the flat board: enough corners, not in one row, and in the board's order."""
    if len(sighting.corners) < ENOUGH_CORNERS:
        return False
    corners_m = board.corners_m[sighting.corners, :2]
    for points in (corners_m, sighting.points_px):
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[1] < _FLATTEST * spread[0]:
            return False
    H, _ = cv2.findHomography(corners_m, sighting.points_px, 0)
    if H is None:
        return False
    mapped = cv2.perspectiveTransform(corners_m[None], H)[0]
    off_px = np.linalg.norm(mapped - sighting.points_px, axis=1)
    size_px = float(np.ptp(sighting.points_px, axis=0).max())
    # the print can be read, and not its mirror image: y runs up on the board and down in the picture
    readable = np.linalg.det(H[:2, :2] - np.outer(mapped.mean(axis=0), H[2, :2])) < 0
    return bool(
        readable != sighting.is_behind and np.sqrt((off_px**2).mean()) < max(_BENT_PX, _BENT_SHARE * size_px)
    )


def spread_out(sightings: Mapping[int, Sighting], frames: list[int], most: int) -> list[int]:
    """Up to `most` frames whose views differ most: in place, size and slant of the board in the picture."""
    if len(frames) <= most:
        return frames
    looks = np.array([_look(sightings[frame]) for frame in frames])
    looks = (looks - looks.mean(axis=0)) / np.maximum(looks.std(axis=0), 1e-9)
    chosen = [int(np.linalg.norm(looks, axis=1).argmax())]
    nearest = np.linalg.norm(looks - looks[chosen[0]], axis=1)
    while len(chosen) < most:
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(looks - looks[chosen[-1]], axis=1))
    return sorted(frames[i] for i in chosen)


def _look(sighting: Sighting) -> Floats:
    """(5,) middle, size and shape of what is seen of the board."""
    points = sighting.points_px
    (xx, xy), (_, yy) = np.cov(points.T)
    size = np.sqrt(np.sqrt(max(xx * yy - xy**2, 1e-9)))
    return np.array([*points.mean(axis=0), 3 * size, 100 * np.log(xx / yy), 100 * xy / np.sqrt(xx * yy)])


class Detector:
    """Finds one board's corners."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self._charuco = cv2.aruco.CharucoDetector(board.charuco()) if board.kind == "charuco" else None

    def find(self, picture: Bytes) -> Sighting | None:
        """The corners in a picture (H, W, 3) or (H, W); None if too little of the board is visible."""
        grey = upright_print(picture, self.board)
        if self._charuco is None:
            found = self._chessboard(grey)
            return found if found is not None and is_usable(found, self.board) else None
        return self._found(self._charuco, grey, is_behind=False) or self._found(
            self._charuco, np.ascontiguousarray(grey[:, ::-1]), is_behind=True
        )

    def _found(self, charuco: cv2.aruco.CharucoDetector, grey: Bytes, *, is_behind: bool) -> Sighting | None:
        """A ChArUco board in a picture (H, W); is_behind: if the picture was flipped left to right."""
        points, corners, _, _ = charuco.detectBoard(grey)
        if corners is None or points is None:
            return None
        points_px = np.asarray(points, np.float64).reshape(-1, 2)
        if is_behind:
            points_px = points_px * (-1, 1) + (grey.shape[1] - 1, 0)
        found = Sighting(np.ravel(corners).astype(np.int32), points_px, is_behind)
        return found if is_usable(found, self.board) else None

    def _chessboard(self, grey: Bytes) -> Sighting | None:
        columns, rows = self.board.columns - 1, self.board.rows - 1
        found, points = cv2.findChessboardCornersSB(grey, (columns, rows), flags=_CHESS_FLAGS)
        if not found or points is None or len(points) != columns * rows:
            return None
        grid = _in_order(grey, np.asarray(points, np.float64).reshape(rows, columns, 2))
        return Sighting(np.arange(columns * rows, dtype=np.int32), grid.reshape(-1, 2))


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
