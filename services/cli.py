"""The `xormocap` command: its sub-commands, and how all of them end."""

import signal
import sys
from typing import NoReturn

import typer

from services.bridge.__main__ import bridge
from services.commands.calibrate.command import calibrate
from services.commands.consoles import stderr
from services.commands.doctor import doctor
from services.commands.export import export
from services.commands.fit import fit
from services.commands.keys import app as keys
from services.commands.live import live
from services.commands.segment import segment
from services.commands.status import status
from services.commands.sync import sync
from services.commands.synth import synth
from services.commands.track import track
from services.commands.view import view
from services.health import health
from services.mocap.errors import UserError
from services.process import EXIT_STOPPED, EXIT_USER_ERROR
from services.runs.launcher import ServiceFailedError
from services.runs.track import Interrupted

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Markerless motion capture from silhouettes of calibrated cameras.",
)
_COMMANDS = (track, live, fit, calibrate, sync, segment, synth, export, view, bridge, status, doctor, health)
for command in _COMMANDS:
    app.command()(command)
app.add_typer(keys, name="keys")

_EXIT_INTERRUPTED = 130


def _fail(sentence: str, code: int) -> NoReturn:
    stderr.print(sentence, style="red", markup=False, soft_wrap=True)
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
    except Interrupted as stopped:
        _fail(str(stopped), _EXIT_INTERRUPTED)


if __name__ == "__main__":
    main()
