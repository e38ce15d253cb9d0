"""What commands share: a take or a result as an argument, where they print, and how."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, TypeAlias

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

TakeFolder: TypeAlias = Annotated[Path, typer.Argument(help="The take folder.", metavar="TAKE")]
ResultFolder: TypeAlias = Annotated[
    Path, typer.Argument(help="A results folder of xormocap track.", metavar="RESULT")
]
_WHOLE_LINES = 10_000
"""Width of output that is not a terminal: files and pipes get whole lines."""


def _console(*, is_stderr: bool) -> Console:
    is_terminal = (sys.stderr if is_stderr else sys.stdout).isatty()
    width = None if is_terminal else _WHOLE_LINES
    return Console(stderr=is_stderr, highlight=False, emoji=False, width=width)


stdout, stderr = _console(is_stderr=False), _console(is_stderr=True)


def say(line: str, to: Console = stdout, style: str | None = None) -> None:
    """Print a line without wrapping it, so that paths and addresses can be copied."""
    to.print(line, style=style, markup=False, soft_wrap=True)


def table_of(first: str, *numbers: str) -> Table:
    """A table without lines: a column of words, and columns that are aligned to the right."""
    table = Table(first, box=None, header_style="bold")
    for title in numbers:
        table.add_column(title, justify="right")
    return table


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """A progress bar; yields a function of the stage, in words, and of the total progress, 0 to 1."""
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=stderr) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda what, share: bar.update(task, completed=share, description=what)


def warn(sentences: Iterable[str]) -> None:
    """Print warnings, each once."""
    for sentence in dict.fromkeys(sentences):
        say(f"warning: {sentence}", stderr, "yellow")
