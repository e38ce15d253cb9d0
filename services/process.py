"""A service's process: its log, an orderly stop, its heartbeat, and errors told as one sentence."""

import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Self

from proto.keys import KeysError
from proto.streams import AddressError
from services import logs
from services.health import heartbeat
from services.metrics import offering
from services.mocap.errors import UserError

PARENT_VARIABLE = "XORMOCAP_PARENT"
"""Process id of a launcher. A service stops when its parent is no longer this process, so that none is
orphaned."""
STOP_CHECK_S = 0.2
"""How long a service waits for messages, at most, before it beats and checks for a request to stop."""
EXIT_USER_ERROR = 2
EXIT_STOPPED = 143
"""Exit code of a service that was stopped cleanly; 0 means that its work was done."""
_AUTOGROUP = Path("/proc/self/autogroup")
"""Where Linux stores the niceness of a whole session. Between sessions Linux ignores the niceness of single
processes, and a launcher starts each service in its own session."""


class StopRequest:
    """True after a request to stop: SIGINT, SIGTERM or the end of the launcher.

    As a context manager it gives the signals back to who handled them before.
    """

    def __init__(self) -> None:
        self.count = 0
        """Number of signals so far; the second means stop at once."""
        self._parent = int(os.environ.get(PARENT_VARIABLE, "0"))
        numbers = (signal.SIGINT, signal.SIGTERM)
        self._before = {number: signal.signal(number, self._note) for number in numbers}

    def _note(self, *_: object) -> None:
        self.count += 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __bool__(self) -> bool:
        return self.count > 0 or (self._parent != 0 and os.getppid() != self._parent)


def run_service(name: str, main: Callable[[StopRequest], None], metrics: str | None = None) -> None:
    """Run a service's main function as this process, then exit. metrics: the option --metrics.

    The exit code is 0 when its work is done, EXIT_STOPPED after a stop, 2 for an error of the user's, else 1.
    After an error the last line of the log describes it in one sentence. main's loop calls
    services.health.beat.
    """
    stop = StopRequest()
    logs.begin(name)
    try:
        with heartbeat(name), offering(metrics):
            main(stop)
    except (UserError, AddressError, KeysError) as error:
        print(error, file=sys.stderr)  # noqa: T201  (the one sentence that a launcher shows)
        sys.exit(EXIT_USER_ERROR)
    except Exception as error:
        logging.exception("unexpected error")
        print(f"{type(error).__name__}: {next(iter(str(error).splitlines()), '')}", file=sys.stderr)  # noqa: T201
        sys.exit(1)
    sys.exit(EXIT_STOPPED if stop else 0)


def client_name(role: str) -> str:
    """A unique name of this process: role, host and process id."""
    return f"{role}@{socket.gethostname()}:{os.getpid()}"


def clock_name() -> str:
    """The name of this machine's monotonic clock since it was booted; all its processes read the same
    clock."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return socket.gethostname()


def give_way(niceness: int) -> None:
    """Lower this process's priority, and that of its session if it leads one; 0: leave it unchanged."""
    own = os.nice(niceness)
    for thread in threading.enumerate() if sys.platform == "linux" else ():  # each has its own priority
        if thread.native_id is not None:
            with suppress(OSError):  # it has ended
                os.setpriority(os.PRIO_PROCESS, thread.native_id, own)
    if niceness and os.getsid(0) == os.getpid():  # of another session this would slow all its processes
        with suppress(OSError):  # systems without session groups have no such file
            _AUTOGROUP.write_text(str(own))
