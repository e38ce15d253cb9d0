"""Fitting the actor of a take again, to frames of the whole take, with the poses of an earlier run.

In the first frames people often hold their arms and legs straight, and along a straight limb no outline shows
where its joint is. Later they bend them. The poses also show where furniture hides the actor from a camera,
and which colours each part of the actor has.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from services.mocap.body.actor import Actor
from services.mocap.body.skeleton import BodyName
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.errors import UserError
from services.mocap.fit.fitting import Fit, fit_actor
from services.mocap.fit.worn import as_worn
from services.mocap.result.result import Result, check_take, load_result
from services.mocap.sampling import evenly
from services.mocap.search.model import model_on_cpu
from services.mocap.search.settings import SearchSettings
from services.mocap.take.folder import Take
from services.mocap.take.marks import PARTS
from services.mocap.take.moved_cameras import moved_take, moves_of, take_as_in
from services.mocap.take.tables import PoseTable
from services.mocap.types import Floats, Ints, Mask
from services.runs.camera_placing import PLACING_FRAMES, disagree, placed, warn_of_moved
from services.runs.look_over import look_over
from services.runs.motion_blur import cut_motion_blur
from services.runs.reporting import Clock, Show, kept_warnings
from services.runs.take_fit import TakeFit, concluded, warn_of_occluded
from services.runs.take_silhouettes import TakeSilhouettes, seen_of
from services.runs.way_round import faces_other_way, turned_poses
from services.segmentation.colour_classes import ColourClasses
from services.segmentation.silhouettes import Segmenter

DEFAULT_REFINE_FRAMES = 16
LEAST_FRAMES = 2

_TORSO = PARTS.index("torso")


def refine_take(
    silhouettes: TakeSilhouettes,
    result: Path,
    n_frames: int,
    show: Show,
    body: BodyName = "anatomical",
    *,
    learns_colours: bool = True,
) -> TakeFit:
    """Fit the actor of a result again, to n frames evenly spread over its take.

    Frames that the result marks are left out, but where few are without a mark, some with the fewest
    doubtful parts are taken; none in which the whole body is lost. body: whose pose parameters vary.
    learns_colours: whether the actor's colour classes are learnt from the pictures as well. Raises UserError
    if the result is of another take or shows the body in fewer than two frames; else as fit_take.
    """
    found = result_of(silhouettes.take, result)
    take = take_as_in(found.folder, silhouettes.take)
    if n_frames < LEAST_FRAMES:
        raise UserError(f"--frames {n_frames}: expected at least {LEAST_FRAMES} with --refine")
    clock = Clock(show)
    with kept_warnings() as warnings:
        with clock.stage("looking at silhouettes") as progress:
            warnings += silhouettes.remarks
            segmenter = silhouettes.segmenter
            if silhouettes.kept is not None:
                cut_motion_blur(
                    segmenter, silhouettes.kept, take.cameras, found.actor, found.tracked,
                    lambda share: progress(0.3 * share),
                )  # fmt: skip
            rows = least_doubtful_rows(found.distrusted, n_frames)
            if len(rows) < LEAST_FRAMES:
                raise UserError(
                    f"--refine {found.folder}: expected at least {LEAST_FRAMES} frames in which the whole "
                    "body is not lost"
                )
            poses = found.tracked.poses[rows]
            look = partial(_look, found, rows, segmenter, learns_colours=learns_colours)
            occluded, colours, cameras, seen = look(take, progress)
            if disagree(cameras, seen, found.actor, poses):
                take = _with_cameras_placed(take, found, segmenter.knowing(occluded))
                occluded, colours, cameras, seen = look(take, lambda _: None)
            warn_of_moved(take)
            warn_of_occluded(take, occluded)
        coloured = found.actor
        if learns_colours:
            seen_colours = dict(colours.colours) if colours else {}
            coloured = coloured.model_copy(update={"colours": seen_colours})
        fit = _fitted(take, Rig.of(cameras), seen, coloured, poses, body, clock)
        started = found.actor, poses[0]
        frames = tuple(found.tracked.frames[rows].tolist())
        refined = concluded(frames, cameras, seen, started, fit, clock.seconds, warnings)
        names = take.camera_names
        tables = dict(zip(names, colours.tables, strict=True)) if colours else {}
        return replace(
            refined, occluded=occluded, colour_tables=tables, run_poses=_run_poses(found),
            moved_take=take if moves_of(take) else None,
        )  # fmt: skip


def _look(
    found: Result,
    rows: Ints,
    segmenter: Segmenter,
    take: Take,
    progress: Callable[[float], None],
    *,
    learns_colours: bool,
) -> tuple[dict[str, Mask], ColourClasses | None, tuple[Camera, ...], TriPlanes]:
    """What the poses of a result tell of its take (look_over), and what cameras then see in some rows."""
    occluded, colours = look_over(
        take, found, segmenter, lambda share: progress(0.3 + 0.4 * share), learns_colours=learns_colours
    )
    frames, known = found.tracked.frames[rows].tolist(), segmenter.knowing(occluded)
    posed = found.actor, found.tracked.poses[rows]
    cameras, seen = seen_of(take, frames, known, lambda share: progress(0.7 + 0.3 * share), posed)
    return occluded, colours, cameras, seen


def fit_other_way_round(
    silhouettes: TakeSilhouettes, result: Path, n_frames: int, search: SearchSettings
) -> TakeFit | None:
    """A fit to poses that face the other way than those of a result, in n frames of the whole take in which
    the body is not lost; None if those of the result fit better.

    search: that of the result. Raises UserError if the result belongs to another take, or its silhouettes
    make no sense.
    """
    found = result_of(silhouettes.take, result)
    take = take_as_in(found.folder, silhouettes.take)
    rows = spread(found.distrusted[:, _TORSO], n_frames)
    if len(rows) < LEAST_FRAMES:
        return None
    frames, poses = tuple(found.tracked.frames[rows].tolist()), found.tracked.poses[rows]
    actor = found.actor.model_copy(update={"colours": {}})  # which were learnt from the wrong side
    with kept_warnings() as warnings:
        posed = actor, poses
        cameras, seen = seen_of(take, frames, silhouettes.segmenter, lambda _: None, posed)
        rig = Rig.of(cameras)
        with model_on_cpu(actor, rig) as model:
            if not faces_other_way(model, seen, poses, search):
                return None
            poses = turned_poses(model, seen, poses, search)
        clock = Clock(lambda _stage, _share: None)
        fit = _fitted(take, rig, seen, actor, poses, search.body, clock)
        turned = concluded(frames, cameras, seen, (actor, poses[0]), fit, clock.seconds, warnings)
        return replace(turned, moved_take=take if moves_of(take) else None)


def _fitted(
    take: Take, rig: Rig, seen: TriPlanes, actor: Actor, poses: Floats, body: BodyName, clock: Clock
) -> Fit:
    """Fit an actor, in a skirt or a hat if that suits better, to frames (F, P, H, W) that lie apart, from
    poses (F, D)."""
    with clock.stage("fitting the actor") as progress:
        start = as_worn(actor, poses, rig, seen)
        return fit_actor(rig, seen, start, poses, progress, body, take.settings.actor_height)


def _with_cameras_placed(take: Take, found: Result, segmenter: Segmenter) -> Take:
    """The take with its cameras where the body of a result shows them; the same take if it does not show them
    clearly elsewhere."""
    rows = least_doubtful_rows(found.distrusted, PLACING_FRAMES)
    poses = found.tracked.poses[rows]
    posed = found.actor, poses
    cameras, seen = seen_of(take, found.tracked.frames[rows].tolist(), segmenter, lambda _: None, posed)
    there = placed(cameras, seen, found.actor, poses)
    return take if there is cameras else moved_take(take, there)


def _run_poses(found: Result) -> PoseTable:
    """The poses of a result that help the next run (known_rows)."""
    kept, tracked = known_rows(found.distrusted), found.tracked
    return PoseTable(
        tracked.frames[kept], tracked.times_s[kept], tracked.poses[kept], tracked.energies_px[kept]
    )


def result_of(take: Take, folder: Path) -> Result:
    """A result of a take; raises UserError if it belongs to another take."""
    found = load_result(folder)
    check_take(found, take, f"--refine {found.folder}")
    if found.frames[-1] >= take.settings.frames:
        raise UserError(
            f"--refine {found.folder}: has frame {found.frames[-1]}, but {take.folder} only "
            f"{take.settings.frames} frames: track it again"
        )
    return found


def least_doubtful_rows(distrusted: Mask, n_frames: int) -> Ints:
    """At most n rows of distrusted parts (N, 6), without those in which the whole body is lost.

    If at least n / 2 rows have no distrusted part, they are evenly spread over these. Else they are those
    with the fewest distrusted parts, evenly spread where more rows have equally many than are needed.
    """
    doubtful = distrusted.sum(axis=1) + distrusted[:, _TORSO] * len(PARTS)
    if 2 * np.count_nonzero(doubtful == 0) >= n_frames:
        return spread(doubtful > 0, n_frames)
    rows = np.zeros(0, np.int32)
    for n_parts in range(len(PARTS)):
        rows = np.concatenate([rows, spread(doubtful != n_parts, n_frames - len(rows))])
    return np.sort(rows)


def known_rows(distrusted: Mask) -> Mask:
    """(N,) the rows of distrusted parts (N, 6) whose poses help the next run: those with none, and the first
    one, where that run usually begins, unless the whole body is lost there: to search a first pose takes many
    times as long as to align it."""
    known = np.asarray(~distrusted.any(axis=1))
    known[0] = not distrusted[0, _TORSO]
    return known


def spread(left_out: Mask, n_frames: int) -> Ints:
    """At most n rows of (N,) frames, evenly spread over those that are not left out."""
    kept = np.flatnonzero(~left_out)
    return np.asarray(kept[evenly(len(kept), n_frames)], np.int32)
