"""Finds pairs of cameras that see the board together, their relative poses, and the chain of all cameras."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from services.mocap.calibration.board import Board
from services.mocap.calibration.lens import Intrinsics
from services.mocap.calibration.rigid_transform import IDENTITY, RigidTransform, board_in_camera
from services.mocap.calibration.sightings import Sightings, spread_out
from services.mocap.errors import CalibrationError
from services.mocap.types import Floats

FEWEST_SHARED = 3
"""Moments that two cameras must share to be linked."""
_MOST_SHARED = 40
LEAST_AGREEING = 0.4
"""The share of shared moments that must fit one relative pose."""
AGREEING_PX_PER_WIDTH = 0.02
"""Allowed error of the median moment in one camera when predicted from the other, per pixel of width."""

Sights = dict[int, list[RigidTransform]]
"""T_camera_board by frame: one, or two if the direction is ambiguous."""


@dataclass(frozen=True, eq=False)
class Link:
    """Two cameras that see the board together."""

    first: int
    second: int
    T_second_first: RigidTransform
    n_shared: int
    """Moments."""
    error_px: float
    """How far off the median moment is in the second camera, when predicted from the first."""
    agreeing: float
    """The share of moments that agree with the pose."""

    @property
    def strength(self) -> float:
        """Its reliability: how many moments agree, and how well."""
        return self.n_shared * self.agreeing / (1.0 + self.error_px)


def sights_of(sightings: Sightings, board: Board, intrinsics: Intrinsics) -> Sights:
    """The board's poses in all pictures of one camera."""
    found = {f: board_in_camera(s, board, intrinsics) for f, s in sightings.by_frame.items()}
    return {frame: poses for frame, poses in found.items() if poses}


def find_links(
    seen: list[Sightings], sights: list[Sights], board: Board, intrinsics: list[Intrinsics]
) -> list[Link]:
    """All pairs of cameras with enough moments in common."""
    links = []
    for a, b in combinations(range(len(seen)), 2):
        shared = sorted(frame for frame in sights[a].keys() & sights[b].keys() if frame >= 0)
        if len(shared) >= FEWEST_SHARED:
            frames = spread_out(seen[a].by_frame, shared, _MOST_SHARED)
            links.append(_link(a, b, frames, len(shared), sights, board, intrinsics[b]))
    return links


def _link(
    a: int, b: int, frames: list[int], n_shared: int, sights: list[Sights], board: Board, lens_b: Intrinsics
) -> Link:
    """The relative pose of a single moment with which most other moments agree."""
    candidates = [
        in_b @ in_a.inverse for frame in frames for in_a in sights[a][frame] for in_b in sights[b][frame]
    ]
    R = np.array([pose.R for pose in candidates])
    t_m = np.array([pose.t_m for pose in candidates])
    off_px = np.stack([_off_px(R, t_m, sights[a][f], sights[b][f], board, lens_b) for f in frames], axis=1)
    errors_px = np.median(off_px, axis=1)
    best = int(errors_px.argmin())
    limit_px = AGREEING_PX_PER_WIDTH * lens_b.size_px[0]
    return Link(
        a, b, candidates[best], n_shared, float(errors_px[best]), float((off_px[best] < limit_px).mean())
    )


def _off_px(
    R: Floats,
    t_m: Floats,
    in_a: list[RigidTransform],
    in_b: list[RigidTransform],
    board: Board,
    lens_b: Intrinsics,
) -> Floats:
    """(K,) error of the board's outline in the second camera for each of K relative poses.

    If the direction is ambiguous in a camera, the best pair of directions is used.
    """
    errors = []
    for first in in_a:
        predicted_m = first.apply(board.outline_m) @ R.transpose(0, 2, 1) + t_m[:, None]
        ahead = predicted_m[..., 2] > 0
        pixel = predicted_m[..., :2] / np.where(ahead, predicted_m[..., 2], 1.0)[..., None]
        for second in in_b:
            seen_m = second.apply(board.outline_m)
            off = np.linalg.norm(pixel - seen_m[:, :2] / seen_m[:, 2:], axis=-1)
            errors.append(np.where(ahead, off, np.inf).max(axis=1))
    return np.asarray(np.min(errors, axis=0) * lens_b.values[0], np.float64)


def chain(names: list[str], links: list[Link]) -> list[RigidTransform]:
    """T_camera_first for every camera, along the strongest links.

    Raises CalibrationError if cameras share no moments with the others, or their moments do not fit one
    relative pose.
    """
    placed = {0: IDENTITY}
    while len(placed) < len(names):
        open_ends = [link for link in links if (link.first in placed) != (link.second in placed)]
        if not open_ends:
            others = [name for c, name in enumerate(names) if c not in placed]
            raise CalibrationError(
                f"{', '.join(others)}: never or hardly ever see the board in the same moments as "
                f"{', '.join(names[c] for c in placed)}: show it to cameras of both groups together, in "
                f"{FEWEST_SHARED} places or more, and check that all clips show the same moments"
            )
        link = max(open_ends, key=lambda link: link.strength)
        if link.agreeing < LEAST_AGREEING:
            raise CalibrationError(
                f"{names[link.first]} and {names[link.second]}: see the board in {link.n_shared} moments "
                f"together, but only {100 * link.agreeing:.0f}% of these fit one relative pose: "
                "check that their clips show the same moments, that no camera moved, and that neither's "
                "pictures are mirrored"
            )
        if link.first in placed:
            placed[link.second] = link.T_second_first @ placed[link.first]
        else:
            placed[link.first] = link.T_second_first.inverse @ placed[link.second]
    return [placed[c] for c in range(len(names))]
