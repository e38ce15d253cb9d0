"""The `xormocap` command."""

import signal
import sys
import tempfile
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from services import doctor as machine
from services.bridge.__main__ import bridge
from services.calibrate import calibrate
from services.export import export
from services.fit import init_frames, kept_warnings
from services.fit_files import origin_of
from services.fit_show import fit_with_bar, show_fit
from services.health import main as ask_health
from services.keys import app as keys_app
from services.launcher import ServiceFailedError
from services.live_command import live_command
from services.mocap.body.body_mesh import OwnMesh
from services.mocap.body.own_mesh.importing import import_mesh
from services.mocap.energy.engine import check_cost
from services.mocap.errors import UserError
from services.mocap.search.overrides import search_settings
from services.mocap.search.settings import SearchSettings
from services.mocap.synth.take import write_synthetic_take
from services.mocap.take.actor_file import check_place, take_actor, write_actor
from services.mocap.take.fit_record import FIT_FOLDER
from services.mocap.take.folder import open_take
from services.mocap.take.frame_range import frame_range
from services.mocap.take.layout import ACTOR
from services.process import (
    DEFAULT_ENGINE,
    DEFAULT_OUTPUT,
    DEFAULT_SEGMENTER,
    EXIT_STOPPED,
    EXIT_USER_ERROR,
    BackendOption,
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
from services.progress import Progress as Run
from services.recorder.result_folder import check_out
from services.segmentation.files import write_silhouettes
from services.segmentation.segmenters import chosen_segmenter
from services.status import status
from services.sync import sync
from services.track import Interrupted, Job
from services.track import track as track_take
from services.view import DEFAULT_PORT, PortOption, ViewOption, tell_page, view

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Markerless motion capture from silhouettes of calibrated cameras.",
)
app.add_typer(keys_app, name="keys")
app.command()(export)
app.command()(view)
app.command()(calibrate)
app.command()(sync)
app.command()(status)
app.command()(bridge)
app.command("live")(live_command)
out_console, err_console = Console(), Console(stderr=True)
_STATE_WORDS = {
    machine.State.OK: "[green]ok[/]",
    machine.State.HINT: "[yellow]hint[/]",
    machine.State.MISSING: "[red]missing[/]",
}

MeshOption = Annotated[
    Path | None,
    typer.Option(help="Fit this mesh: a skinned character (.glb) or 16 named parts (.obj, .glb)."),
]
TakeFolder = Annotated[Path, typer.Argument(help="The take folder.", metavar="TAKE")]


@app.command()
def track(
    take: TakeFolder,
    out: Annotated[Path | None, typer.Option(help="Where the results go; results/<take> by default.")] = None,
    workers: Annotated[int, typer.Option(min=0, max=64, help="Limb worker processes.")] = 4,
    frames: Annotated[str, typer.Option(help="Only frames A up to but not including B, as A:B.")] = ":",
    overlay: Annotated[bool, typer.Option(help="Write overlay.mp4 too.")] = True,
    backend: BackendOption = DEFAULT_ENGINE.backend,
    threads: ThreadsOption = DEFAULT_ENGINE.threads,
    preset: SearchOption = "default",
    changes: SetOption = None,
    settings: SettingsOption = None,
    fit_first: Annotated[
        bool,
        typer.Option("--fit/--no-fit", help="Where the take has no actor.toml: fit the actor, or scale one."),
    ] = True,
    fitted: Annotated[
        Path | None, typer.Option(help="A folder of xormocap fit: its actor and poses, not the take's.")
    ] = None,
    mesh: MeshOption = None,
    smooth: SmoothOption = DEFAULT_OUTPUT.smooth,
    cutoff_hz: CutoffOption = None,
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
    watch: ViewOption = False,
    port: PortOption = DEFAULT_PORT,
    endpoint: Annotated[
        str | None,
        typer.Option(help="Where the coordinator listens, for xormocap status; free ports by default."),
    ] = None,
) -> None:
    """Turn a recorded take into a skeleton motion: poses, joints, BVH and an overlay video."""
    engine, output = engine_settings(backend, threads), output_settings(smooth, cutoff_hz)
    opened = open_take(take)
    asked = frame_range(frames, opened)
    chosen_segmenter(opened, segmenter)
    search = search_settings(changes or [], settings, len(opened.cameras), preset)
    check_cost(engine, search.cost)
    folder = out or Path("results") / take.resolve().name
    check_out(folder)
    warnings: list[str] = []
    watch_at = tell_page(port, err_console) if watch else None
    with tempfile.TemporaryDirectory(prefix="xormocap-fit-") as temporary:
        if mesh is not None and (fitted is not None or not fit_first):
            raise UserError("--mesh: is fitted first: leave out --fitted and --no-fit, or leave out --mesh")
        if mesh is not None or (fitted is None and fit_first and take_actor(opened) is None):
            fitted, own = Path(temporary), _import(mesh, warnings)
            found = fit_with_bar(
                opened, init_frames(opened), engine, search, fitted, err_console, own, segmenter
            )
            warnings += [_why_fitted(take, mesh), *found.warnings]
        job = Job(
            opened,
            folder,
            asked,
            workers,
            overlay,
            engine,
            search,
            fitted,
            output,
            segmenter,
            watch_at,
            endpoint,
        )
        report = _track(job, warnings)
    _warn(warnings)
    _summarise(report, folder)
    if watch:
        view(folder, take, port)


def _import(mesh: Path | None, warnings: list[str]) -> OwnMesh | None:
    """The own mesh of a file, if one was given; adds to the warnings."""
    if mesh is None:
        return None
    imported = import_mesh(mesh)
    warnings += imported.remarks
    return imported.mesh


def _why_fitted(take: Path, mesh: Path | None) -> str:
    if mesh is None:
        return f"{take}: has no actor.toml: fitted one for this run; xormocap fit {take} puts one there"
    return f"{mesh}: was fitted for this run; xormocap fit {take} --mesh {mesh} keeps it in the take"


def _track(job: Job, warnings: list[str]) -> dict[str, Any]:
    """Track with a progress bar; returns run.json, adds to the warnings."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed}/{task.total} frames"),
    )
    speed = (
        TextColumn("{task.fields[fps]:.1f} fps  energy {task.fields[energy]:.0f} px"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, *speed, console=err_console) as bar:
        task = bar.add_task("starting", total=len(job.frames), fps=0.0, energy=0.0)

        def show(run: Run) -> None:
            bar.update(
                task,
                completed=run.frames_done,
                fps=run.frames_per_s,
                energy=run.energy_px,
                description=run.stage,
            )

        try:
            return track_take(job, show=show, warn=warnings.append)
        except Interrupted as stopped:
            done = (
                f"what was tracked by then is in {stopped.folder}; the same command goes on from there"
                if stopped.folder
                else "nothing was tracked"
            )
            _fail(f"stopped; {done}", 130)


def _warn(sentences: list[str]) -> None:
    for sentence in dict.fromkeys(sentences):  # a fit and a run may say the same
        err_console.print(f"warning: {sentence}", style="yellow", markup=False, soft_wrap=True)


def _summarise(report: dict[str, Any], folder: Path) -> None:
    speed, table = report["speed"], Table(show_header=False, box=None)
    table.add_row("frames", f"{report['take']['frames']}")
    table.add_row(
        "frames per second",
        f"{speed['frames_per_s']:.2f}, after {speed['first_frame_s']:.1f} s for the first",
    )
    table.add_row("evaluations per frame", f"{speed['evaluations_per_frame']:.0f}")
    if "accuracy" in report:
        accuracy = report["accuracy"]
        table.add_row(
            "joint error", f"mean {accuracy['mean_mm']:.1f} mm, 95 % below {accuracy['p95_mm']:.1f} mm"
        )
        table.add_row("lost limbs", f"{len(accuracy['lost_limbs'])}")
    if report["trust"]["lowest_confidence"]:  # else nothing was judged
        table.add_row("frames not to be trusted", f"{report['trust']['distrusted_frames']}")
    table.add_row("results", escape(str(folder)))
    out_console.print(table)


@app.command()
def fit(
    take: TakeFolder,
    out: Annotated[
        Path | None, typer.Option(help="Where actor.toml and pictures go; into the take by default.")
    ] = None,
    frames: Annotated[
        int | None, typer.Option(min=1, help="How many of the first frames; init_frames by default.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an actor.toml made by hand.")] = False,
    mesh: MeshOption = None,
    backend: BackendOption = DEFAULT_ENGINE.backend,
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
) -> None:
    """Fit the actor's shape and first poses to a take's first frames, and show how well that went."""
    opened = open_take(take)
    actor_toml = (out or take) / ACTOR
    check_place(actor_toml, force)
    folder = out or take / FIT_FOLDER
    engine, search = engine_settings(backend, DEFAULT_ENGINE.threads), SearchSettings()
    warnings: list[str] = []
    own = _import(mesh, warnings)
    found = fit_with_bar(
        opened, init_frames(opened, frames), engine, search, folder, err_console, own, segmenter
    )
    if out is None:
        write_actor(actor_toml, found.actor, origin_of(opened, found))
    _warn([*warnings, *found.warnings])
    show_fit(found, opened, folder, out_console)


@app.command()
def synth(
    out: Annotated[Path, typer.Argument(help="The take folder to make.")],
    motion: Annotated[
        str, typer.Option(help="walk, basic (slow), dance (fast), or a BVH file.", metavar="MOTION")
    ] = "walk",
    frames: Annotated[
        int | None,
        typer.Option(
            help="How many frames; 4 s of walk, 26.7 s of basic and dance, all of a file by default."
        ),
    ] = None,
    start: Annotated[float, typer.Option(help="Seconds of a BVH file to leave out at its beginning.")] = 0.0,
    fps: Annotated[float, typer.Option(help="Frames per second.")] = 15.0,
    height: Annotated[float, typer.Option(help="The actor's height in metres.")] = 1.75,
    cameras: Annotated[int, typer.Option(help="How many cameras.")] = 8,
    seed: Annotated[
        int, typer.Option(help="Another number gives another room, noise, and variant of basic and dance.")
    ] = 0,
) -> None:
    """Make a synthetic take with known poses: an actor who moves before a ring of cameras."""
    with Progress(console=err_console) as bar:
        task = bar.add_task("drawing", total=frames)

        def show(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        made = write_synthetic_take(
            out,
            motion=motion,
            n_frames=frames,
            start_s=start,
            fps=fps,
            seed=seed,
            height_m=height,
            n_cameras=cameras,
            progress=show,
        )
    words = f"{out}: {len(made.poses)} frames of {cameras} cameras"
    if made.joint_error_m is not None:
        words += f", joints {1e3 * made.joint_error_m:.1f} mm from the file's in the mean"
    out_console.print(words, markup=False, highlight=False)


@app.command()
def segment(
    take: TakeFolder,
    out: Annotated[Path, typer.Option(help="Where the silhouettes go.")],
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
) -> None:
    """Write the silhouettes of a take's videos, as they are and not undistorted, for a take of their own."""
    opened = open_take(take)
    with kept_warnings() as warnings, Progress(console=err_console) as bar:
        task = bar.add_task("segmenting", total=opened.settings.frames * len(opened.cameras))
        write_silhouettes(opened, out, lambda: bar.advance(task), segmenter)
    _warn(warnings)
    out_console.print(
        f"{out}/<camera>/000000.png: {opened.settings.frames} frames of {len(opened.cameras)} cameras"
    )


@app.command()
def doctor() -> None:
    """Say what this machine has, and what is missing."""
    table = Table(show_header=False, box=None)
    checks = machine.examine()
    for check in checks:
        table.add_row(_STATE_WORDS[check.state], check.name, escape(check.finding))
    out_console.print(table)
    if any(check.state is machine.State.MISSING for check in checks):
        sys.exit(1)


@app.command()
def health() -> None:
    """Ask the service whose socket XORMOCAP_HEALTH names whether it works, as a container's probe does."""
    ask_health()


def _fail(sentence: str, code: int) -> NoReturn:
    err_console.print(sentence, style="red", markup=False, highlight=False, soft_wrap=True)
    sys.exit(code)


def main() -> None:
    """Run the command; errors of the user's end in one sentence and exit code 2."""
    signal.signal(
        signal.SIGTERM, lambda *_: sys.exit(EXIT_STOPPED)
    )  # unwinds, so that nothing half-made stays
    try:
        app()
    except UserError as error:
        _fail(str(error), EXIT_USER_ERROR)
    except ServiceFailedError as error:
        _fail(str(error), 1)


if __name__ == "__main__":
    main()
