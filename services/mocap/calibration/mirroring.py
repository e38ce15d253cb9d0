"""Finds cameras with mirrored pictures.

A board with markers reads in a mirror only, but also from behind if it is printed on both sides: then the
camera fits the others. A chessboard itself looks the same in a mirror.

Alone such a camera fits as well as any other; together with others it does not fit until its views are
flipped. By chance it fits a camera with which it shares one place of the board only, and the chain of cameras
would lead over that one.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from services.mocap.calibration.board import Board
from services.mocap.calibration.lens import Intrinsics
from services.mocap.calibration.pairs import LEAST_AGREEING, Link, find_links, sights_of
from services.mocap.calibration.sightings import Sighting, Sightings
from services.mocap.errors import CalibrationError

_CX, _P2 = 2, 7


def check_mirroring(
    seen: Sequence[Sightings], lenses: Sequence[Intrinsics], links: Sequence[Link], board: Board
) -> None:
    """Raise CalibrationError if the cameras fit together only with one camera's pictures flipped."""
    bad = [link for link in links if link.agreeing < LEAST_AGREEING]
    if board.has_markers:
        for c in {c for link in bad for c in (link.first, link.second)}:
            if seen[c].is_behind:
                raise CalibrationError(
                    f"{seen[c].camera}: is mirrored, its markers read only in the mirror, and it does not "
                    "fit the others as if it saw the back of the board: switch mirroring off in the camera, "
                    "or flip its clips"
                )
        return
    if not bad:
        return
    counts = np.bincount([c for link in bad for c in (link.first, link.second)], minlength=len(seen))
    worst = int(counts.argmax())
    others = [
        link.second if link.first == worst else link.first
        for link in bad
        if worst in (link.first, link.second)
    ]
    views = [flipped(seen[worst], board), *(seen[c] for c in others)]
    fitting = [_flipped_lens(lenses[worst]), *(lenses[c] for c in others)]
    sights = [sights_of(view, board, lens) for view, lens in zip(views, fitting, strict=True)]
    flipped_links = [link for link in find_links(views, sights, board, fitting) if link.first == 0]
    if any(link.agreeing < LEAST_AGREEING for link in flipped_links):
        return
    names = [seen[c].camera for c in sorted({worst, *others})]
    who = seen[worst].camera if len(others) > 1 else f"one of {' and '.join(names)}"
    raise CalibrationError(
        f"{who}: has mirrored pictures: flipped, they fit those of "
        f"{', '.join(seen[c].camera for c in others) if len(others) > 1 else 'the other'}: switch mirroring "
        "off in the camera, or flip its clips"
    )


def flipped(sightings: Sightings, board: Board) -> Sightings:
    """What a camera would have seen of a chessboard, had its pictures been flipped left to right."""
    columns, rows = board.columns - 1, board.rows - 1
    grid = np.arange(columns * rows).reshape(rows, columns)
    # One way the squares are odd in number: mirrored that way, the black corner square stays where it is.
    turned = grid[:, ::-1] if board.columns % 2 else grid[::-1]
    last_px = sightings.size_px[0] - 1
    views = {}
    for frame, view in sightings.by_frame.items():
        corners = turned.ravel()[view.corners]
        order = np.argsort(corners)
        points_px = (view.points_px * (-1, 1) + (last_px, 0))[order]
        views[frame] = Sighting(corners[order].astype(np.int32), points_px)
    return replace(sightings, by_frame=views)


def _flipped_lens(lens: Intrinsics) -> Intrinsics:
    """The lens of a camera whose pictures are flipped left to right."""
    values = lens.values.copy()
    values[_CX] = lens.size_px[0] - 1 - values[_CX]
    if not lens.is_fisheye:
        values[_P2] = -values[_P2]
    return replace(lens, values=values)
