"""Lenses: OpenCV's models for many points at once, and a first estimate of one camera's by its sightings."""

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import cv2
import numpy as np

from services.mocap.calibration.board import Board
from services.mocap.calibration.sightings import Sightings, share_of_cells, spread_out
from services.mocap.camera.undistort import SOLVED_UNTIL
from services.mocap.errors import CalibrationError
from services.mocap.types import Floats

Lens: TypeAlias = Literal["normal", "wide", "fisheye"]
"""normal: k1, k2, p1, p2. wide: k3 as well. fisheye: the four of OpenCV's fisheye model."""
N_COEFFICIENTS: dict[Lens, int] = {"normal": 4, "wide": 5, "fisheye": 4}
N_INTRINSICS = 9
"""fx, fy, cx, cy and five coefficients, of which those that a lens lacks stay zero."""
_NEAREST_M = 1e-3

FEWEST_VIEWS = 6
_MOST_VIEWS = 40
_SPOILED_PX, _SPOILED_RATIO = 1.0, 3.0
"""A view whose error is beyond both, in pixels and against the median view's, is left out."""
_ROUNDS = 3
_COVERED_SHARE = 0.4
"""Views that show corners in this share of a picture's cells determine the full model."""
_FLAGS: dict[Lens, int] = {
    "normal": cv2.CALIB_FIX_K3,
    "wide": 0,
    "fisheye": cv2.CALIB_RECOMPUTE_EXTRINSIC + cv2.CALIB_FIX_SKEW,
}
_SIMPLE = cv2.CALIB_FIX_K3 | cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST
_SIMPLER: tuple[tuple[int, tuple[str, ...]], ...] = (
    (_SIMPLE | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_K2, ("fx", "k1")),
    (_SIMPLE | cv2.CALIB_FIX_K2, ("fx", "cx", "cy", "k1")),
    (_SIMPLE, ("fx", "cx", "cy", "k1", "k2")),
)
"""Models simpler than `normal`: OpenCV's flags, and the values that are free. They have one focal length, and
the principal point is in the middle if it is not free."""
_VALUES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


def intrinsic_values(K: Floats, coefficients: Floats) -> Floats:
    """(N_INTRINSICS,) as Intrinsics holds them: of a camera matrix (3, 3) and a lens's coefficients (n,)."""
    values: Floats = np.zeros(N_INTRINSICS)
    values[: 4 + len(coefficients)] = K[0, 0], K[1, 1], K[0, 2], K[1, 2], *coefficients
    return values


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """One camera's lens."""

    lens: Lens
    size_px: tuple[int, int]
    values: Floats
    """(N_INTRINSICS,) focal lengths, principal point and coefficients (intrinsic_values)."""
    free: tuple[bool, ...] = ()
    """Which of the values an adjustment may change; by default all that the lens has."""

    @property
    def is_held(self) -> bool:
        """Whether it is known and must not be changed."""
        return bool(self.free) and not any(self.free)

    @property
    def is_simple(self) -> bool:
        """Whether a model was chosen that is simpler than its views could be fitted with."""
        return any(self.free) and not all(self.free[: 4 + N_COEFFICIENTS[self.lens]])

    @property
    def K(self) -> Floats:
        """(3, 3)"""
        fx, fy, cx, cy = self.values[:4]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> Floats:
        """(4,) or (5,)"""
        return self.values[4 : 4 + N_COEFFICIENTS[self.lens]].copy()

    @property
    def is_fisheye(self) -> bool:
        """Which of OpenCV's two models it is."""
        return self.lens == "fisheye"

    def normalised(self, points_px: Floats) -> Floats:
        """(n, 2) raw pixels to undistorted picture coordinates at focal length 1."""
        if self.is_fisheye:
            points = cv2.fisheye.undistortPoints(points_px[:, None], self.K, self.distortion)
        else:
            points = cv2.undistortPoints(points_px[:, None], self.K, self.distortion, criteria=SOLVED_UNTIL)
        return np.asarray(points, np.float64).reshape(-1, 2)


def project(points_camera_m: Floats, values: Floats, fisheye: bool) -> Floats:
    """(N, 3) points, each with its camera's intrinsics (N, 9), to raw pixels (N, 2).

    Points behind the camera are pushed before it, so that a step of a minimiser that puts them there fails
    by a large but finite error.
    """
    depth_m = np.maximum(points_camera_m[:, 2], _NEAREST_M)
    x, y = points_camera_m[:, 0] / depth_m, points_camera_m[:, 1] / depth_m
    fx, fy, cx, cy = values[:, :4].T
    u, v = _fisheye(x, y, values) if fisheye else _radial_tangential(x, y, values)
    return np.stack([fx * u + cx, fy * v + cy], axis=1)


def _radial_tangential(x: Floats, y: Floats, values: Floats) -> tuple[Floats, Floats]:
    k1, k2, p1, p2, k3 = values[:, 4:].T
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xy = 2 * x * y
    return x * radial + p1 * xy + p2 * (r2 + 2 * x * x), y * radial + p2 * xy + p1 * (r2 + 2 * y * y)


def _fisheye(x: Floats, y: Floats, values: Floats) -> tuple[Floats, Floats]:
    r = np.hypot(x, y)
    angle = np.arctan(r)
    a2 = angle * angle
    k1, k2, k3, k4, _ = values[:, 4:].T
    bent = angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
    scale = np.where(r > 1e-9, bent / np.maximum(r, 1e-9), 1.0)
    return x * scale, y * scale


def estimate_intrinsics(sightings: Sightings, board: Board, lens: Lens) -> tuple[Intrinsics, list[int]]:
    """A camera's lens, and the frames that do not fit the others.

    Raises CalibrationError if there are too few views, or they do not determine the lens.
    """
    frames = spread_out(sightings.by_frame, sorted(sightings.by_frame), _MOST_VIEWS)
    spoiled: list[int] = []
    for _ in range(_ROUNDS):
        if len(frames) < FEWEST_VIEWS:
            raise CalibrationError(
                f"{sightings.camera}: only {len(frames)} views of the board that fit together: expected "
                f"{FEWEST_VIEWS} or more: show the board nearer, slanted, and all over the picture"
            )
        found, errors_px = _calibrate(sightings, frames, board, lens, _FLAGS[lens])
        limit_px = max(_SPOILED_PX, _SPOILED_RATIO * float(np.median(errors_px)))
        bad = [frame for frame, error_px in zip(frames, errors_px, strict=True) if error_px > limit_px]
        if not bad:
            break
        spoiled += bad
        frames = [frame for frame in frames if frame not in bad]
    return _simplest(sightings, frames, board, found, errors_px) if lens == "normal" else found, spoiled


def _simplest(
    sightings: Sightings, frames: list[int], board: Board, full: Intrinsics, errors_px: Floats
) -> Intrinsics:
    """The model with the best Bayesian information criterion: the full one, or one with fewer parameters.

    Views that cover little of a picture fit a wrong full model as well as the right one.
    """
    counts = np.array([len(sightings.by_frame[frame].corners) for frame in frames])
    points_px = np.concatenate([sightings.by_frame[frame].points_px for frame in frames])
    is_covered = share_of_cells(points_px, sightings.size_px) >= _COVERED_SHARE
    if is_covered or len(errors_px) != len(frames):
        return full

    def criterion(errors_px: Floats, n_free: int) -> float:
        n = 2 * int(counts.sum())
        return float(n * np.log(max((counts * errors_px**2).sum() / n, 1e-12)) + n_free * np.log(n))

    best, lowest = full, criterion(errors_px, 4 + N_COEFFICIENTS["normal"])
    for flags, free in _SIMPLER:
        found, errors_px = _calibrate(sightings, frames, board, "normal", flags)
        if (value := criterion(errors_px, len(free))) < lowest:
            best, lowest = replace(found, free=tuple(name in free for name in _VALUES)), value
    return best


def _calibrate(
    sightings: Sightings, frames: list[int], board: Board, lens: Lens, flags: int
) -> tuple[Intrinsics, Floats]:
    """The lens by some frames, and each frame's error (n,) in pixels.

    flags: OpenCV's. Raises CalibrationError.
    """
    views = [sightings.by_frame[frame] for frame in frames]
    corners = [board.corners_m[view.corners][:, None] for view in views]
    points = [view.points_px[:, None] for view in views]
    fit = _fit_fisheye if lens == "fisheye" else _fit
    try:
        K, distortion, errors_px = fit(corners, points, sightings.size_px, flags)
    except cv2.error:
        raise CalibrationError(
            f"{sightings.camera}: its views of the board do not determine the lens: show the board slanted, "
            "in the corners of the picture too"
        ) from None
    values = intrinsic_values(K, np.ravel(distortion)[: N_COEFFICIENTS[lens]])
    # The principal point lies within the picture, and the focal length is no telescope's.
    (fx, fy, cx, cy), (width, height) = values[:4], sightings.size_px
    inside = 0 <= cx <= width - 1 and 0 <= cy <= height - 1
    if not (inside and 0.1 * width < fx < 50 * width and 0.5 < fx / fy < 2):
        raise CalibrationError(
            f"{sightings.camera}: its views of the board give an impossible lens (focal length {fx:.0f} px, "
            f"principal point {cx:.0f}, {cy:.0f} in {width}x{height} pixels): show the board slanted in all "
            "directions, near and far, and check the board's size"
        )
    return Intrinsics(lens, sightings.size_px, values), errors_px


def _fit(
    corners: list[Floats], points: list[Floats], size_px: tuple[int, int], flags: int
) -> tuple[Floats, Floats, Floats]:
    """K (3, 3), coefficients, and the error of each view (n,), root mean square in pixels."""
    found = cv2.calibrateCameraExtended(
        [corner.astype(np.float32) for corner in corners],
        [point.astype(np.float32) for point in points],
        size_px,
        np.eye(3),
        np.zeros(5),
        flags=flags,
    )
    return np.asarray(found[1]), np.asarray(found[2]), np.ravel(found[-1]).astype(np.float64)


def _fit_fisheye(
    corners: list[Floats], points: list[Floats], size_px: tuple[int, int], flags: int
) -> tuple[Floats, Floats, Floats]:
    """The same of OpenCV's fisheye model, whose function wants points in rows: (1, n, …)."""
    corners, points = [np.swapaxes(corner, 0, 1) for corner in corners], [p.swapaxes(0, 1) for p in points]
    _, K, distortion, *poses = cv2.fisheye.calibrate(
        corners, points, size_px, np.eye(3), np.zeros(4), flags=flags
    )
    errors_px = []
    for corner, point, turn, shift in zip(corners, points, *poses, strict=True):
        off_px = cv2.fisheye.projectPoints(corner, turn, shift, K, distortion)[0] - point
        errors_px.append(float(np.sqrt((off_px**2).sum(axis=-1).mean())))
    return np.asarray(K), np.asarray(distortion), np.array(errors_px)
