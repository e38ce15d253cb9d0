"""`xormocap track`: tracks a recorded take."""

import tempfile
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from proto.streams import stream_endpoint
from services import options
from services.address import LOOPBACK
from services.commands.actor_in_view import in_view
from services.commands.checks import CheckOption, check_files, compare_cameras, look_before
from services.commands.consoles import TakeFolder, say, stderr, stdout, warn
from services.commands.fit import MeshOption
from services.commands.fitted_runs import fit_and_track, track_again, track_given
from services.commands.short_help import HelpAllOption
from services.commands.view import DEFAULT_PORT, PortOption, StrictOption, ViewOption, conclude, tell_page
from services.mocap.energy.engine import check_cost
from services.mocap.errors import UserError
from services.mocap.result.layout import CORRECTED_FRAMES, RUN_JSON
from services.mocap.result.result import load_result
from services.mocap.result.words import ENERGY_IN_WORDS, accuracy_in_words, rate_in_words
from services.mocap.search.overrides import search_settings
from services.mocap.take.actor_file import take_actor
from services.mocap.take.fit_record import FIT_FOLDER, was_refined
from services.mocap.take.folder import open_take
from services.recorder.result_folder import check_out
from services.runs.fit import init_frames
from services.runs.launcher import fork_server
from services.runs.take_silhouettes import TakeSilhouettes
from services.runs.track import TakeJob
from services.segmentation.segmenters import chosen_segmenter

IN_HELP = ("out", "frames", "refine", "watch", "port", "strict")
"""The options that --help shows."""
_WORTH_REFINING = 3
"""A second run is worth it from so many times init_frames (or ten) on."""


def track(
    take: TakeFolder,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; results/<take> by default.")
    ] = None,
    workers: options.WorkersOption = 4,
    frames: options.FramesOption = ":",
    overlay: Annotated[bool, typer.Option(help="Write overlay.mp4.")] = True,
    backend: options.BackendOption = options.DEFAULT_ENGINE.backend,
    threads: options.ThreadsOption = options.DEFAULT_ENGINE.threads,
    preset: options.SearchOption = "default",
    body: options.BodyOption = None,
    changes: options.SetOption = None,
    settings: options.SettingsOption = None,
    fit_first: Annotated[
        bool,
        typer.Option(
            "--fit/--no-fit",
            help="If the take has no actor.toml: fit the actor, or only scale the generic body. With "
            "--no-fit a stored body stays as it is.",
        ),
    ] = True,
    fitted: options.FittedOption = None,
    mesh: MeshOption = None,
    refine: Annotated[
        bool | None,
        typer.Option(
            "--refine/--no-refine",
            help="Track forwards, fit the body again to frames of the whole take, and track again. Default: "
            "if the body was fitted to the first frames only, and the take is long enough.",
        ),
    ] = None,
    smooth: options.SmoothOption = options.DEFAULT_OUTPUT.smooth,
    cutoff_hz: options.CutoffOption = None,
    segmenter: options.SegmenterOption = options.DEFAULT_SEGMENTER,
    watch: ViewOption = False,
    port: PortOption = DEFAULT_PORT,
    check: CheckOption = True,
    strict: StrictOption = False,
    endpoint: Annotated[
        str | None,
        typer.Option(help="Address of the coordinator, for xormocap status; free ports by default."),
    ] = None,
    _help_all: HelpAllOption = False,
) -> None:
    """Track a recorded take: write poses, joints, motion files and an overlay video."""
    if mesh is not None and (fitted is not None or not fit_first):
        raise UserError("--mesh: a mesh is fitted first: leave out --fitted and --no-fit, or --mesh")
    folder = out or Path("results") / take.resolve().name
    check_out(folder)
    if endpoint is not None:
        stream_endpoint(endpoint, "tasks")  # a mistake is told at once
    if watch:
        port = tell_page(port)
    opened = open_take(take)
    warn(opened.remarks)
    engine = options.engine_settings(backend, threads)
    chosen_segmenter(opened, segmenter)  # raises UserError if it does not suit the take
    job = TakeJob(
        take=opened,
        out=folder,
        page=f"{LOOPBACK}:{port}" if watch else None,
        frames=opened.frame_range(frames),
        workers=workers,
        overlay=overlay,
        engine=engine,
        search=search_settings(changes or [], settings, len(opened.cameras), preset, body),
        fitted=fitted,
        output=options.output_settings(smooth, cutoff_hz),
        segmenter=segmenter,
        endpoint=endpoint,
    )
    check_cost(engine, job.search.cost)
    _warn_of_older(folder, len(job.frames))
    with tempfile.TemporaryDirectory(prefix="xormocap-silhouettes-") as kept, ExitStack() as stack:
        silhouettes = TakeSilhouettes(opened, segmenter, Path(kept))
        if check:
            job = _checked(job, silhouettes)
        fits, again = _steps(job, fits_mesh=mesh is not None, fit_first=fit_first, refine=refine)
        say(ENERGY_IN_WORDS, stderr)  # which the bars show
        if again:
            _ = silhouettes.remarks  # a service that reads what was learnt remarks nothing
            job = replace(job, kept=Path(kept))
        forks = fork_server(job.kinds, Path(kept))  # it loads code while the actor is fitted
        if forks is not None:
            job = replace(job, forks=stack.enter_context(closing(forks)))
        first = replace(job, overlay=overlay and not again)  # it would be drawn twice
        if fits:
            report = fit_and_track(first, silhouettes, mesh, is_first_run=again)
        else:
            report = track_given(first, silhouettes.remarks if again else (), is_first_run=again)
        if again:
            report = track_again(job, silhouettes, report, is_asked_for=refine is True)
    _summarise(report, job.out)
    conclude(job.out, take, port if watch else None, strict=strict)


def _warn_of_older(folder: Path, n_frames: int) -> None:
    """Warn where this run replaces results of more frames."""
    with suppress(UserError):  # there are none, or nothing of worth
        n_older = len(load_result(folder).frames) if (folder / RUN_JSON).exists() else 0
        if n_older > n_frames:
            warn([f"{folder}: results of {n_older} frames are there, which those of {n_frames} will replace"])


def _checked(job: TakeJob, silhouettes: TakeSilhouettes) -> TakeJob:
    """The job from the first frame on that shows the actor, with what its checks found; raises TakeError
    where it is certain that the take cannot be tracked."""
    check_files(silhouettes)
    compared = compare_cameras(silhouettes, job.frames)
    job = replace(job, frames=in_view(silhouettes, job.frames))
    return replace(job, checks=look_before(silhouettes, job.frames, compared))


def _steps(job: TakeJob, *, fits_mesh: bool, fit_first: bool, refine: bool | None) -> tuple[bool, bool]:
    """Whether a body is fitted first, and whether it is fitted again, to the whole take, and tracked again.

    fit_first, refine: of the command line.
    """
    actor = take_actor(job.take) if job.fitted is None else None
    fits = fits_mesh or (job.fitted is None and fit_first and actor is None)
    if refine is not None:
        return fits, refine
    is_rough = fits
    if fit_first and not fits_mesh and actor is not None:
        is_rough = was_refined(job.take.folder / FIT_FOLDER, actor) is False
    return fits, is_rough and len(job.frames) >= _WORTH_REFINING * len(init_frames(job.take))


def _summarise(report: dict[str, Any], folder: Path) -> None:
    speed, table = report["speed"], Table(show_header=False, box=None)
    table.add_row("frames", f"{report['take']['frames']}")
    table.add_row(
        "tracked at",
        f"{rate_in_words(speed['frames_per_s'])}, after {speed['first_frame_s']:.1f} s for the first",
    )
    if corrected := corrected_in_words(report):
        table.add_row("corrected on the way back", corrected)
    table.add_row("evaluations per frame", f"{speed['evaluations_per_frame']:.0f}")
    if "accuracy" in report:
        table.add_row("joint error", accuracy_in_words(report["accuracy"]))
        table.add_row("lost limbs", f"{len(report['accuracy']['lost_limbs'])}")
    table.add_row("results", escape(str(folder)))
    stdout.print(table)


def corrected_in_words(report: dict[str, Any]) -> str:
    """Which parts of settled poses moved, from a run.json; empty for none."""
    corrected: dict[str, int] = report.get(CORRECTED_FRAMES, {})
    return ", ".join(
        f"{part.replace('_', ' ')} in {n} frame{'' if n == 1 else 's'}" for part, n in corrected.items()
    )
