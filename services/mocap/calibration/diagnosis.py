"""Finds out why a camera does not see the board: another board, mirrored pictures, another camera's
pictures."""

from collections.abc import Iterable
from itertools import combinations

import cv2
import numpy as np

from services.mocap.calibration.board import DICTIONARIES, FEWEST_SQUARES, Board
from services.mocap.calibration.clips import Clip
from services.mocap.calibration.lens import FEWEST_VIEWS
from services.mocap.calibration.sightings import Detector, Sightings, upright_print
from services.mocap.errors import CalibrationError
from services.mocap.types import Bytes, Floats, Ints

_SAMPLES, _FEW_SAMPLES = 12, 4
_SHRUNK_WIDTH_PX = 800
_SAME_PX, _SAME_SHARE, _FEWEST_SAME = 0.05, 0.9, 5
_SIZES = range(3, 16)
_FEWEST_MARKERS = 4
_ON_LATTICE = 0.08
"""Allowed error of the markers' positions, in squares, for a board size to be the right one."""


def check_prints(looked: list[tuple[Clip, Sightings]], board: Board) -> None:
    """Raise CalibrationError if a camera hardly sees the board, with the reason if it can be found.

    Also if the pictures show another board than the one given.
    """
    for number, (clip, sightings) in enumerate(looked):
        if (board.kind == "charuco" and number == 0) or len(sightings.by_frame) < FEWEST_VIEWS:
            every = -(-clip.n_frames() // _SAMPLES)
            samples = [upright_print(picture, board) for _, picture in clip.pictures(every)]
            if sightings.is_behind:
                samples = [np.ascontiguousarray(sample[:, ::-1]) for sample in samples]
            find_problem = _wrong_markers if board.kind == "charuco" else _wrong_chessboard
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


def _wrong_markers(pictures: list[Bytes], board: Board) -> str | None:
    views = _markers(pictures, board.dictionary)
    if not views:
        if _markers([np.ascontiguousarray(picture[:, ::-1]) for picture in pictures], board.dictionary):
            return (
                "is mirrored, its markers read only in the mirror: switch mirroring off in the camera, or "
                "flip it"
            )
        some = pictures[:: max(1, len(pictures) // _FEW_SAMPLES)]
        others = {name: len(_markers(some, name)) for name in DICTIONARIES}
        best = max(others, key=lambda name: others[name])
        if others[best]:
            return (
                f"shows markers of the dictionary {best} and not of {board.dictionary}: give --dictionary "
                f"{best}"
            )
        return None
    return _wrong_layout(views, board)


def _markers(pictures: list[Bytes], dictionary: str) -> list[tuple[Ints, Floats]]:
    """Ids (n,) and middles (n, 2) of the markers of each picture that shows some."""
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(DICTIONARIES[dictionary]))
    found = []
    for picture in pictures:
        corners, ids, _ = detector.detectMarkers(picture)
        if ids is not None and len(ids) >= _FEWEST_MARKERS:
            middles = np.array(
                [np.asarray(corner, np.float64).reshape(4, 2).mean(axis=0) for corner in corners]
            )
            found.append((np.ravel(ids).astype(np.int32), middles))
    return found


def _wrong_layout(views: list[tuple[Ints, Floats]], board: Board) -> str | None:
    """The board size that matches the detected markers, if it is not the one given."""
    if _misplaced(views, board) < _ON_LATTICE:
        return None
    fits: dict[Board, float] = {}
    for columns in _SIZES:
        for rows in _SIZES:
            for legacy in (False, True):
                other = board.model_copy(update={"columns": columns, "rows": rows, "legacy": legacy})
                if max(ids.max() for ids, _ in views) < other.n_markers:
                    fits[other] = _misplaced(views, other)
    if not fits:
        return None
    # the rows say nothing of where a marker lies: of boards alike in that the smallest that holds all of them
    best = min(fits, key=lambda other: (round(fits[other] / _ON_LATTICE), other.columns * other.rows))
    if fits[best] >= _ON_LATTICE:
        return None
    if (best.columns, best.rows) == (board.columns, board.rows):
        return (
            f"shows a board of the older layout of OpenCV: give --{'legacy' if best.legacy else 'no-legacy'}"
        )
    return (
        f"shows a ChArUco board of {best.columns}x{best.rows} squares (or more rows) and not of "
        f"{board.columns}x{board.rows}: give --squares {best.columns}x{best.rows}, columns first"
    )


def _misplaced(views: list[tuple[Ints, Floats]], board: Board) -> float:
    """Error of the markers' positions on a board, in squares: the median over some pictures."""
    row, column = np.indices((board.rows, board.columns))
    white = (row + column) % 2 == (not (board.legacy and board.rows % 2 == 0))
    places = np.stack([column[white], row[white]], axis=1) + 0.5  # (n_markers, 2) their middles, in squares
    off = []
    for ids, middles_px in views:
        if ids.max() >= len(places):
            off.append(np.inf)
            continue
        H, _ = cv2.findHomography(middles_px, places[ids], 0)
        mapped = None if H is None else cv2.perspectiveTransform(middles_px[None], H)[0]
        off.append(np.inf if mapped is None else float(np.linalg.norm(mapped - places[ids], axis=1).max()))
    return float(np.median(off))
