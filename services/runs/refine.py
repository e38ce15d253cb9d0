"""Fitting the actor of a take again, to frames of the whole take, with the poses of an earlier run.

In the first frames people often hold their arms and legs straight, and along a straight limb no outline shows
where its joint is. Later they bend them. The poses also show where furniture hides the actor from a camera,
and which colours each part of the actor has.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from services.mocap.body.actor import Actor
from services.mocap.body.skeleton import BodyName
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.camera.undistort import Undistorter
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.picture import Region
from services.mocap.errors import UserError
from services.mocap.fit.fitting import Fit, fit_actor
from services.mocap.fit.hats import in_best_hat
from services.mocap.fit.quality import in_best_skirt
from services.mocap.result.result import Result, as_tracked, check_take, load_result
from services.mocap.sampling import evenly
from services.mocap.search.error_by_part import PART_SEGMENTS
from services.mocap.search.model import Model, model_on_cpu
from services.mocap.search.occlusion import PosedFrame, find_occluded
from services.mocap.search.settings import SearchSettings
from services.mocap.take.folder import Take
from services.mocap.take.marks import PARTS
from services.mocap.take.moved_cameras import moved_take
from services.mocap.take.tables import PoseTable
from services.mocap.types import ACTOR, Bytes, Floats, Ints, Mask
from services.runs.motion_blur import cut_motion_blur
from services.runs.moved_cameras import PLACING_FRAMES, disagree, if_moved, placed, warn_of_moved
from services.runs.reporting import Clock, Show, kept_warnings
from services.runs.take_fit import TakeFit, concluded, occluded_by_camera, warn_of_occluded
from services.runs.take_silhouettes import TakeSilhouettes, read_moments, seen_of
from services.runs.way_round import faces_other_way, turned_poses
from services.segmentation.background import CameraBackground
from services.segmentation.colour_classes import PIECES, ColourClasses, ColourLearner
from services.segmentation.silhouettes import Moment, Segmenter, packed

DEFAULT_REFINE_FRAMES = 16
LEAST_FRAMES = 2
_MOST_READ, _LOOKED_AT = 120, 60
"""All frames of shorter takes are looked at for what furniture hides, and so many of longer ones."""
_TAUGHT = 48
"""Of these so many at least teach what colours the actor has."""

_TORSO = PARTS.index("torso")

log = logging.getLogger(__name__)


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
    stated = silhouettes.take
    found = result_of(stated, result)
    take = as_tracked(stated, found)
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
            occluded, colours = look_over(
                take,
                found,
                segmenter,
                lambda share: progress(0.3 + 0.4 * share),
                learns_colours=learns_colours,
            )
            rows = least_doubtful_rows(found.distrusted, n_frames)
            if len(rows) < LEAST_FRAMES:
                raise UserError(
                    f"--refine {found.folder}: expected at least {LEAST_FRAMES} frames in which the whole "
                    "body is not lost"
                )
            frames, poses = tuple(found.tracked.frames[rows].tolist()), found.tracked.poses[rows]
            known = segmenter.knowing(occluded)
            cameras, seen = seen_of(take, frames, known, lambda share: progress(0.7 + 0.3 * share))
            if disagree(cameras, seen, found.actor, poses):
                take = _with_cameras_placed(take, found, known)
                cameras = tuple(camera for camera in take.cameras if camera.name in {c.name for c in cameras})
        coloured = found.actor
        if learns_colours:
            seen_colours = dict(colours.colours) if colours else {}
            coloured = coloured.model_copy(update={"colours": seen_colours})
        fit = _fitted(take, Rig.of(cameras), seen, coloured, poses, body, clock)
        started = found.actor, poses[0]
        refined = concluded(frames, cameras, seen, started, fit, clock.seconds, warnings)
        names = take.camera_names
        tables = dict(zip(names, colours.tables, strict=True)) if colours else {}
        return replace(
            refined, occluded=occluded, colour_tables=tables, moved=if_moved(stated, take),
            run_poses=_run_poses(found),
        )  # fmt: skip


def fit_other_way_round(
    silhouettes: TakeSilhouettes, result: Path, n_frames: int, search: SearchSettings
) -> TakeFit | None:
    """A fit to poses that face the other way than those of a result, in n frames of the whole take in which
    the body is not lost; None if those of the result fit better.

    search: that of the result. Raises UserError if the result belongs to another take, or its silhouettes
    make no sense.
    """
    stated, found = silhouettes.take, result_of(silhouettes.take, result)
    take = as_tracked(stated, found)
    rows = spread(found.distrusted[:, _TORSO], n_frames)
    if len(rows) < LEAST_FRAMES:
        return None
    frames, poses = tuple(found.tracked.frames[rows].tolist()), found.tracked.poses[rows]
    actor = found.actor.model_copy(update={"colours": {}})  # which were learnt from the wrong side
    with kept_warnings() as warnings:
        cameras, seen = seen_of(take, frames, silhouettes.segmenter, lambda _: None)
        rig = Rig.of(cameras)
        with model_on_cpu(actor, rig) as model:
            if not faces_other_way(model, seen, poses, search):
                return None
            poses = turned_poses(model, seen, poses, search)
        clock = Clock(lambda _stage, _share: None)
        fit = _fitted(take, rig, seen, actor, poses, search.body, clock)
        turned = concluded(frames, cameras, seen, (actor, poses[0]), fit, clock.seconds, warnings)
        return replace(turned, moved=if_moved(stated, take))


def _fitted(
    take: Take, rig: Rig, seen: TriPlanes, actor: Actor, poses: Floats, body: BodyName, clock: Clock
) -> Fit:
    """Fit an actor, in a skirt or a hat if that suits better, to frames (F, P, H, W) that lie apart, from
    poses (F, D)."""
    with clock.stage("fitting the actor") as progress:
        start = in_best_hat(in_best_skirt(actor, poses, rig, seen), poses, rig, seen)
        return fit_actor(rig, seen, start, poses, progress, body, take.settings.actor_height)


def _with_cameras_placed(take: Take, found: Result, segmenter: Segmenter) -> Take:
    """The take with its cameras where the body of a result shows them, after a warning; itself if it does not
    show them clearly elsewhere."""
    rows = least_doubtful_rows(found.distrusted, PLACING_FRAMES)
    cameras, seen = seen_of(take, found.tracked.frames[rows].tolist(), segmenter, lambda _: None)
    moved = moved_take(take, placed(cameras, seen, found.actor, found.tracked.poses[rows]))
    warn_of_moved(take, moved)
    return moved


def _run_poses(found: Result) -> PoseTable:
    """The poses of a result that help the next run (known_rows)."""
    kept, tracked = known_rows(found.distrusted), found.tracked
    return PoseTable(
        tracked.frames[kept], tracked.times_s[kept], tracked.poses[kept], tracked.energies_px[kept]
    )


def look_over(
    take: Take,
    found: Result,
    segmenter: Segmenter,
    progress: Callable[[float], None],
    *,
    learns_colours: bool,
) -> tuple[dict[str, Mask], ColourClasses | None]:
    """What the poses of a result tell: by camera the pixels (h, w) in which something hides the actor, and
    the actor's colour classes, None without pictures or if there is one colour only."""
    rig, n_frames = Rig.of(take.cameras), len(found.tracked.frames)
    rows = spread(np.zeros(n_frames, bool), n_frames if n_frames <= _MOST_READ else _LOOKED_AT)
    frames: Sequence[int] = found.tracked.frames[rows].tolist()
    if len(rows) == n_frames:
        frames = range(frames[0], frames[-1] + 1)
    height_px, width_px = rig.shape_px

    def posed() -> Iterator[PosedFrame]:
        moments = read_moments(frames, segmenter, with_pictures=learns_colours)
        for k, (row, moment) in enumerate(zip(rows, moments, strict=True)):
            pose, distrusted = found.tracked.poses[row], found.distrusted[row]
            if learns_colours and k % max(1, len(rows) // _TAUGHT) == 0:
                lesson.add(moment, pose, distrusted)
            yield PosedFrame(packed(moment.trimaps, width_px, height_px), pose, bool(distrusted[_TORSO]))
            progress((k + 1) / len(rows))

    with model_on_cpu(found.actor, rig) as model:
        lesson = _ColourLesson(model, take.cameras)
        masks = find_occluded(model, posed(), partial(_empty_stage, take))
    occluded = occluded_by_camera(take.cameras, masks)
    warn_of_occluded(take, occluded)
    return occluded, lesson.learner.conclude()


def _empty_stage(take: Take, camera: int) -> Bytes | None:
    """A camera's recorded clean plate (h, w, 3), undistorted; None without one."""
    picture = CameraBackground(take, take.cameras[camera]).mean_picture()
    return None if picture is None else Undistorter(take.cameras[camera]).image(picture)


class _ColourLesson:
    """Shows a learner what each piece of a tracked body looks like."""

    def __init__(self, model: Model, cameras: Sequence[Camera]) -> None:
        self._model, self._region = model, Region.whole(model.rig)
        self._undistorters = [Undistorter(camera) for camera in cameras]
        self.learner = ColourLearner(len(cameras))

    def add(self, moment: Moment, pose: Floats, distrusted: Mask) -> None:
        """Add a moment, undistorted, with its pose (D,); parts that are distrusted (6,) teach nothing, and
        nothing does if that is the torso."""
        if moment.images_bgr is None or distrusted[_TORSO]:
            return
        pieces = self._model.colours.painted(pose, self._region, PIECES)
        marked = [s for part in np.array(PARTS)[distrusted] for s in PART_SEGMENTS[part]]
        pieces[np.isin(pieces, PIECES[marked])] = 0
        for c, (undistorter, trimap) in enumerate(zip(self._undistorters, moment.trimaps, strict=True)):
            height, width = trimap.shape
            image = undistorter.image(moment.images_bgr[c])
            self.learner.add(c, image, pieces[c, :height, :width], trimap == ACTOR)


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
