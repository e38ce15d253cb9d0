"""Calibrates all cameras in one world: each lens alone, pairs chained, then everything adjusted at once."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from services.mocap.calibration.board import Board
from services.mocap.calibration.bundle import Corners, Estimate, adjust, corners_of, residuals_px
from services.mocap.calibration.lens import Intrinsics, Lens, estimate_intrinsics
from services.mocap.calibration.mirroring import check_mirroring
from services.mocap.calibration.pairs import Link, Sights, chain, find_links, sights_of
from services.mocap.calibration.rigid_transform import RigidTransform
from services.mocap.calibration.sightings import ENOUGH_CORNERS, Sightings, spread_out
from services.mocap.camera.camera import Camera
from services.mocap.types import Bytes, Floats, Mask

ORIGIN_FRAME = 2**30
"""The number of the moment in which the board lies at the origin."""
_MOST_PER_CAMERA, _MOST_PER_PAIR = 40, 25
"""Number of moments for the adjustment: more hardly help and take long."""
_WRONG_PX, _WRONG_RATIO = 1.5, 5.0
"""A corner that is off by more than both, in pixels and against its camera's median, is wrong."""
_ROUNDS = 3
_STEEP = 0.9
"""Cosine to the vertical beyond which a board's rows give no horizontal direction."""

Show = Callable[[str, float], None]
"""Called with the current stage, in words, and the progress, 0 to 1."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Calibrated cameras, and their errors."""

    cameras: tuple[Camera, ...]
    """In the world of the origin's board: its middle is the origin, x and y lie in it, z leads out of it."""
    corners: Corners
    """The corners that were used."""
    residuals_px: Floats
    """(N, 2) error of each corner."""
    n_views: tuple[int, ...]
    """Per camera: number of sightings used."""
    n_bad_views: tuple[int, ...]
    """Per camera: number of sightings left out because they do not fit the others."""
    links: tuple[Link, ...]
    lenses: tuple[Intrinsics, ...]
    pictures: tuple[Bytes | None, ...] = ()
    """Per camera: the one in which most of the board was seen."""

    def error_px(self, camera: int) -> float:
        """Mean reprojection error of a camera: the mean distance of its corners."""
        off = self.residuals_px[self.corners.camera == camera]
        return float(np.linalg.norm(off, axis=1).mean())

    def rms_px(self, camera: int) -> float:
        """Root mean square of a camera's reprojection errors along one axis: the noise, if nothing else errs.

        A corner's distance has a root mean square sqrt(2) times as large.
        """
        off = self.residuals_px[self.corners.camera == camera]
        return float(np.sqrt(np.mean(off**2)))


def solve_rig(
    seen: list[Sightings],
    board: Board,
    lens: Lens,
    show: Show,
    known: Mapping[str, Intrinsics] | None = None,
    level: str | None = None,
) -> Solution:
    """Calibrate cameras by their sightings.

    known: lenses by camera, which are held. level: the camera whose pictures are upright and level, which
    matters if no camera has a sighting of moment ORIGIN_FRAME. Raises CalibrationError where the sightings do
    not determine the cameras.
    """
    show("lens by lens", 0.0)
    given = known or {}
    lenses, spoiled = zip(
        *[(given[s.camera], []) if s.camera in given else estimate_intrinsics(s, board, lens) for s in seen],
        strict=True,
    )
    kept = [
        replace(s, by_frame={frame: view for frame, view in s.by_frame.items() if frame not in bad})
        for s, bad in zip(seen, spoiled, strict=True)
    ]
    show("pairs of cameras", 0.2)
    sights = [sights_of(s, board, i) for s, i in zip(kept, lenses, strict=True)]
    links = find_links(kept, sights, board, list(lenses))
    check_mirroring(kept, lenses, links, board)
    cameras = chain([s.camera for s in seen], links)
    frames = _chosen_moments(kept, links)
    boards = [_board_in_rig(frame, sights, cameras, board) for frame in frames]
    show("all cameras together", 0.4)
    estimate, corners = _adjusted(Estimate(list(lenses), cameras, frames, boards), kept, board, show)
    return _solution(seen, estimate, corners, kept, links, level)


def _chosen_moments(seen: list[Sightings], links: list[Link]) -> list[int]:
    """Moments that show each camera, and each pair of cameras, the board in as many ways as possible."""
    chosen = {ORIGIN_FRAME} if any(ORIGIN_FRAME in sightings.by_frame for sightings in seen) else set()
    for link in links:
        first, second = seen[link.first].by_frame, seen[link.second].by_frame
        shared = sorted(frame for frame in first.keys() & second.keys() if frame >= 0)
        chosen.update(spread_out(first, shared, _MOST_PER_PAIR))
    for sightings in seen:
        missing = _MOST_PER_CAMERA - len(chosen & sightings.by_frame.keys())
        others = sorted(sightings.by_frame.keys() - chosen)
        chosen.update(spread_out(sightings.by_frame, others, missing) if missing > 0 else ())
    return sorted(chosen)


def _board_in_rig(
    frame: int, sights: list[Sights], cameras: list[RigidTransform], board: Board
) -> RigidTransform:
    """T_rig_board in a moment: of the single cameras' poses, the one nearest to all others."""
    told = [
        [cameras[c].inverse @ pose for pose in of_camera[frame]]
        for c, of_camera in enumerate(sights)
        if frame in of_camera
    ]
    outlines_m = [np.array([pose.apply(board.outline_m) for pose in poses]) for poses in told]
    candidates = [pose for poses in told for pose in poses]
    off_m = [
        sum(
            float(np.linalg.norm(other - pose.apply(board.outline_m), axis=-1).max(axis=1).min())
            for other in outlines_m
        )
        for pose in candidates
    ]
    return candidates[int(np.argmin(off_m))]


def _adjusted(
    estimate: Estimate, seen: list[Sightings], board: Board, show: Show
) -> tuple[Estimate, Corners]:
    """The estimate adjusted, and the corners that it was adjusted to."""
    everything = corners_of(seen, estimate.frames, board)
    corners = everything
    for number in range(_ROUNDS):
        estimate = adjust(estimate, corners, robust=number < _ROUNDS - 1)
        show("all cameras together", 0.4 + 0.6 * (number + 1) / _ROUNDS)
        if number < _ROUNDS - 1:
            corners = everything.only(_believable(everything, residuals_px(estimate, everything)))
    return estimate, corners


def _believable(corners: Corners, off_px: Floats) -> Mask:
    """(N,) corners with small errors, in views with mostly such corners."""
    off = np.linalg.norm(off_px, axis=1)
    right = np.zeros(len(off), bool)
    for camera in np.unique(corners.camera):
        of_camera = corners.camera == camera
        right[of_camera] = off[of_camera] < max(_WRONG_PX, _WRONG_RATIO * float(np.median(off[of_camera])))
    view = np.unique(np.stack([corners.camera, corners.frame]), axis=1, return_inverse=True)[1].ravel()
    n_right, n_all = np.bincount(view, right), np.bincount(view)
    good_view = (2 * n_right > n_all) & (n_right >= ENOUGH_CORNERS)
    return right & good_view[view]


def _solution(
    seen: list[Sightings],
    estimate: Estimate,
    corners: Corners,
    kept: list[Sightings],
    links: list[Link],
    level: str | None,
) -> Solution:
    T_rig_world = _world(estimate, [s.camera for s in seen], corners, level)
    chosen = set(estimate.frames)
    n_views, n_bad = [], []
    for c, sightings in enumerate(seen):
        used = len(np.unique(corners.frame[corners.camera == c]))
        tried = len(chosen & kept[c].by_frame.keys())
        n_views.append(used)
        n_bad.append(tried - used + len(sightings.by_frame) - len(kept[c].by_frame))
    cameras = [
        camera_of(s.camera, lens, T_camera_rig @ T_rig_world)
        for s, lens, T_camera_rig in zip(seen, estimate.lenses, estimate.cameras, strict=True)
    ]
    off_px = residuals_px(estimate, corners)
    return Solution(
        tuple(cameras), corners, off_px, tuple(n_views), tuple(n_bad), tuple(links), tuple(estimate.lenses)
    )


def _world(estimate: Estimate, names: list[str], corners: Corners, level: str | None) -> RigidTransform:
    """T_rig_world: of the board at the origin, or else of the first board that most cameras saw.

    Then up is up in the pictures of the camera `level`, or of all on average, and x leads along the board's
    rows.
    """
    if ORIGIN_FRAME in estimate.frames:
        return estimate.boards[estimate.frames.index(ORIGIN_FRAME)]
    views = np.unique(np.stack([corners.frame, corners.camera]), axis=1)
    first = estimate.boards[int(np.bincount(views[0]).argmax())]
    chosen = range(len(names)) if level is None else [names.index(level)]
    up = -np.mean([estimate.cameras[c].R[1] for c in chosen], axis=0)
    z = up / np.linalg.norm(up)
    along = first.R[:, 0] if abs(first.R[:, 0] @ z) < _STEEP else first.R[:, 1]
    x = along - (along @ z) * z
    x /= np.linalg.norm(x)
    return RigidTransform(np.stack([x, np.cross(z, x), z], axis=1), first.t_m)


def camera_of(name: str, lens: Intrinsics, T_camera_world: RigidTransform) -> Camera:
    """A lens at a place, as a camera."""
    return Camera(
        name=name,
        width_px=lens.size_px[0],
        height_px=lens.size_px[1],
        K=lens.K,
        distortion=lens.distortion,
        R_camera_world=T_camera_world.R,
        t_camera_world_m=T_camera_world.t_m,
        fisheye=lens.is_fisheye,
    )
