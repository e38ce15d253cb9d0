"""Fit and track a recorded take from Python: in this process, without a socket, frame by frame.

The poses are those that `xormocap track` finds with one to seven workers; README.md has an example.
"""

from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from services.mocap.body.actor import Actor
from services.mocap.camera.rig import Rig
from services.mocap.energy.engine import open_engine
from services.mocap.energy.settings import EngineSettings
from services.mocap.errors import UserError
from services.mocap.export.formats import DEFAULT_FORMATS, FormatName, write_formats
from services.mocap.motion.settings import OutputSettings
from services.mocap.motion.smoothing import smoothed
from services.mocap.result.result import Result, load_result
from services.mocap.result.writing import write_tracked
from services.mocap.search.chains import distrusted_values
from services.mocap.search.first_frame import solve_first_frame
from services.mocap.search.found import FrameSolution
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.settings import SearchSettings
from services.mocap.search.tracker import Tracker
from services.mocap.take.folder import Take
from services.mocap.take.folder import open_take as open_take
from services.mocap.take.marks import Marks
from services.mocap.take.tables import PoseTable
from services.mocap.types import Floats
from services.runs.fit import TakeFit, fit_take, init_frames
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.segmenters import AUTO, make_segmenter
from services.segmentation.source import packed

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
    """The pose (35,), its energy, which parts should not be trusted, and what it took."""


def fit(
    take: Take, segmenter: str = AUTO, search: SearchSettings = _SEARCH, engine: EngineSettings = _ENGINE
) -> TakeFit:
    """Fit the actor to a take's first frames, as `xormocap fit` does; its `actor` is the body.

    Raises TakeError where nobody is to be seen, or more than one person.
    """
    return fit_take(take, init_frames(take), engine, search, lambda _stage, _share: None, segmenter=segmenter)


def track(
    take: Take,
    actor: Actor,
    frames: range | None = None,
    first_pose: Floats | None = None,
    segmenter: str = AUTO,
    search: SearchSettings = _SEARCH,
    engine: EngineSettings = _ENGINE,
) -> Iterator[TrackedFrame]:
    """Find an actor's pose in each frame, in order; by default in all frames.

    first_pose: (35,) of the first of these frames, where it is known. Raises TakeError where nobody is to be
    seen in the first frame, and UserError for frames that the take does not have, or a segmenter or backend
    that cannot run here.
    """
    numbers = frames if frames is not None else range(take.settings.frames)
    if not 0 <= numbers.start < numbers.stop <= take.settings.frames or numbers.step != 1:
        raise UserError(f"{numbers}: expected frames within 0:{take.settings.frames}, those of {take.folder}")
    rig, names = Rig.of(take.cameras), [camera.name for camera in take.cameras]
    height_px, width_px = rig.shape_px
    silhouettes = make_segmenter(take, take.cameras, SegmentationSettings(), segmenter)
    shown = (
        packed(trimaps, width_px, height_px) for trimaps in silhouettes.trimaps(numbers.start, numbers.stop)
    )
    with open_engine(engine) as opened:
        first = solve_first_frame(
            next(shown), rig, actor, take.settings.beginning_at(numbers.start),
            lambda model, _: LocalLimbs(model), opened, search, first_pose, names,
        )  # fmt: skip
        with closing(first.model.backend):
            yield TrackedFrame(numbers.start, numbers.start / take.settings.fps, first.solution)
            tracker = Tracker(first.model, search, LocalLimbs(first.model), first.solution.pose[None])
            for number, seen in zip(numbers[1:], shown, strict=False):
                yield TrackedFrame(number, number / take.settings.fps, tracker.solve(seen))


def write_result(
    folder: Path,
    take: Take,
    actor: Actor,
    tracked: Iterable[TrackedFrame],
    formats: tuple[FormatName, ...] = DEFAULT_FORMATS,
    output: OutputSettings = _OUTPUT,
) -> Result:
    """Write consecutive frames to a folder: poses.csv, joints.csv, actor.toml and files of some formats.

    output: how joints.csv and these files are smoothed.
    Raises UserError for a format that cannot be written here, and OSError.
    """
    solved = list(tracked)
    folder.mkdir(parents=True, exist_ok=True)
    frames = np.array([frame.number for frame in solved], np.int32)
    times_s = np.array([frame.time_s for frame in solved])
    poses = np.array([frame.solution.pose for frame in solved])
    energies_px = np.array([frame.solution.energy_px for frame in solved])
    priors = np.array([frame.solution.prior for frame in solved])
    marks = Marks.of([frame.solution for frame in solved])
    table = PoseTable(frames, times_s, poses, energies_px, marks=marks, extra={"prior": priors})
    smooth = None
    if output.smooth != "none":
        smooth = smoothed(poses, take.settings.fps, output, distrusted_values(marks))
    write_tracked(folder, table, actor, take.settings.up, smooth)
    read = load_result(folder)
    motion = replace(read.motion, name=take.settings.name, fps=take.settings.fps)
    result = replace(read, motion=motion)
    write_formats(folder, result, formats)
    return result
