"""Fit and track a recorded take from Python: in this process, without a socket, frame by frame.

README.md has an example. With the same actor and known poses, poses equal those of `xormocap track` with one
to seven workers.
"""

import json
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from services.mocap.body.actor import Actor as Actor
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.engine import check_cost, open_engine
from services.mocap.energy.settings import EngineSettings as EngineSettings
from services.mocap.errors import UserError
from services.mocap.export.formats import DEFAULT_FORMATS, FormatName, write_formats
from services.mocap.motion.settings import OutputSettings as OutputSettings
from services.mocap.motion.smoothing import smoothed
from services.mocap.result.layout import RUN_JSON
from services.mocap.result.result import Result, load_result, write_tracked
from services.mocap.search.both_ways import solve_both_ways
from services.mocap.search.first_frame import FirstFrame, FirstFrameSearch
from services.mocap.search.found import FrameSolution
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.overrides import check_weights
from services.mocap.search.settings import SearchSettings as SearchSettings
from services.mocap.search.silhouette_spool import SilhouetteSpool
from services.mocap.search.tracker import Tracker
from services.mocap.take.actor_file import take_actor as take_actor
from services.mocap.take.folder import Take
from services.mocap.take.folder import open_take as open_take
from services.mocap.take.moved_cameras import write_moved
from services.mocap.take.tables import PoseTable
from services.mocap.types import Floats
from services.recorder.result_folder import results_into
from services.runs.fit import fit_take, init_frames
from services.runs.refine import DEFAULT_REFINE_FRAMES, refine_take
from services.runs.take_fit import TakeFit
from services.runs.take_silhouettes import TakeSilhouettes
from services.segmentation.segmenters import AUTO, make_segmenter
from services.segmentation.silhouettes import Segmenter, packed

_ENGINE = EngineSettings()
_SEARCH = SearchSettings()
_OUTPUT = OutputSettings()


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """One frame of a take, solved."""

    number: int
    time_s: float
    """In the take."""
    solution: FrameSolution
    """The pose (D,), its energy, which parts should not be trusted, and what it took."""


def fit(
    take: Take, segmenter: str = AUTO, search: SearchSettings = _SEARCH, engine: EngineSettings = _ENGINE
) -> TakeFit:
    """Fit the actor to a take's first frames, as `xormocap fit --no-check` does, but write nothing.

    Problems that do not prevent a fit are logged as warnings. Raises TakeError if no person or more than one
    is visible, and UserError for settings that do not suit the take.
    """
    _check(take, search, engine)
    silhouettes = TakeSilhouettes(take, segmenter)
    return _warned(fit_take(silhouettes, init_frames(take), engine, search, lambda _stage, _share: None))


def refine(take: Take, result: Path, n_frames: int = DEFAULT_REFINE_FRAMES, segmenter: str = AUTO) -> TakeFit:
    """Fit the actor of a result again, to n frames of the whole take; track again with what is returned.

    `xormocap track` does so by itself. Raises UserError if the result belongs to another take or has fewer
    than two frames in which the body is not lost.
    """
    silhouettes = TakeSilhouettes(take, segmenter)
    return _warned(refine_take(silhouettes, result, n_frames, lambda _stage, _share: None))


def _warned(found: TakeFit) -> TakeFit:
    for sentence in found.warnings:
        warnings.warn(sentence, stacklevel=3)
    return found


def track(
    take: Take,
    actor: Actor | TakeFit,
    frames: range | None = None,
    first_pose: Floats | None = None,
    segmenter: str = AUTO,
    search: SearchSettings = _SEARCH,
    engine: EngineSettings = _ENGINE,
) -> Iterator[TrackedFrame]:
    """Find an actor's pose in each frame, in order; by default in all frames.

    Frames come once all are solved, since they are tracked both ways; with SearchSettings(both_ways=False)
    each comes as soon as it is solved.

    first_pose: (D,) of the first of these frames, where it is known. A fit knows those of its own frames, and
    a refined one those of its result, and where the cameras stand (TakeFit.moved_take).
    Raises UserError for frames that the take does not have, and settings or a segmenter that do not suit it
    or cannot run here. The first frame raises TakeError where nobody is to be seen in it.
    """
    _check(take, search, engine)
    numbers = frames if frames is not None else range(take.settings.frames)
    if not 0 <= numbers.start < numbers.stop <= take.settings.frames or numbers.step != 1:
        raise UserError(f"{numbers}: expected frames within 0:{take.settings.frames}, those of {take.folder}")
    made, known = make_segmenter(take, take.cameras, segmenter), dict[int, Floats]()
    if isinstance(actor, TakeFit):
        known = actor.pose_table(take.settings.fps).by_frame()
        made, take = made.knowing(actor.occluded, actor.colour_tables), actor.moved_take or take
        actor = actor.actor
    if first_pose is not None:
        known[numbers.start] = first_pose
    return _tracked(take, actor, numbers, known, made, search, engine)


def _check(take: Take, search: SearchSettings, engine: EngineSettings) -> None:
    check_weights(search, len(take.cameras))
    check_cost(engine, search.cost)


def _tracked(
    take: Take,
    actor: Actor,
    numbers: range,
    known: Mapping[int, Floats],
    segmenter: Segmenter,
    search: SearchSettings,
    engine: EngineSettings,
) -> Iterator[TrackedFrame]:
    first_pose, poses = known.get(numbers.start), [known.get(number) for number in numbers[1:]]
    rig, names, fps = Rig.of(take.cameras), take.camera_names, take.settings.fps
    hints, (height_px, width_px) = take.settings.beginning_at(numbers.start), rig.shape_px
    moments = segmenter.moments(numbers.start, numbers.stop)
    seen = (packed(moment.trimaps, width_px, height_px, moment.classes) for moment in moments)
    with open_engine(engine) as opened:
        begun = next(seen)
        search_first = FirstFrameSearch(
            rig, hints, lambda model, _: LocalLimbs(model), opened, search, names=names
        )
        first = search_first.solve(begun, actor, first_pose)
        with closing(first.model):
            if search.goes_both_ways:
                solved = _both_ways(first, begun, seen, poses, search, fps)
            else:
                solved = _one_way(first, seen, poses, search)
            for number, solution in zip(numbers, solved, strict=True):
                yield TrackedFrame(number, number / fps, solution)


def _one_way(
    first: FirstFrame, seen: Iterable[TriPlanes], poses: Sequence[Floats | None], search: SearchSettings
) -> Iterator[FrameSolution]:
    """The solutions of the first frame and of those that follow, whose silhouettes are `seen` (P, H, W);
    poses: (D,) those that are known of these."""
    yield first.solution
    tracker = Tracker(first.model, search, LocalLimbs(first.model), first.solution.pose[None])
    for planes, known in zip(seen, poses, strict=True):
        yield tracker.solve(planes, known=known)


def _both_ways(
    first: FirstFrame,
    begun: TriPlanes,
    seen: Iterable[TriPlanes],
    poses: Sequence[Floats | None],
    search: SearchSettings,
    fps: float,
) -> Iterator[FrameSolution]:
    """The same after a way back; begun: the silhouettes of the first frame; fps: frames per second."""
    with closing(SilhouetteSpool()) as spool:
        spool.append(begun)
        forward = list(_one_way(first, map(spool.append, seen), poses, search))
        found = np.array([solution.pose for solution in forward])
        for step in solve_both_ways(first.model, search, LocalLimbs(first.model), spool, found, fps):
            if step.solution is not None:
                yield step.solution


def write_result(
    folder: Path,
    take: Take,
    actor: Actor,
    tracked: Iterable[TrackedFrame],
    formats: tuple[FormatName, ...] = DEFAULT_FORMATS,
    output: OutputSettings = _OUTPUT,
) -> Result:
    """Write consecutive frames to a folder: poses.csv, joints.csv, actor.toml and files of some formats.

    take: after refine, the fit's moved_take if it has one. Existing results are replaced as a whole. output:
    how joints.csv and the formats' files are smoothed. Raises UserError for frames that are not consecutive,
    a format that cannot be written here, or a folder with other files than results.
    """
    solved = list(tracked)
    frames = np.array([frame.number for frame in solved], np.int32)
    if not solved or np.any(np.diff(frames) != 1):
        raise UserError(f"{folder}: expected consecutive frames, found {frames.tolist() or 'none'}")
    times_s = np.array([frame.time_s for frame in solved])
    table = PoseTable.of(frames, times_s, [frame.solution for frame in solved], is_live=False)
    settings = take.settings
    smooth = None if output.smooth == "none" else smoothed(table.poses, settings.fps, output)
    known = {"name": settings.name, "folder": str(take.folder), "frames": len(solved), "fps": settings.fps}
    with results_into(folder, complete=True) as part:
        write_tracked(part, table, actor, settings.up, smooth)
        write_moved(part, take)
        (part / RUN_JSON).write_text(json.dumps({"take": known}, indent=2) + "\n")
        write_formats(part, load_result(part), formats)
    return load_result(folder)
