"""Finds out why a camera does not see the board: another board, mirrored pictures, another camera's
pictures."""

from collections.abc import Iterable
from itertools import combinations

import cv2
import numpy as np

from services.mocap.calibration.board import FEWEST_SQUARES, Board
from services.mocap.calibration.clips import Clip
from services.mocap.calibration.detection import Detector, upright_print
from services.mocap.calibration.lens import FEWEST_VIEWS
from services.mocap.calibration.marker_diagnosis import wrong_markers
from services.mocap.calibration.sightings import Sightings
from services.mocap.errors import CalibrationError
from services.mocap.types import Bytes

_SAMPLES, _FEW_SAMPLES = 12, 4
_SHRUNK_WIDTH_PX = 800
_SAME_PX, _SAME_SHARE, _FEWEST_SAME = 0.05, 0.9, 5


def check_prints(looked: list[tuple[Clip, Sightings]], board: Board) -> None:
    """Raise CalibrationError if a camera hardly sees the board, with the reason if it can be found.

    Also if the pictures show another board than the one given.
    """
    for number, (clip, sightings) in enumerate(looked):
        if (board.has_markers and number == 0) or len(sightings.by_frame) < FEWEST_VIEWS:
            every = -(-clip.n_frames() // _SAMPLES)
            samples = [upright_print(picture, board) for _, picture in clip.pictures(every)]
            if sightings.is_behind:
                samples = [np.ascontiguousarray(sample[:, ::-1]) for sample in samples]
            find_problem = wrong_markers if board.has_markers else _wrong_chessboard
            problem = find_problem(samples, board)
            if problem is not None:
                raise CalibrationError(f"{clip.path}: {problem}")
        if len(sightings.by_frame) < FEWEST_VIEWS:
            raise CalibrationError(
                f"{clip.path}: {board.in_words()} is found in {len(sightings.by_frame)} of "
                f"{sightings.n_looked_at} pictures: expected {FEWEST_VIEWS} or more: check the size given, "
                "show the board nearer, slanted less, evenly lit and without blur"
            )


def check_same_pictures(seen: list[Sightings]) -> None:
    """Raise CalibrationError if two cameras have identical pictures."""
    for one, other in combinations(seen, 2):
        shared = sorted(one.by_frame.keys() & other.by_frame.keys())
        if len(shared) < _FEWEST_SAME:
            continue
        pairs = [(one.by_frame[frame], other.by_frame[frame]) for frame in shared]
        same = sum(
            np.array_equal(a.corners, b.corners) and np.abs(a.points_px - b.points_px).max() < _SAME_PX
            for a, b in pairs
        )
        if same >= _SAME_SHARE * len(shared):
            raise CalibrationError(
                f"{one.camera} and {other.camera}: have identical pictures: one clip exists under two "
                "names: remove one, or put the right clip in its place"
            )


def _wrong_chessboard(pictures: list[Bytes], board: Board) -> str | None:
    """Another size of chessboard that is detected more often than the one given."""
    # each size is searched in all pictures, which takes long in large ones
    pictures = pictures[:: max(1, len(pictures) // _FEW_SAMPLES)]
    share = min(1.0, _SHRUNK_WIDTH_PX / pictures[0].shape[1]) if pictures else 1.0
    area = cv2.INTER_AREA
    pictures = [
        np.asarray(cv2.resize(picture, None, fx=share, fy=share, interpolation=area), np.uint8)
        for picture in pictures
    ]
    best = max(_sizes_near(board), key=lambda other: _n_found(pictures, other))
    if _n_found(pictures, best) <= max(_n_found(pictures, board), 1):
        return None
    return (
        f"shows a chessboard of {best.columns}x{best.rows} squares and not of {board.columns}x{board.rows}: "
        f"give --squares {best.columns}x{best.rows} (squares are counted, not the corners between them)"
    )


def _sizes_near(board: Board) -> Iterable[Board]:
    """Boards of one or two squares more or fewer, larger ones first: part of one passes for a smaller one."""
    for columns, rows in ((board.columns, board.rows), (board.rows, board.columns)):
        for more in ((1, 1), (2, 2), (1, 0), (0, 1), (2, 1), (1, 2), (0, 0), (-1, -1), (-1, 0), (0, -1)):
            size = {"columns": columns + more[0], "rows": rows + more[1]}
            if min(size.values()) >= FEWEST_SQUARES and sum(size.values()) % 2:
                yield board.model_copy(update=size)


def _n_found(pictures: list[Bytes], board: Board) -> int:
    detector = Detector(board)
    return sum(detector.find(picture) is not None for picture in pictures)
