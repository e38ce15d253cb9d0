"""The command line of the measurements."""

import json
import os
import sys
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from services.bench.contestants import Contestants, Name
from services.bench.machine import this_machine
from services.bench.problems import Setup
from services.bench.table1 import Row, as_table, measure

app = typer.Typer(no_args_is_help=True, add_completion=False, help="Measure, beside the paper's numbers.")


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
_COUNTS = [int(count) for count in Cameras if count is not Cameras.ALL]


@app.callback()
def _commands() -> None:
    """Keep `table1` a subcommand, since others come beside it."""


def _writable(path: Path | None) -> Path | None:
    """Minutes of measuring are not to end at a file that cannot be written."""
    if path is not None and not path.parent.is_dir():
        raise typer.BadParameter(f"{path.parent} is not a folder: make it first")
    if path is not None and (path.is_dir() or not os.access(path if path.exists() else path.parent, os.W_OK)):
        raise typer.BadParameter(f"{path} cannot be written: name another file")
    return path


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
    json_path: Annotated[
        Path | None, typer.Option("--json", callback=_writable, help="Write the figures here as well.")
    ] = None,
) -> None:
    """Energy evaluations per second by window, plain and pre-rendered (the paper's table 1)."""
    console = Console(width=None if sys.stdout.isatty() else _FILE_COLUMNS)
    machine, contestants = this_machine(), Contestants(backends or list(Name))
    console.print(str(machine), highlight=False)
    rows: list[Row] = []
    for setup in _setups(sizes or list(Size), cameras or [Cameras.ALL]):
        measured: list[Row] = []
        with console.status(str(setup)) as status:
            for of_case in measure(contestants, setup, repeats):
                measured += of_case
                status.update(f"{setup}: {len({row.case for row in measured})} of 10 rows")
        console.print(as_table(setup, measured))
        rows += measured
    for reason in contestants.reasons:
        console.print(reason, markup=False)
    contestants.close()
    if json_path is not None:
        content = {"machine": asdict(machine), "rows": [asdict(row) for row in rows]}
        json_path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _setups(sizes: list[Size], cameras: list[Cameras]) -> list[Setup]:
    """Smaller pictures first, fewer cameras first."""
    counts = _COUNTS if Cameras.ALL in cameras else sorted({int(count) for count in cameras})
    return [Setup.of(size, count) for size in Size if size in sizes for count in counts]


if __name__ == "__main__":
    app()
