"""Synchronisation by silhouettes: finds by how many frames each camera is ahead, so that all pairs agree."""

from dataclasses import dataclass

import numpy as np

from services.mocap.calibration.epipolar_tangents import Outline, Touches, touches_of
from services.mocap.camera.camera import Camera
from services.mocap.types import Floats

STEP = 0.5
"""Resolution of the offsets, in frames."""
CAP_PX_PER_WIDTH = 0.04
"""Frames that are off by more than this share of the width, by errors of segmentation, are capped at it."""
_FEWEST_FRAMES = 8
_ROUNDS = 20
_NEXT = 1.5
"""Offsets nearer than this to the best one are the same answer."""


@dataclass(frozen=True, eq=False)
class TimeOffsets:
    """Offsets of cameras."""

    offsets: Floats
    """(C,) in frames, the smallest zero: frame n + offset of a camera shows what frame n of the take is."""
    confidence: Floats
    """(C,) 0 to 1: how much better the offset is than the best other one. 0: undetermined."""
    off_px: Floats
    """(C,) mean error between the camera and the others, with these offsets."""
    off_before_px: Floats
    """The same without offsets."""


def find_offsets(
    cameras: tuple[Camera, ...], outlines: list[list[Outline | None]], reach: int
) -> TimeOffsets:
    """The offsets with which all pairs of cameras agree best; up to `reach` frames between two cameras.

    outlines: per camera, of each frame.
    """
    pairs, n_cameras = touches_of(cameras, outlines), len(cameras)
    width_px = float(np.median([camera.width_px for camera in cameras]))
    later = np.arange(-2 * reach, 2 * reach + STEP / 2, STEP)  # of two cameras, each off by up to `reach`
    costs = {(p.first, p.second): _costs(p, later, CAP_PX_PER_WIDTH * width_px) for p in pairs}
    costs = {pair: cost for pair, cost in costs.items() if np.isfinite(cost).any()}
    offsets = _first_guess(costs, later, n_cameras, reach)
    for _ in range(_ROUNDS):
        before = offsets.copy()
        for c in range(n_cameras):
            grid, total = _by_camera(c, offsets, costs, later, reach)
            if np.isfinite(total).any():
                offsets[c] = grid[int(np.nanargmin(total))]
        if np.array_equal(before, offsets):
            break
    now = [_by_camera(c, offsets, costs, later, reach) for c in range(n_cameras)]
    confidence = np.array([_confidence(grid, total, offsets[c]) for c, (grid, total) in enumerate(now)])
    off_px = np.array([_mean_at(c, offsets, costs, later) for c in range(n_cameras)])
    before_px = np.array([_mean_at(c, np.zeros(n_cameras), costs, later) for c in range(n_cameras)])
    return TimeOffsets(offsets - offsets.min(), confidence, off_px, before_px)


Costs = dict[tuple[int, int], Floats]
"""By pair of cameras: (L,) their error if the second is this much later."""


def _costs(pair: Touches, later: Floats, cap_px: float) -> Floats:
    costs = np.full(len(later), np.nan)
    for i, step in enumerate(later):
        off_px = pair.off_px(float(step))
        known = off_px[np.isfinite(off_px)]
        if known.size >= 2 * _FEWEST_FRAMES:
            costs[i] = np.minimum(known, cap_px).mean()
    return costs


def _first_guess(costs: Costs, later: Floats, n_cameras: int, reach: int) -> Floats:
    """Chain the cameras along the most certain pairs: those with a clear best offset."""
    offsets, placed = np.zeros(n_cameras), {0}
    while len(placed) < n_cameras:
        ends = [pair for pair in costs if (pair[0] in placed) != (pair[1] in placed)]
        if not ends:
            break
        first, second = max(ends, key=lambda pair: np.nanmedian(costs[pair]) - np.nanmin(costs[pair]))
        step = later[int(np.nanargmin(costs[first, second]))]
        if first in placed:
            offsets[second] = offsets[first] + step
        else:
            offsets[first] = offsets[second] - step
        placed |= {first, second}
    return np.asarray(offsets.clip(-reach, reach), np.float64)


def _by_camera(c: int, offsets: Floats, costs: Costs, later: Floats, reach: int) -> tuple[Floats, Floats]:
    """Offsets (G,) of one camera, and the mean cost (G,) of its pairs with each, others as they are."""
    grid = np.arange(-reach, reach + STEP / 2, STEP)
    rows = []
    for (first, second), cost in costs.items():
        if c in (first, second):
            step = grid - offsets[first] if c == second else offsets[second] - grid
            rows.append(np.interp(step, later, cost, left=np.nan, right=np.nan))
    if not rows:
        return grid, np.full(len(grid), np.nan)
    return grid, np.asarray(np.mean(rows, axis=0), np.float64)


def _confidence(grid: Floats, total: Floats, offset: float) -> float:
    others = total[(np.abs(grid - offset) >= _NEXT) & np.isfinite(total)]
    best = total[int(np.abs(grid - offset).argmin())]
    if not others.size or not np.isfinite(best) or others.min() <= 0:
        return 0.0
    return float(np.clip(1 - best / others.min(), 0.0, 1.0))


def _mean_at(c: int, offsets: Floats, costs: Costs, later: Floats) -> float:
    at = [np.interp(offsets[b] - offsets[a], later, cost) for (a, b), cost in costs.items() if c in (a, b)]
    return float(np.mean(at)) if at else float("nan")
