"""Whether cameras agree, by the planes through the centres of two that touch the actor: equal for both, if
they agree.

All planes that hold two cameras' centres form a pencil. The actor lies between two of them; each camera sees
which, by the outermost points of its silhouette about the other camera's centre. So each pair of cameras is
compared by two angles per frame, without voxels and for any actor.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import cv2
import numpy as np
from cv2.typing import MatLike

from services.mocap.camera.camera import Camera
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Floats, Mask, Trimap

_WIDEST_RAD = 2.0
"""A silhouette that spans more of the pencil surrounds the other camera's centre: it has no outermost
points."""
_SMALLEST_SHARE = 0.0005
"""Of a picture; less is noise."""
_OFF_PER_WIDTH = 0.005
"""Two good cameras' silhouettes touch the same planes to within this share of the width, 1.6 px of 320."""
_FEWEST_LEFT = 2


@dataclass(frozen=True, eq=False)
class Outline:
    """One silhouette's outermost points, as one camera's rays."""

    rays_world: Floats
    """(n, 3) unit vectors."""
    cut_off: Mask
    """(n,) whether the point is at the picture's edge, where the actor may go on."""

    def pixels(self, camera: Camera) -> Floats:
        """(n, 2) the points in the undistorted picture of the camera that sees it."""
        homogeneous = self.rays_world @ camera.R_camera_world.T @ camera.K.T
        return homogeneous[:, :2] / homogeneous[:, 2:]

    def in_camera(
        self, camera: Camera, other: Camera | None = None, flip: tuple[float, float] = (1.0, 1.0)
    ) -> "Outline":
        """What another camera, or the same one, would see with this camera's picture.

        flip: -1 to flip the picture about its middle, across and down.
        """
        middle = np.array([camera.width_px - 1, camera.height_px - 1]) / 2
        pixels = (self.pixels(camera) - middle) * flip + middle
        return Outline((other or camera).rays_world(pixels), self.cut_off)


Outlines: TypeAlias = list[list[Outline | None]]
"""Per camera, of each frame."""


@dataclass(frozen=True, eq=False)
class Touches:
    """The planes of one pair's pencil that touch the actor, as both cameras see them; NaN where unknown."""

    first: int
    second: int
    angles_first: Floats
    """(F, 2) radians, lower and upper"""
    angles_second: Floats
    """(F, 2)"""
    px_per_rad: float
    """How far apart in the pictures planes are near the actor."""

    def reversed(self) -> "Touches":
        """The same pair with its second camera first."""
        return Touches(self.second, self.first, self.angles_second, self.angles_first, self.px_per_rad)

    def off_px(self, later: float) -> Floats:
        """(F, 2) difference of both angles if the second camera's frames are this much later.

        NaN if unknown; half frames are interpolated.
        """
        frames = np.arange(len(self.angles_second)) + later
        low = np.floor(frames).astype(int)
        share = (frames - low)[:, None]
        inside = (low >= 0) & (low + (share[:, 0] > 0) < len(frames))
        low = np.where(inside, low, 0)
        high = np.minimum(low + 1, len(frames) - 1)
        before, after = self.angles_second[low], self.angles_second[high]
        at = np.where(share > 0, (1 - share) * before + share * after, before)
        return np.where(inside[:, None], np.abs(self.angles_first - at), np.nan) * self.px_per_rad


def outline_of(trimap: Trimap, camera: Camera) -> Outline | None:
    """The convex outline of an undistorted trimap's actor (H, W); None if there is almost none.

    Unsure pixels beside the actor belong to it, and where they are outermost, the actor is cut off: what is
    left are the points that are outermost whatever these pixels are.
    """
    if (trimap == ACTOR).mean() < _SMALLEST_SHARE:
        return None
    contour = max(_contours(trimap == ACTOR), key=cv2.contourArea)
    if (trimap == UNSURE).any():
        x, y = contour[0, 0].tolist()
        possible = _contours(trimap != BACKGROUND)
        contour = next(c for c in possible if cv2.pointPolygonTest(c, (x, y), False) >= 0)
    corners = cv2.convexHull(contour)[:, 0]
    hull_px, (height, width) = corners.astype(np.float64), trimap.shape
    cut_off = np.any((hull_px < 1) | (hull_px > (width - 2, height - 2)), axis=1)
    cut_off |= trimap[corners[:, 1], corners[:, 0]] == UNSURE
    return Outline(camera.rays_world(hull_px), cut_off)


def _contours(mask: Mask) -> Sequence[MatLike]:
    """The outer contours of a mask (H, W), each (N, 1, 2) x and y of pixels."""
    return cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]


def touches_of(cameras: tuple[Camera, ...], outlines: Outlines) -> list[Touches]:
    """All pairs of cameras that stand apart; outlines: per camera, of each frame."""
    found = [_touches(a, b, cameras, outlines) for a, b in combinations(range(len(cameras)), 2)]
    return [touches for touches in found if touches is not None]


def _touches(a: int, b: int, cameras: tuple[Camera, ...], outlines: Outlines) -> Touches | None:
    baseline_m = cameras[b].centre_world_m - cameras[a].centre_world_m
    length_m = float(np.linalg.norm(baseline_m))
    seen = [outline for c in (a, b) for outline in outlines[c] if outline is not None]
    if length_m < 0.05 or not seen:
        return None
    axis = baseline_m / length_m
    across = [outline.rays_world - np.outer(outline.rays_world @ axis, axis) for outline in seen]
    middle = np.mean([rays.mean(axis=0) for rays in across], axis=0)
    if np.linalg.norm(middle) < 1e-6:
        return None
    u = middle / np.linalg.norm(middle)
    basis = np.stack([u, np.cross(axis, u)])
    angles = [np.array([_extremes(outline, basis) for outline in outlines[c]]) for c in (a, b)]
    slant = float(np.mean([np.linalg.norm(rays, axis=1).mean() for rays in across]))
    focal_px = float(np.mean([cameras[c].K[0, 0] for c in (a, b)]))
    return Touches(a, b, angles[0], angles[1], focal_px * slant)


def _extremes(outline: Outline | None, basis: Floats) -> tuple[float, float]:
    """Lower and upper angle of an outline about the axis; NaN where it is cut off there."""
    if outline is None:
        return np.nan, np.nan
    x, y = basis @ outline.rays_world.T
    angles = np.arctan2(y, x)
    low, high = int(angles.argmin()), int(angles.argmax())
    if angles[high] - angles[low] > _WIDEST_RAD:
        return np.nan, np.nan
    return tuple(np.nan if outline.cut_off[i] else float(angles[i]) for i in (low, high))  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class TangentAgreement:
    """The agreement of all cameras."""

    off_px: Floats
    """(C,) distance of the tangent planes to the actor between a camera and those that agree; NaN if
    unknown."""
    odd: tuple[int, ...]
    """Cameras that do not agree with the others, the worst first."""
    n_agreeing: int
    """Pairs of cameras that agree."""

    @property
    def good(self) -> list[int]:
        """Cameras that are known to agree with the others."""
        return [c for c in range(len(self.off_px)) if c not in self.odd and np.isfinite(self.off_px[c])]


def agreement_of(cameras: tuple[Camera, ...], outlines: Outlines) -> TangentAgreement:
    """Find the cameras that disagree: the worst is left out until all others agree.

    outlines: per camera, of each frame. If two disagree it is unknown which is wrong: then both are odd.
    """
    off_px = pair_matrix(len(cameras), touches_of(cameras, outlines))
    limit_px = agreement_limit_px(cameras)
    left = [c for c in range(len(cameras)) if np.isfinite(off_px[c]).any()]
    odd: list[int] = []
    while len(left) > _FEWEST_LEFT:
        each = np.array([_typical(off_px, c, left) for c in left])
        if not (each > limit_px).any():
            break
        odd.append(left.pop(int(np.nanargmax(each))))
    if len(left) == _FEWEST_LEFT and _typical(off_px, left[0], left) > limit_px:
        odd += left
    good = [c for c in left if c not in odd] or left
    each = np.array([_typical(off_px, c, [*good, c]) for c in range(len(cameras))])
    return TangentAgreement(each, tuple(odd), int((off_px <= limit_px).sum()) // 2)


def agreement_limit_px(cameras: Sequence[Camera]) -> float:
    """The error up to which cameras agree."""
    return _OFF_PER_WIDTH * float(np.median([camera.width_px for camera in cameras]))


def pair_matrix(n_cameras: int, pairs: Sequence[Touches]) -> Floats:
    """(C, C) error of each pair of cameras in the median frame; NaN if unknown."""
    off_px = np.full((n_cameras, n_cameras), np.nan)
    for pair in pairs:
        off = pair.off_px(0.0)
        if np.isfinite(off).any():
            off_px[pair.first, pair.second] = off_px[pair.second, pair.first] = float(np.nanmedian(off))
    return off_px


def _typical(off_px: Floats, camera: int, among: list[int]) -> float:
    """How far a camera is off in the median of its pairs with some others; NaN where none says anything."""
    off = [off_px[camera, other] for other in among if other != camera]
    return float(np.nanmedian(off)) if np.isfinite(off).any() else float("nan")
