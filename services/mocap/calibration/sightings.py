"""What one camera saw of the board, by frame."""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from services.mocap.calibration.board import Board
from services.mocap.types import Bytes, Floats, Ints

ENOUGH_CORNERS = 6
"""Fewer corners do not determine the board's pose."""
CELLS = 8
"""Cells per side of the picture in which coverage is counted."""
_FLATTEST = 0.02
"""Least ratio of the spread across points to that along them: about one line, everything may turn."""
_BENT_SHARE, _BENT_PX = 0.03, 3.0
"""How far corners may be off a plane's picture, as a share of the board's size in it: a lens bends by that
much, while corners that were taken for others are off by whole squares."""


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
    """Pictures of one number show one moment in all cameras; no two cameras have the same negative number."""
    n_looked_at: int
    """The number of pictures in which the board was searched."""
    best_picture: Bytes | None = None
    """The one in which most of the board was seen, (H, W) or (H, W, 3)."""

    @property
    def is_behind(self) -> bool:
        """Whether it mostly sees a board's back, or its pictures are mirrored."""
        return 2 * sum(view.is_behind for view in self.by_frame.values()) > len(self.by_frame)


def is_usable(sighting: Sighting, board: Board) -> bool:
    """Whether a sighting can be the flat board: enough corners, not in one row, and in the board's order."""
    if len(sighting.corners) < ENOUGH_CORNERS:
        return False
    corners_m = board.corners_m[sighting.corners, :2]
    if not (is_spread(corners_m) and is_spread(sighting.points_px)):
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


def is_spread(points: Floats) -> bool:
    """Whether points (N, 2) or (N, 3) do not lie on one line."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > _FLATTEST * spread[0])


def share_of_cells(points_px: Floats, size_px: tuple[int, int]) -> float:
    """The share of a picture, in CELLS each way, in which points (N, 2) lie; size_px: width and height."""
    cells = (points_px / size_px * CELLS).astype(int).clip(0, CELLS - 1)
    return len(np.unique(cells, axis=0)) / CELLS**2


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
