"""The `xormocap` command: its sub-commands, and their error handling."""

import signal
import sys
import warnings
from importlib import import_module
from importlib.metadata import version
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from proto.keys import KeysError
from proto.streams import AddressError
from services.commands.consoles import say, stderr
from services.commands.short_help import shortened
from services.mocap.errors import UserError
from services.process import EXIT_STOPPED, EXIT_USER_ERROR
from services.runs import Interrupted, ServiceFailedError

_MODULES = {
    "new": "services.commands.new",
    "track": "services.commands.track",
    "live": "services.commands.live",
    "fit": "services.commands.fit",
    "calibrate": "services.commands.calibrate.command",
    "sync": "services.commands.sync",
    "segment": "services.commands.segment",
    "synth": "services.commands.synth",
    "export": "services.commands.export",
    "view": "services.commands.view",
    "play": "services.commands.play",
    "bridge": "services.bridge.__main__",
    "status": "services.commands.status",
    "doctor": "services.commands.doctor",
    "health": "services.health",
    "keys": "services.commands.keys",
}
"""Sub-command -> module with a function of that name, or with an app of several commands. Importing all of
them takes seconds, so only the chosen one is imported."""
_EXIT_INTERRUPTED = 130


class _SubCommands(TyperGroup):
    """The commands of _MODULES, in that order."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.commands = dict.fromkeys(_MODULES, TyperCommand(None))  # only their names are looked at

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002  (as of any group)
        if cmd_name not in _MODULES:
            return None
        module = import_module(_MODULES[cmd_name])
        if hasattr(module, "app"):
            group = get_command(module.app)
            group.name = cmd_name
            return group
        alone = typer.Typer(add_completion=False)
        alone.command(cmd_name)(getattr(module, cmd_name))
        command = get_command(alone)
        return shortened(command, module.IN_HELP) if hasattr(module, "IN_HELP") else command


app = typer.Typer(
    cls=_SubCommands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Markerless motion capture from silhouettes of calibrated cameras.",
)


def _print_version(is_asked: bool) -> None:
    if is_asked:
        typer.echo(f"xormocap {version('xormocap')}")
        raise typer.Exit


@app.callback()
def _(
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Nothing of its own."""


def _fail(sentence: str, code: int) -> NoReturn:
    say(sentence, stderr, "red")
    sys.exit(code)


def main() -> None:
    """Run the command; a user's error ends in one sentence and exit code 2."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # those of other libraries; python -W default shows them
    signal.signal(
        signal.SIGTERM, lambda *_: sys.exit(EXIT_STOPPED)
    )  # unwinds the stack, so that nothing incomplete stays
    try:
        app()
    except (UserError, AddressError, KeysError) as error:
        _fail(str(error), EXIT_USER_ERROR)
    except ServiceFailedError as error:
        _fail(str(error), 1)
    except Interrupted as stopped:
        _fail(str(stopped), _EXIT_INTERRUPTED)
    except SystemError as error:  # compiled code wraps what the handler of a signal raises
        stop: BaseException | None = error
        while isinstance(stop, SystemError):
            stop = stop.__cause__
        if not isinstance(stop, KeyboardInterrupt | SystemExit):
            raise
        sys.exit(stop.code if isinstance(stop, SystemExit) else _EXIT_INTERRUPTED)


if __name__ == "__main__":
    main()
