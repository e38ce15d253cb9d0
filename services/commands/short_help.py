"""`--help` of commands with many options: the usual ones; `--help-all` lists all."""

from collections.abc import Collection
from typing import Annotated, Any, TypeAlias

import typer
from typer.core import TyperOption


def _tell_all(context: typer.Context, is_asked: bool) -> None:
    if is_asked:
        for param in context.command.params:
            if isinstance(param, TyperOption):
                param.hidden = False
        typer.echo(context.get_help(), nl=False)
        raise typer.Exit


HelpAllOption: TypeAlias = Annotated[
    bool, typer.Option("--help-all", callback=_tell_all, is_eager=True, help="Show all options and exit.")
]
"""An option for commands whose module has IN_HELP; its value is of no use to them."""


def shortened(command: Any, kept: Collection[str]) -> Any:
    """The command, whose --help lists only its arguments and the options with the kept names."""
    for param in command.params:
        if isinstance(param, TyperOption) and param.name not in (*kept, "_help_all"):
            param.hidden = True
    return command
