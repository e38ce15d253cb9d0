"""Fitting the actor of a take again, to frames of the whole take, with the poses of an earlier run.

In the first frames people often hold their arms and legs straight, and along a straight limb no outline shows
where its joint is. Later they bend them.
"""

from functools import partial
from pathlib import Path

import numpy as np

from services.mocap.body.skeleton import BodyName
from services.mocap.camera.rig import Rig
from services.mocap.errors import UserError
from services.mocap.fit.fitting import fit_actor
from services.mocap.fit.skirts import in_best_skirt
from services.mocap.result.result import Result, load_result
from services.mocap.take.folder import Take
from services.mocap.types import Ints, Mask
from services.runs.fit import Clock, Fitter, Show, TakeFit, concluded, kept_warnings, seen_of
from services.segmentation.segmenters import AUTO

DEFAULT_REFINE_FRAMES = 16
fit_apart: Fitter = partial(fit_actor, apart=True)
"""Settings of a fit to frames of a whole take."""
LEAST_FRAMES = 2


def refine_take(
    take: Take,
    result: Path,
    n_frames: int,
    show: Show,
    fitter: Fitter = fit_apart,
    segmenter: str = AUTO,
    body: BodyName = "anatomical",
) -> TakeFit:
    """Fit the actor of a result again, to n frames evenly spread over its take.

    Frames that the result marks are left out. body: whose pose parameters vary. Raises UserError if the
    result belongs to another take or has fewer than two reliable frames; else as fit_take.
    """
    found, distrusted = result_of(take, result, LEAST_FRAMES)
    if n_frames < LEAST_FRAMES:
        raise UserError(f"--frames {n_frames}: expected at least {LEAST_FRAMES} with --refine")
    rows = spread(distrusted, n_frames)
    frames, poses = tuple(found.tracked.frames[rows].tolist()), found.tracked.poses[rows]
    clock = Clock(show)
    with kept_warnings() as warnings:
        with clock.stage("looking at silhouettes") as progress:
            cameras, seen = seen_of(take, frames, segmenter, progress)
        with clock.stage("fitting the actor") as progress:
            height_m = take.settings.actor_height
            rig = Rig.of(cameras)
            start = in_best_skirt(found.actor, poses, rig, seen)
            fit = fitter(rig, seen, start, poses, progress, body, height_m)
        return concluded(frames, cameras, seen, (found.actor, poses[0]), fit, clock.seconds, warnings)


def result_of(take: Take, folder: Path, least_frames: int) -> tuple[Result, Mask]:
    """A result of a take, and the frames (N,) of it that are marked in any part of the body.

    Raises UserError if it belongs to another take or has fewer reliable frames.
    """
    found = load_result(folder)
    name = found.run.get("take", {}).get("name", take.settings.name)
    if name != take.settings.name or found.frames[-1] >= take.settings.frames:
        raise UserError(f"--refine {found.folder}: is of {name!r}, not of {take.settings.name!r}")
    distrusted = np.asarray(found.distrusted.any(axis=1), bool)
    if np.count_nonzero(~distrusted) < least_frames:
        raise UserError(f"--refine {found.folder}: expected at least {least_frames} frames without a mark")
    return found, distrusted


def spread(distrusted: Mask, n_frames: int) -> Ints:
    """At most n rows of (N,) frames, evenly spread over the reliable ones."""
    trusted = np.flatnonzero(~distrusted)
    picked = np.linspace(0, max(len(trusted) - 1, 0), min(n_frames, len(trusted)))
    return np.asarray(trusted[np.unique(picked.round().astype(int))], np.int64)
