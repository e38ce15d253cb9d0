"""Finds out why a camera does not see the board: another board, mirrored pictures, another camera's
pictures."""

from collections.abc import Iterable, Iterator
from itertools import combinations

import cv2
import numpy as np

from services.mocap.calibration.board import DICTIONARIES, FEWEST_SQUARES, Board
from services.mocap.calibration.clips import Clip
from services.mocap.calibration.detection import Detector, marker_detector, markers_in, upright_print
from services.mocap.calibration.lens import FEWEST_VIEWS
from services.mocap.calibration.sightings import Sightings
from services.mocap.errors import CalibrationError
from services.mocap.types import Bytes, Floats, Ints

_SAMPLES, _FEW_SAMPLES = 12, 4
_SHRUNK_WIDTH_PX = 800
_SAME_PX, _SAME_SHARE, _FEWEST_SAME = 0.05, 0.9, 5
_SIZES = range(3, 16)
_SHEET_COLUMNS = range(2, 16)
_FEWEST_MARKERS = 4
_ON_LATTICE = 0.08
"""Allowed error of the markers' positions, in squares, for a board size to be the right one."""
_FAR = 100.0
_SIDE_OFF = 0.08
"""Allowed error of a sheet's markers' side against the distance from one to the next."""

_View = tuple[Ints, Floats]
"""Numbers (n,) and corners (n, 4, 2) of the markers of a picture."""


def check_prints(looked: list[tuple[Clip, Sightings]], board: Board) -> None:
    """Raise CalibrationError if a camera hardly sees the board, with the reason if it can be found.

    Also if the pictures show another board than the one given.
    """
    for number, (clip, sightings) in enumerate(looked):
        if (board.has_markers and number == 0) or len(sightings.by_frame) < FEWEST_VIEWS:
            samples = [upright_print(picture, board) for _, picture in clip.samples(_SAMPLES)]
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


def wrong_markers(pictures: list[Bytes], board: Board) -> str | None:
    """What grey pictures (H, W) show instead of the given board with markers; None if that cannot be told.

    Their negatives are looked at as well, unless the board says whether it is printed white on black.
    """
    prints = [pictures]
    if board.inverted is None:
        prints.append([255 - picture for picture in pictures])
    views = _most_views(prints, board.dictionary)
    if views:
        return _wrong_layout(views, board)
    mirrored = [[np.ascontiguousarray(picture[:, ::-1]) for picture in print_] for print_ in prints]
    if _most_views(mirrored, board.dictionary):
        return (
            "is mirrored, its markers read only in the mirror: switch mirroring off in the camera, or flip it"
        )
    some = [print_[:: max(1, len(print_) // _FEW_SAMPLES)] for print_ in prints]
    others = {name: len(_most_views(some, name)) for name in DICTIONARIES}
    best = max(others, key=lambda name: others[name])
    if not others[best]:
        return None
    return f"shows markers of the dictionary {best} and not of {board.dictionary}: give --dictionary {best}"


def _most_views(prints: list[list[Bytes]], dictionary: str) -> list[_View]:
    """The views of those pictures, as they are or their negatives, of which more show markers."""
    return max((_views(pictures, dictionary) for pictures in prints), key=len)


def _views(pictures: list[Bytes], dictionary: str) -> list[_View]:
    """The markers of each picture that shows some."""
    detector = marker_detector(dictionary)
    views = [markers_in(picture, detector) for picture in pictures]
    return [(ids, quads_px) for ids, quads_px in views if len(ids) >= _FEWEST_MARKERS]


def _wrong_layout(views: list[_View], board: Board) -> str | None:
    """The board that matches the detected markers, if it is not the one given."""
    if _misplaced(views, board) < _ON_LATTICE:
        return _wrong_gap(views, board) if board.kind == "aruco" else None
    fits = {other: _misplaced(views, other) for other in _others(views, board)}
    if not fits:
        return None

    # the rows say nothing of where a marker lies: of boards alike in that the smallest that holds all of them
    def rank(other: Board) -> tuple[int, bool, int]:
        is_as_given = (other.columns, other.rows) == (board.columns, board.rows)
        return round(min(fits[other] / _ON_LATTICE, _FAR)), not is_as_given, other.columns * other.rows

    best = min(fits, key=rank)
    return _in_words(best, board) if fits[best] < _ON_LATTICE else None


def _others(views: list[_View], board: Board) -> Iterator[Board]:
    """Other boards that hold all markers that were seen, with lengths as they come: none is used."""
    lowest, highest = min(ids.min() for ids, _ in views), max(ids.max() for ids, _ in views)
    for columns in _SIZES:
        for rows in _SIZES:
            for legacy in (False, True):
                size = {"columns": columns, "rows": rows, "legacy": legacy, "first_id": 0}
                other = board.model_copy(update={"kind": "charuco", **size})
                if highest < other.n_markers:
                    yield other
    for columns in _SHEET_COLUMNS:
        for first in sorted({0, board.first_id, int(lowest)}):
            rows = -(-(int(highest) - first + 1) // columns)
            for n_rows in {rows, max(rows, board.rows)}:
                size = {"columns": columns, "rows": n_rows, "first_id": first}
                yield board.model_copy(update={"kind": "aruco", "legacy": False, **size})


def _in_words(best: Board, board: Board) -> str:
    """What is shown, and the option to give."""
    size, is_sheet = f"{best.columns}x{best.rows}", best.kind == "aruco"
    shows = f"shows {best.in_words(short=True)} (or more rows)"
    option = f"--markers {size}" if is_sheet else f"--squares {size}"
    if best.kind != board.kind:
        return f"{shows} and not {board.in_words(short=True)}: give --board {best.kind} {option}"
    first = f" --first-id {best.first_id}" if best.first_id != board.first_id else ""
    if (best.columns, best.rows) != (board.columns, board.rows):
        return f"{shows} and not of {board.columns}x{board.rows}: give {option}{first}, columns before rows"
    if is_sheet:
        return f"shows markers from number {best.first_id} on: give{first}"
    return f"shows a board of the older layout of OpenCV: give --{'legacy' if best.legacy else 'no-legacy'}"


def _misplaced(views: list[_View], board: Board) -> float:
    """Error of the markers' positions on a board, in squares: the median over some pictures."""
    places = board.marker_cells + 0.5
    off = []
    for ids, quads_px in views:
        numbers, middles_px = ids - board.first_id, quads_px.mean(axis=1)
        is_held = numbers.min() >= 0 and numbers.max() < len(places)
        H = cv2.findHomography(middles_px, places[numbers], 0)[0] if is_held else None
        if H is None:
            off.append(np.inf)
            continue
        mapped = cv2.perspectiveTransform(middles_px[None], H)[0]
        off.append(float(np.linalg.norm(mapped - places[numbers], axis=1).max()))
    return float(np.median(off))


def _wrong_gap(views: list[_View], board: Board) -> str | None:
    """Whether a sheet's markers are as large against the gaps between them as they should be."""
    places, sides = board.marker_cells + 0.5, []
    for ids, quads_px in views:
        numbers = ids - board.first_id
        kept = (numbers >= 0) & (numbers < len(places))
        H = None
        if kept.sum() >= _FEWEST_MARKERS:
            H, _ = cv2.findHomography(quads_px[kept].mean(axis=1), places[numbers[kept]], 0)
        if H is not None:
            flat = cv2.perspectiveTransform(quads_px[kept].reshape(1, -1, 2), H).reshape(-1, 4, 2)
            sides.append(np.linalg.norm(flat - np.roll(flat, 1, axis=1), axis=-1).mean())
    expected = board.marker_side_m / board.pitch_m
    found = float(np.median(sides)) if sides else expected
    if abs(found - expected) < _SIDE_OFF * expected:
        return None
    return (
        f"shows gaps of {1 / found - 1:.2f} of a marker's side, but --marker {board.marker_side_m:g} --gap "
        f"{board.gap_m:g} means {1 / expected - 1:.2f}: measure both on the print (or marker_m and gap_m in "
        "board.toml)"
    )
