"""`xormocap track`: tracks a recorded take."""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from services.commands.consoles import TakeFolder, say, stderr, stdout, warn
from services.commands.fit import EVERY_CORE, MeshOption, fit_with_bar, imported
from services.commands.view import DEFAULT_PORT, PortOption, ViewOption, tell_page, view
from services.mocap.body.actor import build_body
from services.mocap.body.measures import measure
from services.mocap.energy.engine import check_cost
from services.mocap.errors import UserError
from services.mocap.export.formats import FormatName, write_defaults
from services.mocap.result.result import load_result
from services.mocap.search.overrides import search_settings
from services.mocap.take.actor_file import read_actor, take_actor
from services.mocap.take.folder import open_take
from services.mocap.take.layout import ACTOR
from services.options import (
    DEFAULT_ENGINE,
    DEFAULT_OUTPUT,
    DEFAULT_SEGMENTER,
    BackendOption,
    BodyOption,
    CutoffOption,
    SearchOption,
    SegmenterOption,
    SetOption,
    SettingsOption,
    SmoothOption,
    ThreadsOption,
    engine_settings,
    output_settings,
)
from services.recorder.result_folder import check_out
from services.runs.fit import Show, TakeFit, fit_take, init_frames
from services.runs.progress import Progress as Run
from services.runs.refine import DEFAULT_REFINE_FRAMES, refine_take
from services.runs.track import TakeJob
from services.runs.track import track as track_take
from services.segmentation.segmenters import chosen_segmenter

_WORTH_REFINING = 3
"""Frames tracked over frames that the body was fitted to from which more of them are worth a second run."""


def track(
    take: TakeFolder,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; results/<take> by default.")
    ] = None,
    workers: Annotated[int, typer.Option(min=0, max=64, help="Number of limb worker processes.")] = 4,
    frames: Annotated[str, typer.Option(help="Range of frames A:B, from A up to but not including B.")] = ":",
    overlay: Annotated[bool, typer.Option(help="Write overlay.mp4.")] = True,
    backend: BackendOption = DEFAULT_ENGINE.backend,
    threads: ThreadsOption = DEFAULT_ENGINE.threads,
    preset: SearchOption = "default",
    body: BodyOption = None,
    changes: SetOption = None,
    settings: SettingsOption = None,
    fit_first: Annotated[
        bool,
        typer.Option(
            "--fit/--no-fit",
            help="If the take has no actor.toml: fit the actor, or only scale the generic body.",
        ),
    ] = True,
    fitted: Annotated[
        Path | None,
        typer.Option(help="A folder written by xormocap fit, used instead of the take's actor and poses."),
    ] = None,
    mesh: MeshOption = None,
    refine: Annotated[
        bool | None,
        typer.Option(
            "--refine/--no-refine",
            help="Afterwards fit the body again, to frames of the whole take, and track again; by default if "
            "this run fitted it and the take is long enough.",
        ),
    ] = None,
    smooth: SmoothOption = DEFAULT_OUTPUT.smooth,
    cutoff_hz: CutoffOption = None,
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
    watch: ViewOption = False,
    port: PortOption = DEFAULT_PORT,
    endpoint: Annotated[
        str | None,
        typer.Option(help="Address of the coordinator, for xormocap status; free ports by default."),
    ] = None,
) -> None:
    """Track a recorded take: write poses, joints, motion files and an overlay video."""
    if mesh is not None and (fitted is not None or not fit_first):
        raise UserError("--mesh: a mesh is fitted first: leave out --fitted and --no-fit, or --mesh")
    opened = open_take(take)
    engine = engine_settings(backend, threads)
    job = TakeJob(
        take=opened,
        out=out or Path("results") / take.resolve().name,
        frames=opened.frame_range(frames),
        workers=workers,
        overlay=overlay,
        engine=engine,
        search=search_settings(changes or [], settings, len(opened.cameras), preset, body),
        fitted=fitted,
        output=output_settings(smooth, cutoff_hz),
        segmenter=segmenter,
        endpoint=endpoint,
    )
    chosen_segmenter(opened, segmenter)
    check_cost(engine, job.search.cost)
    check_out(job.out)
    job = replace(job, page=tell_page(port) if watch else None)
    fits = mesh is not None or (fitted is None and fit_first and take_actor(opened) is None)
    enough = _WORTH_REFINING * len(init_frames(opened))
    again = refine if refine is not None else fits and len(job.frames) >= enough
    first = replace(job, overlay=overlay and not again)  # it would be drawn twice
    report = _fit_and_track(first, *_first_fit(first, mesh)) if fits else _track(first, [])
    if again:
        report = _again(job, report, is_asked_for=refine is True)
    _summarise(report, job.out)
    if watch:
        view(job.out, take, port)


def _first_fit(job: TakeJob, mesh: Path | None) -> tuple[Callable[[Show], TakeFit], list[str]]:
    """What fits the actor to the first frames of a take, and warnings."""
    warnings: list[str] = []
    own, take = imported(mesh, warnings), job.take
    command = f"xormocap fit {take.folder}"
    if mesh is None:
        warnings.append(
            f"{take.folder}: has no actor.toml: fitted one for this run; {command} puts one there"
        )
    else:
        warnings.append(f"{mesh}: was fitted for this run; {command} --mesh {mesh} keeps it in the take")
    engine = job.engine.model_copy(update={"threads": EVERY_CORE})
    frames, segmenter = init_frames(take), job.segmenter
    return partial(fit_take, take, frames, engine, job.search, mesh=own, segmenter=segmenter), warnings


def _again(job: TakeJob, report: dict[str, Any], is_asked_for: bool) -> dict[str, Any]:
    """Fit the actor to frames of the whole take, by the results in job.out, and track again.

    Returns run.json. If the results have too few frames without a mark, they stay, and a warning says why;
    UserError if it is asked for.
    """
    varied, before = job.search.body, read_actor(job.out / ACTOR)
    fit = partial(refine_take, job.take, job.out, DEFAULT_REFINE_FRAMES, segmenter=job.segmenter, body=varied)
    with tempfile.TemporaryDirectory(prefix="xormocap-fit-") as temporary:
        try:
            found = fit_with_bar(job.take, Path(temporary), fit)
        except UserError as error:
            if is_asked_for:
                raise
            warn([f"the body was not fitted again to the whole take: {error}"])
            made: tuple[FormatName, ...] = ("overlay", "report") if job.overlay else ()
            write_defaults(job.out, load_result(job.out), made, lambda sentence: warn([sentence]))
            return report
        report = _track(replace(job, fitted=Path(temporary)), found.warnings)
    rows = zip(*(measure(build_body(actor)) for actor in (before, read_actor(job.out / ACTOR))), strict=True)
    was, now = max(rows, key=lambda pair: abs(pair[1].cm - pair[0].cm))
    changed = f"most changed: {was.name}, from {was.cm:.1f} to {now.cm:.1f} cm"
    say(f"the body was fitted again, to frames of the whole take; {changed}", stdout)
    return report


def _fit_and_track(job: TakeJob, work: Callable[[Show], TakeFit], warnings: list[str]) -> dict[str, Any]:
    """Fit an actor for this run only, then track; returns run.json."""
    with tempfile.TemporaryDirectory(prefix="xormocap-fit-") as temporary:
        found = fit_with_bar(job.take, Path(temporary), work)
        return _track(replace(job, fitted=Path(temporary)), [*warnings, *found.warnings])


def _track(job: TakeJob, warnings: list[str]) -> dict[str, Any]:
    """Track with a progress bar; returns run.json. Prints these warnings and the run's at the end."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed}/{task.total} frames"),
        TextColumn("{task.fields[fps]:.1f} fps  energy {task.fields[energy]:.0f} px"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=stderr) as bar:
        task = bar.add_task("starting", total=len(job.frames), fps=0.0, energy=0.0)

        def show(run: Run) -> None:
            bar.update(
                task,
                completed=run.frames_done,
                fps=run.frames_per_s,
                energy=run.energy_px,
                description=run.stage,
            )

        report = track_take(job, show=show, warn=warnings.append)
    warn(warnings)
    return report


def _summarise(report: dict[str, Any], folder: Path) -> None:
    speed, table = report["speed"], Table(show_header=False, box=None)
    table.add_row("frames", f"{report['take']['frames']}")
    table.add_row(
        "frames per second",
        f"{speed['frames_per_s']:.2f}, after {speed['first_frame_s']:.1f} s for the first",
    )
    table.add_row("evaluations per frame", f"{speed['evaluations_per_frame']:.0f}")
    if "accuracy" in report:
        table.add_row("joint error", accuracy_in_words(report["accuracy"]))
        table.add_row("lost limbs", f"{len(report['accuracy']['lost_limbs'])}")
    if report["trust"]["lowest_confidence"]:  # else nothing was judged
        table.add_row("unreliable frames", f"{report['trust']['distrusted_frames']}")
    table.add_row("results", escape(str(folder)))
    stdout.print(table)


def accuracy_in_words(accuracy: dict[str, Any]) -> str:
    """The joint error of a run.json."""
    return f"mean {accuracy['mean_mm']:.1f} mm, 95 % below {accuracy['p95_mm']:.1f} mm"
