"""What commands share: the take as an argument, and where they print."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, TypeAlias

import typer
from rich.console import Console

TakeFolder: TypeAlias = Annotated[Path, typer.Argument(help="The take folder.", metavar="TAKE")]
stdout, stderr = Console(highlight=False), Console(stderr=True, highlight=False)


def say(line: str) -> None:
    """Print a line as it is, however long: paths and addresses are to be copied."""
    stdout.print(line, markup=False, soft_wrap=True)


def warn(sentences: Iterable[str], to: Console = stderr) -> None:
    """Print warnings, each once."""
    for sentence in dict.fromkeys(sentences):
        to.print(f"warning: {sentence}", style="yellow", markup=False, soft_wrap=True)
