"""The command line of the long runs."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from bench.soak import fuzz as decoder
from bench.soak import socket_fuzz
from bench.soak.fire import BrokenServiceError
from bench.soak.kills import kill_at_random, show_kills
from bench.soak.memory import MOST_GROWTH_MIB, show_memory, watch_memory
from services.mocap.errors import UserError
from services.runs import Interrupted, ServiceFailedError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Look long and hard for what breaks.",
)
_MOST_GROWTH_MIB = 32.0
"""What an allocator may keep; a message of every thousand that stayed would be more."""
_EXIT_INTERRUPTED = 130
_console = Console(highlight=False)


SeedOption = Annotated[
    int | None, typer.Option(min=0, help="Repeats what is done, if not just when; else it differs each time.")
]
JsonOption = Annotated[Path | None, typer.Option("--json", help="Write the figures here as well.")]


@app.command()
def fuzz(
    inputs: Annotated[int, typer.Option(min=10, help="Inputs for the decoder.")] = 1_000_000,
    live: Annotated[
        int, typer.Option(min=0, help="Messages for a worker's and a coordinator's sockets; 0: none.")
    ] = 50_000,
    seed: SeedOption = None,
    json_path: JsonOption = None,
) -> None:
    """Hostile messages: nothing may crash, grow or change a pose, and everything is counted."""
    chosen = _chosen(seed)
    with _following("decoding", inputs) as progress:
        report = decoder.fuzz_decoder(chosen, inputs, progress)
    _show_decoder(report)
    fuzzed = None
    if live:
        with _following("fuzzing sockets", None):
            fuzzed = socket_fuzz.fuzz_sockets(chosen, live)
        _show_socket_fuzz(fuzzed)
    _write(json_path, {"decoder": report.as_json(), "socket_fuzz": fuzzed and fuzzed.as_json()})
    grown = {"decoder": report.growth_mib} | (fuzzed.growth_mib if fuzzed else {})
    if max(grown.values()) > _MOST_GROWTH_MIB:
        _console.print(f"broken: memory grew, in MiB: {grown}", style="red")
        raise typer.Exit(1)


@app.command()
def kills(
    count: Annotated[
        int, typer.Option("--kills", min=1, help="How often a service is killed or held up.")
    ] = 100,
    frames: Annotated[
        int, typer.Option(min=10, help="Frames of the take that is tracked again and again.")
    ] = 120,
    seed: SeedOption = None,
    json_path: JsonOption = None,
) -> None:
    """Services die and hang at random moments: no frame may be lost, and none may be altered."""
    chosen = _chosen(seed)
    with _following("killing", count) as progress:
        report = kill_at_random(chosen, count, frames, progress)
    show_kills(report, _console)
    _write(json_path, report.as_json())
    if report.lost or report.altered:
        raise typer.Exit(1)


@app.command()
def memory(
    frames: Annotated[int, typer.Option(min=100, help="Frames of the take.")] = 10_000,
    json_path: JsonOption = None,
) -> None:
    """A long take: the memory of every service must stay as it is."""
    with _following("tracking", frames) as progress:
        report = watch_memory(frames, progress)
    show_memory(report, _console)
    _write(json_path, report.as_json())
    if any(report.growth_mib(name) > MOST_GROWTH_MIB for name in report.seen_mib):
        raise typer.Exit(1)


def _chosen(seed: int | None) -> int:
    """A seed, which is told so that the run can be repeated."""
    chosen = int(np.random.default_rng().integers(2**31)) if seed is None else seed
    _console.print(f"--seed {chosen}")
    return chosen


@contextmanager
def _following(what: str, total: int | None) -> Iterator[Callable[[int], None]]:
    """A bar that shows how much of a run is done; what breaks in it is said, and ends the command."""
    try:
        with Progress(console=Console(stderr=True)) as bar:
            task = bar.add_task(what, total=total)
            yield lambda done: bar.update(task, completed=done)
    except (decoder.BrokenDecoderError, BrokenServiceError, ServiceFailedError, UserError) as error:
        _console.print(f"broken: {error}", style="red", markup=False, soft_wrap=True)
        raise typer.Exit(1) from None
    except Interrupted:
        _console.print("stopped")
        raise typer.Exit(_EXIT_INTERRUPTED) from None


def _write(path: Path | None, content: Mapping[str, object]) -> None:
    if path is not None:
        path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _show_decoder(report: decoder.Report) -> None:
    table = Table("kind", "understood", "malformed", box=None)
    for kind in sorted({*report.understood, *report.malformed}):
        table.add_row(kind, f"{report.understood[kind]}", f"{report.malformed[kind]}")
    table.add_row("all", f"{report.understood.total()}", f"{report.malformed.total()}")
    _console.print(table)
    memory = " ".join(f"{mib:.0f}" for mib in report.rss_mib)
    _console.print(
        f"{report.inputs} inputs in {report.seconds:.0f} s, the slowest {1000 * report.slowest_s:.1f} ms; "
        f"memory after each tenth, MiB: {memory}"
    )


def _show_socket_fuzz(report: socket_fuzz.Report) -> None:
    sent = ", ".join(f"{count} to {target}" for target, count in report.sent.items())
    grown = ", ".join(f"{name} {mib:+.1f}" for name, mib in report.growth_mib.items())
    _console.print(
        f"live: {sent}, in {report.seconds:.0f} s; poses as in a quiet run; memory grew by, MiB: {grown}; "
        f"the coordinator counted {report.counted}",
        soft_wrap=True,
    )


if __name__ == "__main__":
    app()
