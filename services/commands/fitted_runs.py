"""Tracks a take with a progress bar, in as many runs as its body needs. Results are always those of the last.

- The body is given, or not to be fitted again: one run, both ways.
- It was fitted to the first frames only, now or before: a first run, forwards only, whose poses the second
  fit needs; that fit, to frames of the whole take; then a second run, both ways. If the second fit keeps the
  body, the first run is repeated both ways.
- In the results of a run the actor faces the other way: first of all one more, forwards, from a fit the
  other way round.

If the first pose was found later in the take than in its first frame, the first run goes both ways: else what
is before would have no poses.
"""

import shlex
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from services.commands.checks import blamed_first, not_told
from services.commands.consoles import say, stderr, warn
from services.commands.fit import EVERY_CORE, fit_with_bar
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.measures import measure
from services.mocap.body.own_mesh.mesh_import import import_mesh
from services.mocap.errors import UserError
from services.mocap.export.formats import FormatName, write_defaults
from services.mocap.result.layout import CORRECTED_FRAMES, POSES, journal_of
from services.mocap.result.result import load_result
from services.mocap.take.actor_file import read_actor, take_actor
from services.mocap.take.fit_record import FIT_FOLDER, read_record
from services.mocap.take.layout import ACTOR, SETTINGS
from services.mocap.take.segmenter_name import READY
from services.runs.fit import fit_take, init_frames
from services.runs.fit_files import write_fit
from services.runs.progress import Progress as Run
from services.runs.refine import DEFAULT_REFINE_FRAMES, fit_other_way_round, refine_take
from services.runs.take_silhouettes import TakeSilhouettes
from services.runs.track import TakeJob
from services.runs.track import track as track_take
from services.segmentation.segmenters import chosen_segmenter

_TURNED = "the actor faces the other way, left was taken for right: tracking again"
_AS_IT_IS = "a second fit, to frames of the whole take, left the body as it is"


def track_with_bar(job: TakeJob, warnings: Sequence[str] = ()) -> dict[str, Any]:
    """Track with a progress bar; returns run.json. Prints these warnings and the run's at the end."""
    said = list(warnings)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed}/{task.total} frames"),
        TextColumn("energy {task.fields[energy]:.0f} px"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=stderr) as bar:
        task = bar.add_task("starting", total=len(job.frames), energy=0.0)

        def show(run: Run) -> None:
            bar.update(task, completed=run.frames_done, energy=run.energy_px, description=run.stage)

        report = track_take(job, show=show, warn=said.append)
    warn(not_told(said, job.checks))
    return report


@contextmanager
def _fit_folder() -> Iterator[Path]:
    """A folder for the files of a fit; a run with them copies them to its results."""
    with tempfile.TemporaryDirectory(prefix="xormocap-fit-") as temporary:
        yield Path(temporary)


def forwards(job: TakeJob) -> TakeJob:
    """The same job, tracked forwards only: enough for a second fit, which needs poses of sure frames."""
    return replace(job, search=job.search.model_copy(update={"both_ways": False}))


def fit_and_track(
    job: TakeJob, silhouettes: TakeSilhouettes, mesh: Path | None, *, is_first_run: bool
) -> dict[str, Any]:
    """Fit an actor to the first frames, for this run only, and track; returns run.json.

    mesh: a file with an own mesh to fit. is_first_run: whether track_again follows; the first run is not
    repeated if its results are there because the second one was interrupted.
    """
    take, own, warnings = job.take, None, list[str]()
    if mesh is not None:
        imported = import_mesh(mesh)
        own, warnings = imported.mesh, list(imported.remarks)
    if not is_first_run:
        words = ["xormocap", "fit", str(take.folder), *(() if mesh is None else ("--mesh", str(mesh)))]
        command = shlex.join(words)
        say(f"the body is fitted for this run; {command} stores one in the take")
    engine = job.engine.model_copy(update={"threads": EVERY_CORE})
    first = init_frames(take, start=job.frames.start, is_refined_next=is_first_run)
    work = partial(
        fit_take, silhouettes, first, engine, job.search, mesh=own, before=job.frames.stop,
        is_refined_next=is_first_run,
    )  # fmt: skip
    with _fit_folder() as fitted:
        with blamed_first(job.checks):
            found = fit_with_bar(take, fitted, work)
        if is_first_run and found.frames[0] == first.start:
            job = forwards(job)
        if is_first_run and (report := _tracked_before(job, found.actor)) is not None:
            warn(not_told(found.warnings, job.checks))
            return report
        return track_with_bar(replace(job, fitted=fitted), [*warnings, *found.warnings])


def track_given(job: TakeJob, remarks: Sequence[str] = (), *, is_first_run: bool) -> dict[str, Any]:
    """Track with the body and first poses of job.fitted, or else of the take, and print these remarks;
    is_first_run: as in fit_and_track."""
    record = read_record(job.fitted or job.take.folder / FIT_FOLDER)
    if is_first_run and (record is None or record.first_frame <= job.frames.start):
        job = forwards(job)
    actor = take_actor(job.take) if is_first_run and job.fitted is None else None
    if actor is not None and (report := _tracked_before(job, actor)) is not None:
        warn(not_told(remarks, job.checks))
        return report
    return track_with_bar(job, remarks)


def _tracked_before(job: TakeJob, actor: Actor) -> dict[str, Any] | None:
    """The run.json of this job's first run, if its results are there and the second run's journal too, and
    the take has not changed since; None if not."""
    if not journal_of(job.out).exists():
        return None
    segmenter = chosen_segmenter(job.take, job.segmenter)
    inputs = (job.take.folder / SETTINGS, *job.take.inputs(from_videos=segmenter != READY))
    try:
        found = load_result(job.out)
        made_by = chosen_segmenter(job.take, found.segmenter)
    except UserError:
        return None
    written_ns = (job.out / POSES).stat().st_mtime_ns
    if any(path.stat().st_mtime_ns > written_ns for path in inputs):
        return None
    asked = (actor, list(job.frames), job.search.model_dump(mode="json"), segmenter)
    settings = found.run.get("settings", {}).get("search")
    return found.run if asked == (found.actor, found.frames.tolist(), settings, made_by) else None


def track_again(
    job: TakeJob, silhouettes: TakeSilhouettes, report: dict[str, Any], *, is_asked_for: bool
) -> dict[str, Any]:
    """What follows the first run, whose report is given; returns the last run.json. is_asked_for: see
    _fitted_again."""
    report = _right_way_round(job, silhouettes, report)
    report = _fitted_again(job, silhouettes, report, is_asked_for=is_asked_for)
    right = _right_way_round(job, silhouettes, report)
    return report if right is report else _fitted_again(job, silhouettes, right, is_asked_for=is_asked_for)


def _right_way_round(job: TakeJob, silhouettes: TakeSilhouettes, report: dict[str, Any]) -> dict[str, Any]:
    """The report, or that of another run forwards if the actor faces the other way than in the results and
    take.toml says neither which way nor what the first pose is."""
    hints, found = job.take.settings.beginning_at(job.frames.start), None
    if hints.facing is None and not hints.initial_pose:
        with suppress(UserError):  # some frame shows nobody, or a mistake in the take
            found = fit_other_way_round(silhouettes, job.out, DEFAULT_REFINE_FRAMES, job.search)
    if found is None:
        return report
    say(f"{job.out}: {_TURNED}")
    with _fit_folder() as fitted:
        write_fit(job.take, found, fitted)
        return track_with_bar(forwards(replace(job, fitted=fitted, overlay=False)))


def _fitted_again(
    job: TakeJob, silhouettes: TakeSilhouettes, report: dict[str, Any], *, is_asked_for: bool
) -> dict[str, Any]:
    """Fit the actor to frames of the whole take, by the results in job.out, usually of a run forwards, and
    track again.

    Returns run.json. The body stays where that finds no better one, and where the results show it in too few
    frames: then a warning says so, or UserError is raised in the end if it is asked for.
    """
    before = read_actor(job.out / ACTOR)
    work = partial(
        refine_take, silhouettes, job.out, DEFAULT_REFINE_FRAMES, body=job.search.body,
        learns_colours=job.search.colour > 0,
    )  # fmt: skip
    with _fit_folder() as fitted:
        try:
            found = fit_with_bar(job.take, fitted, work)
        except UserError as error:
            if is_asked_for:
                _finish_with(before, job, report)
                raise
            warn([f"the body was not fitted again to the whole take: {error}"])
            return _finish_with(before, job, report)
        if found.actor == before and found.moved_take is None:
            say(_AS_IT_IS)
            return _finish_with(before, job, report)
        report = track_with_bar(replace(job, fitted=fitted), found.warnings)
    _say_what_changed(job, before, found.actor)
    return report


def _say_what_changed(job: TakeJob, before: Actor, after: Actor) -> None:
    """Say what the second fit made of the body of the first one."""
    if after.model_copy(update={"colours": before.colours}) == before:
        became = "were learnt" if after.colours else "cannot be told apart any more"
        say(f"{_AS_IT_IS}; the actor's colours {became}")
        return
    rows = zip(*(measure(build_body(actor.bare)) for actor in (before, after)), strict=True)
    was, now = max(rows, key=lambda pair: abs(pair[1].cm - pair[0].cm))
    changed = f"most changed: {was.name}, from {was.cm:.1f} to {now.cm:.1f} cm"
    command = shlex.join(["xormocap", "fit", str(job.take.folder), "--refine", str(job.out)])
    stored = f"{command} stores this body in the take"
    say(f"the body was fitted again, to frames of the whole take; {changed}; {stored}")


def _finish_with(actor: Actor, job: TakeJob, report: dict[str, Any]) -> dict[str, Any]:
    """The last run.json, with the actor of the first run: if that went forwards only, it is repeated both
    ways, and else what it did not draw is drawn."""
    if job.search.goes_both_ways and CORRECTED_FRAMES not in report:
        of_first = job.out / FIT_FOLDER
        with _fit_folder() as fitted:
            if job.fitted is None and of_first.exists() and read_actor(of_first / ACTOR) == actor:
                shutil.copytree(of_first, fitted, dirs_exist_ok=True)
                job = replace(job, fitted=fitted)
            return track_with_bar(job)
    made: tuple[FormatName, ...] = ("overlay", "report") if job.overlay else ()
    write_defaults(job.out, load_result(job.out), made, lambda sentence: warn([sentence]))
    return report
