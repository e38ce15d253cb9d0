"""`xormocap live`: tracks live cameras."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.live import Live
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from proto.messages import DROPPED_BY
from services import options
from services.address import LOOPBACK
from services.commands.consoles import say, stderr, stdout, warn
from services.commands.track import corrected_in_words
from services.commands.view import DEFAULT_PORT, PortOption, StrictOption, ViewOption, conclude, tell_page
from services.mocap.energy.engine import check_cost
from services.mocap.errors import TakeError, UserError, nearest
from services.mocap.motion.settings import Smoother
from services.mocap.result.words import accuracy_in_words, rate_in_words
from services.mocap.search.overrides import search_settings
from services.mocap.take.actor_file import take_actor
from services.mocap.take.fit_record import read_colour_tables, read_record
from services.mocap.take.live import LiveTake, open_live
from services.mocap.take.moved_cameras import moves_in_words
from services.recorder.result_folder import check_out
from services.runs.live import LiveJob, fit_of_actor, serve_group
from services.runs.live import live as track_live
from services.runs.progress import Progress, live_in_words
from services.segmentation.live.availability import check_sources

_SMOOTHER: Smoother = "one-euro"


def live(
    config: Annotated[Path, typer.Argument(help="A TOML file that lists the cameras.", metavar="CONFIG")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; results/<name> by default.")
    ] = None,
    workers: options.WorkersOption = 1,
    record: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Store the cameras' pictures as a take in this folder."),
    ] = None,
    backend: options.BackendOption = options.DEFAULT_ENGINE.backend,
    threads: options.ThreadsOption = options.DEFAULT_ENGINE.threads,
    preset: options.SearchOption = "default",
    body: options.BodyOption = None,
    changes: options.SetOption = None,
    settings: options.SettingsOption = None,
    smooth: options.SmoothOption = _SMOOTHER,
    cutoff_hz: options.CutoffOption = None,
    segmenter: options.SegmenterOption = options.DEFAULT_SEGMENTER,
    watch: ViewOption = False,
    port: PortOption = DEFAULT_PORT,
    group: Annotated[
        str | None, typer.Option(help="Serve only this group of cameras, for a coordinator on another host.")
    ] = None,
    keys: options.KeysOption = None,
    strict: StrictOption = False,
) -> None:
    """Track live cameras until Ctrl-C: publish poses as they are found, and write results at the end."""
    take = open_live(config)
    folder = out or Path("results") / take.settings.name
    groups = _groups_to_serve(config, take, group, record)
    if group is None:
        check_out(folder)
    watch = watch and group is None
    if watch:
        port = tell_page(port)
    warn(check_sources(take, take.cameras_of(groups)))
    engine, output = options.engine_settings(backend, threads), options.output_settings(smooth, cutoff_hz)
    search = search_settings(changes or [], settings, len(take.cameras), preset, body)
    check_cost(engine, search.cost)
    job = LiveJob(
        config=config.resolve(),
        take=take,
        out=folder,
        workers=workers,
        engine=engine,
        search=search,
        output=output,
        segmenter=segmenter,
        page=f"{LOOPBACK}:{port}" if watch else None,
        record=record,
        keys=keys,
        fit=_fit(take, group),
    )
    if group is not None:
        serve_group(job, group)
        return
    say(body_in_words(take, job.fit, with_colours=search.colour > 0), stderr)
    report = _track(job)
    _summarise(report, folder, record)
    conclude(folder, record, port if watch else None, strict=strict)


def _fit(take: LiveTake, group: str | None) -> Path | None:
    """The fit of the actor, if any (fit_of_actor); a host that only serves cameras does without one that
    cannot be used."""
    try:
        folder = fit_of_actor(take)
        record = None if folder is None else read_record(folder)
    except TakeError as problem:
        if group is None:
            raise
        warn([f"{problem}; cameras are served without the actor's colours"])
        return None
    if record is not None and record.moved:
        sentence = moves_in_words(record.moved, len(take.calibrated))
        warn([f"{folder}: {sentence}: live tracking uses this calibration as it is: calibrate again"])
    return folder


def _groups_to_serve(config: Path, take: LiveTake, group: str | None, record: Path | None) -> list[str]:
    """The groups of cameras that are read on this host; raises UserError where options do not fit them."""
    if group is None:
        if record is not None and not take.groups_here:
            raise UserError(
                f"--record {record}: {config} has no camera of this host: give --record with --group where "
                "the cameras are"
            )
        return take.groups_here
    if group not in (known := sorted(take.groups())):
        raise UserError(f"--group {group}: {config} has no such group: {nearest(group, known)}")
    return [group]


def _track(job: LiveJob) -> dict[str, Any]:
    """Track with a progress line; warnings are printed at the end."""
    warnings: list[str] = []
    try:
        with Live(Text("starting"), console=stderr, refresh_per_second=4) as line:

            def show(progress: Progress) -> None:
                line.update(Text(live_in_words(progress)))

            return track_live(job, show=show, warn=warnings.append)
    finally:
        warn(warnings)


def _colours_in_words(take: LiveTake, fit: Path | None) -> str:
    """Whether the actor's colours count, in words."""
    known = {} if fit is None else read_colour_tables(fit, take.cameras)
    return " with its colours" if known else ", not its colours: no fit beside it saw them with these cameras"


def body_in_words(take: LiveTake, fit: Path | None, *, with_colours: bool) -> str:
    """The body that is tracked, in a sentence."""
    actor = take_actor(take)
    if actor is not None:
        return f"body: {take.actor_path}" + (
            _colours_in_words(take, fit) if actor.colours and with_colours else ""
        )
    if take.live.actor_height is not None:
        return f"body: the generic one, scaled to {take.live.actor_height:.2f} m (actor_height)"
    return "body: the generic one, scaled to the first person in view: actor_height or actor is better"


def _summarise(report: dict[str, Any], folder: Path, record: Path | None) -> None:
    live_part, speed, table = report["live"], report["speed"], Table(show_header=False, box=None)
    latency_s, shots = live_part["latency_s"], live_part["shots"]
    table.add_row("poses", f"{shots['solved']} of {shots['last'] - shots['first'] + 1} shots")
    table.add_row("tracked at", rate_in_words(report["take"]["fps"]))
    table.add_row(
        "latency", f"median {1000 * latency_s['median']:.0f} ms, 95 % below {1000 * latency_s['p95']:.0f} ms"
    )
    if settled_s := live_part.get("settled_latency_s"):
        table.add_row(
            "settled after",
            f"median {settled_s['median']:.2f} s, 95 % within {settled_s['p95']:.2f} s; "
            f"corrected: {corrected_in_words(report) or 'nothing'}",
        )
    if (abreast := live_part["abreast"]) is not None and abreast["poses_before"]:
        since_ms = [1000 * abreast["latency_s"][name] for name in ("median", "p95")]
        table.add_row(
            "caught up",
            f"after {abreast['after_s']:.1f} s; since then median {since_ms[0]:.0f} ms, "
            f"95 % below {since_ms[1]:.0f} ms",
        )
    table.add_row("first pose", f"{speed['first_frame_s']:.1f} s")
    for where in DROPPED_BY:
        drops = {name: counts[where] for name, counts in live_part.get("drops", {}).items()}
        same = len(set(drops.values())) <= 1
        by_camera = escape(", ".join(f"{name} {count}" for name, count in drops.items()))
        table.add_row(f"dropped by {where}", f"{max(drops.values(), default=0)}" if same else by_camera)
    if "accuracy" in report:
        table.add_row("joint error", accuracy_in_words(report["accuracy"]))
    table.add_row("results", escape(str(folder)))
    if record is not None:
        table.add_row("take", escape(str(record)))
    stdout.print(table)
