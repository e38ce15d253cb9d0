"""The command line of the measurements."""

import json
import shlex
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from rich.console import Console
from rich.table import Table

from bench import accuracy as accuracies
from bench import (
    actor_tables,
    first_view,
    page_cost,
    people_tables,
    pose_prior,
    reliability,
    settings_sweep,
    typical_poses,
)
from bench import actors as actor_fits
from bench import confidence as lost_parts
from bench import people as other_people
from bench import segmentation as silhouettes
from bench import table2 as frame_times
from bench.candidates import Candidates, Name
from bench.machine import Machine, this_machine
from bench.options import (
    FramesOption,
    JsonOption,
    KeptOption,
    SeedsOption,
    StudioOption,
    TakesArgument,
    TrackOption,
    WorkersOption,
    given_takes,
    studio_takes,
    writable,
)
from bench.problems import Setup
from bench.random_bodies import Variety
from bench.table1 import Row, as_table, measure
from bench.takes import take_folder
from services.mocap.errors import UserError
from services.mocap.search.settings import Preset

app = typer.Typer(no_args_is_help=True, add_completion=False, help="Measure, beside the paper's numbers.")
app.command("typical-poses")(typical_poses.make_table)
app.command("pose-prior")(pose_prior.make_table)


class Size(StrEnum):
    """Picture sizes: the paper's, and twice as large."""

    PAPER = "320x240"
    DOUBLE = "640x480"


class Cameras(StrEnum):
    """Numbers of cameras: the paper's are eight."""

    FOUR = "4"
    EIGHT = "8"
    SIXTEEN = "16"
    ALL = "all"


_FILE_COLUMNS = 120
Found = TypeVar("Found")
_SEQUENCES = tuple(frame_times.SEQUENCES)
_COUNTS = [int(count) for count in Cameras if count is not Cameras.ALL]


@app.command()
def table1(
    backends: Annotated[
        list[Name] | None, typer.Option("--backend", help="Whom to measure; may be repeated; else all.")
    ] = None,
    sizes: Annotated[
        list[Size] | None, typer.Option("--size", help="Picture size; may be repeated; else all.")
    ] = None,
    cameras: Annotated[
        list[Cameras] | None, typer.Option("--cameras", help="How many; may be repeated; else all.")
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Figures are medians over so many turns.")] = 5,
    json_path: JsonOption = None,
) -> None:
    """Energy evaluations per second by window: plain, pre-rendered, with colours (the paper's table 1)."""
    (console, machine), candidates = _begin(), Candidates(backends or list(Name))
    rows: list[Row] = []
    for setup in _setups(sizes or list(Size), cameras or [Cameras.ALL]):
        measured: list[Row] = []
        with console.status(str(setup)) as status:
            for of_case in measure(candidates, setup, repeats):
                measured += of_case
                status.update(f"{setup}: {len({row.case for row in measured})} rows")
        console.print(as_table(setup, measured))
        rows += measured
    for reason in candidates.reasons:
        console.print(reason, markup=False)
    candidates.close()
    _write_json(json_path, machine, rows)


@app.command()
def table2(
    takes: TakesArgument = None,
    frames: FramesOption = ":",
    all_frames: Annotated[
        bool, typer.Option("--all-frames", help="Let the slow ways solve all frames, too.")
    ] = False,
    ways: Annotated[
        list[str] | None,
        typer.Option("--way", help="Only ways whose name holds this, such as default; may be repeated."),
    ] = None,
    json_path: JsonOption = None,
) -> None:
    """Seconds per frame: plain XOR, the paper's ways and the default (the paper's table 2)."""
    (console, machine), rows = _begin(), list[frame_times.Row]()
    chosen = [way for way in frame_times.WAYS if not ways or any(part in way.name for part in ways)]
    for take in takes or list(_SEQUENCES):
        with console.status(take) as status:
            for found in _going_on(frame_times.measure(take, frames, chosen, all_frames), take, console):
                if isinstance(found, str):
                    console.print(found, markup=False, soft_wrap=True)
                else:
                    rows.append(found)
                    status.update(f"{take}: {found.way} took {found.seconds_per_frame:.3f} s per frame")
    _finish(console, frame_times.as_tables(rows), json_path, machine, rows)


@app.command()
def accuracy(
    takes: TakesArgument = None,
    frames: FramesOption = ":",
    noise: Annotated[
        bool, typer.Option("--noise", help="Also with half of the cameras, and with bad silhouettes.")
    ] = False,
    workers: WorkersOption = 4,
    options: TrackOption = "",
    json_path: JsonOption = None,
) -> None:
    """Joint errors, overlap of silhouettes, lost limbs and marks of tracked takes."""
    (console, machine), rows, words = _begin(), list[accuracies.Row](), tuple(shlex.split(options))
    for take in takes or list(_SEQUENCES):
        with console.status(take) as status:
            for row in _going_on(accuracies.measure(take, frames, workers, words, noise), take, console):
                rows.append(row)
                status.update(f"{take}: {row.variant}: done")
    _finish(console, [accuracies.as_table(rows, workers)], json_path, machine, rows)


@app.command("settings")
def settings_command(
    takes: TakesArgument = None,
    frames: FramesOption = "0:100",
    search: Annotated[Preset | None, typer.Option(help="Only settings of this search.")] = None,
    json_path: JsonOption = None,
) -> None:
    """What each setting of the search does to speed and joint errors."""
    (console, machine), rows = _begin(), list[settings_sweep.Row]()
    for take in takes or list(_SEQUENCES):
        with console.status(take) as status:
            chosen = [search] if search else list(settings_sweep.CHANGES)
            for found in _going_on(settings_sweep.measure(take, frames, chosen), take, console):
                if isinstance(found, str):
                    console.print(found, markup=False, soft_wrap=True)
                else:
                    rows.append(found)
                    status.update(f"{take}: {found.search} {found.change}: {found.ms_per_frame:.1f} ms")
    _finish(console, [settings_sweep.as_table(rows)], json_path, machine, rows)


@app.command()
def actors(
    people: Annotated[
        int, typer.Option(min=1, max=1000, help="How many random people of each variety.")
    ] = 20,
    varieties: Annotated[
        list[Variety] | None,
        typer.Option("--variety", help="How much they differ; may be repeated; else as adults do."),
    ] = None,
    frames: Annotated[int, typer.Option(min=1, max=100, help="Frames that each fit looks at.")] = 10,
    later: Annotated[
        int,
        typer.Option(
            min=0, max=400, help="Frames of a motion after them, tracked to refine the fit; 0: none."
        ),
    ] = 90,
    seed: Annotated[int, typer.Option(min=0, help="Another seed, other people.")] = 0,
    json_path: JsonOption = None,
) -> None:
    """Height, bones and heading of random people, fitted to noisy silhouettes as xormocap fit does."""
    (console, machine), rows = _begin(), list[actor_fits.Row]()
    for variety in varieties or [Variety.POPULATION]:
        with console.status(f"{variety}: 0 of {people} people") as status:
            for row in actor_fits.measure(actor_fits.Trial(variety, frames, later, seed), range(people)):
                rows.append(row)
                status.update(f"{variety}: {row.number + 1} of {people} people")
    _finish(console, actor_tables.as_tables(rows), json_path, machine, rows)


@app.command()
def people(
    takes: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[TAKE]...", help="Folders with reference/joints.csv and reference/actor.json."
        ),
    ] = None,
    studio: StudioOption = None,
    seeds: SeedsOption = "",
    kept: KeptOption = None,
    videos: Annotated[
        bool, typer.Option("--videos", help="The studio renders videos; that takes minutes a take.")
    ] = False,
    true_silhouettes: Annotated[
        bool, typer.Option("--true-silhouettes", help="Use reference/silhouettes where a take has them.")
    ] = False,
    floor_frames: Annotated[
        int, typer.Option(min=0, help="Frames of a take in which its best pose is found, at most; 0: none.")
    ] = 40,
    workers: WorkersOption = 4,
    options: TrackOption = "",
    results: Annotated[
        Path | None, typer.Option(help="Keep the results here, a folder for each take.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw how reliable confidences are: a .png, .svg or .pdf file.")
    ] = None,
    json_path: JsonOption = None,
) -> None:
    """People of other bodies than the model's: joint errors, lost limbs, marks, floor, search failures."""
    named = given_takes(takes) + studio_takes(studio, seeds, kept, with_videos=videos)
    if not named or (videos and studio is None):
        raise typer.BadParameter("expected takes, or --studio with --seeds")
    (console, machine), rows = _begin(), list[other_people.Row]()
    trial = other_people.Trial(workers, tuple(shlex.split(options)), true_silhouettes, floor_frames, results)
    for name, folder_of in named:
        with console.status(name):
            rows += _going_on(other_people.measure(folder_of, trial), name, console)
    if plot and (outcomes := [row.outcome for row in rows if row.outcome]):
        reliability.draw([outcome.reliability for outcome in outcomes], plot)
    _finish(console, people_tables.as_tables(rows), json_path, machine, rows)


@app.command()
def confidence(
    takes: Annotated[
        list[Path], typer.Argument(metavar="TAKE...", help="Folders with reference/joints.csv.")
    ],
    true_silhouettes: Annotated[
        bool, typer.Option("--true-silhouettes", help="Use reference/silhouettes where a take has them.")
    ] = False,
    json_path: JsonOption = None,
) -> None:
    """Fit the weights of the probability that a part is lost, and test them on each take with the others'."""
    (console, machine), known = _begin(), list[lost_parts.Known]()
    for take in takes:
        with console.status(take.name):
            try:
                known.append(lost_parts.known_of(take, true_silhouettes=true_silhouettes))
            except UserError as error:
                console.print(f"{take}: {error}", highlight=False)
    _finish(console, lost_parts.as_tables(known), json_path, machine, lost_parts.as_rows(known))


@app.command()
def segmentation(
    takes: TakesArgument = None,
    studio: StudioOption = None,
    seeds: SeedsOption = "",
    kept: KeptOption = None,
    segmenters: Annotated[
        list[str] | None,
        typer.Option("--segmenter", help="One of those to compare; may be repeated; else the usual ones."),
    ] = None,
    every: Annotated[int, typer.Option(min=1, help="Of how many frames one is compared.")] = 1,
    json_path: JsonOption = None,
) -> None:
    """How good silhouettes are against exact ones, and what they cost, of takes with clean plates."""
    named = studio_takes(studio, seeds, kept, with_videos=True)
    named += [(take, partial(take_folder, take)) for take in takes or (() if named else _SEQUENCES)]
    (console, machine), rows = _begin(), list[silhouettes.Row]()
    for name, folder_of in named:
        with console.status(name) as status:
            chosen = segmenters or silhouettes.SEGMENTERS
            for row in _going_on(silhouettes.measure(folder_of, chosen, every), name, console):
                rows.append(row)
                status.update(f"{name}: {row.segmenter}: done")
    _finish(console, [silhouettes.as_table(rows)], json_path, machine, rows)


class Part(StrEnum):
    """One measurement of the page."""

    FIRST = "first"
    COST = "cost"


@app.command()
def page(
    take: Annotated[str, typer.Argument(metavar="[TAKE]", help="A take's folder, or a motion.")] = "basic",
    parts: Annotated[
        list[Part] | None,
        typer.Option("--part", help="What to measure; may be repeated; else all. Cost takes 8 minutes."),
    ] = None,
    rounds: Annotated[int, typer.Option(min=1, help="How often the cost of each way is measured.")] = 5,
    screenshot: Annotated[
        Path | None, typer.Option(callback=writable, help="Write the first view here, as PNG.")
    ] = None,
    json_path: JsonOption = None,
) -> None:
    """The page: how soon it shows everything, and what watching costs tracking."""
    (console, machine), rows, tables = _begin(), list[Any](), list[Table]()
    with console.status("the page") as status:
        for part in parts or list(Part):
            measured = _page_part(part, take, rounds, screenshot, status.update)
            for table, found in _going_on(measured, f"{take}, {part}", console):
                tables.append(table)
                rows += found
    _finish(console, tables, json_path, machine, rows)


def _page_part(
    part: Part, take: str, rounds: int, screenshot: Path | None, tell: Callable[[str], None]
) -> Iterator[tuple[Table, list[Any]]]:
    folder = take_folder(take)
    if part is Part.FIRST:
        tell("opening the page while all starts, about a minute")
        row = first_view.measure(folder, screenshot)
        yield first_view.as_table(row), [row]
    else:
        ways = page_cost.measure(folder, rounds, tell)
        yield page_cost.as_table(ways), ways


def _going_on(measured: Iterator[Found], take: str, console: Console) -> Iterator[Found]:
    """What is measured on a take; an error of the user's is said, and ends this take only."""
    try:
        yield from measured
    except UserError as error:
        console.print(f"{take}: is left out: {error}", markup=False, highlight=False, soft_wrap=True)


def _begin() -> tuple[Console, Machine]:
    """The console, on which it says what machine this is."""
    console, machine = Console(width=None if sys.stdout.isatty() else _FILE_COLUMNS), this_machine()
    console.print(str(machine), highlight=False)
    return console, machine


def _finish(
    console: Console, tables: list[Table], path: Path | None, machine: Machine, rows: Sequence[Any]
) -> None:
    """Show and write what was measured; ends with 1 where that is nothing."""
    if not rows:
        raise typer.Exit(1)
    for table in tables:
        console.print(table)
    _write_json(path, machine, rows)


def _write_json(path: Path | None, machine: Machine, rows: Sequence[Any]) -> None:
    if path is not None:
        content = {"machine": asdict(machine), "rows": [asdict(row) for row in rows]}
        path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _setups(sizes: list[Size], cameras: list[Cameras]) -> list[Setup]:
    """Smaller pictures first, fewer cameras first."""
    counts = _COUNTS if Cameras.ALL in cameras else sorted({int(count) for count in cameras})
    return [Setup.of(size, count) for size in Size if size in sizes for count in counts]


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # unwinds, so that what is being tracked ends too
    app()
