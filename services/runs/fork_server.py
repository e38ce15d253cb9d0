"""Services as copies of one process that has imported them all.

To import what a service needs takes a second or more of a processor's time, and a run has seven of them, so
that on a small machine most of its start went there. `ForkServer` is the launcher's side; the other one is
`python -m services.runs.fork_server FD MODULE …`. Both speak over a socket: out go Births, back come the new
process's id at once, and (id, exit code) when it has ended.
"""

import gc
import os
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib import import_module
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import NamedTuple

import typer

from services.mocap.body.body_mesh import generic_mesh
from services.process import PARENT_VARIABLE
from services.runs import ServiceFailedError

_LOOK_S = 0.02
_UNKNOWN = 1
"""The exit code of a process whose end nobody saw."""


def can_fork() -> bool:
    """Whether this system can do it: elsewhere libraries do not work on in a copy of who has loaded them."""
    if sys.platform != "linux":
        return False
    try:
        os.close(os.pidfd_open(os.getpid()))
    except OSError:  # an old kernel, or a sandbox
        return False
    return True


class Birth(NamedTuple):
    """What a new process is to be."""

    module: str
    """A package whose __main__ has a function main for typer."""
    arguments: list[str]
    log_path: str
    """The file that its words are added to."""


class Forked:
    """A process that a ForkServer has made, with what launchers use of subprocess.Popen."""

    def __init__(self, server: "ForkServer", pid: int) -> None:
        self._server, self.pid = server, pid

    def poll(self) -> int | None:
        """Its exit code, or minus the signal that killed it; None while it runs."""
        return self._server.code_of(self.pid)

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end; raises subprocess.TimeoutExpired."""
        deadline_s = None if timeout is None else time.monotonic() + timeout
        while (code := self.poll()) is None:
            if deadline_s is not None and time.monotonic() > deadline_s:
                raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
            time.sleep(_LOOK_S)
        return code

    def send_signal(self, number: int) -> None:
        """As kill does; nothing where it has ended."""
        if self.poll() is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)


class ForkServer:
    """Starts processes; threads may share it."""

    def __init__(self, modules: Iterable[str], environment: Mapping[str, str], log_path: Path) -> None:
        """modules: to be imported at once, before what is started wants the processor; environment: of all
        processes; log_path: for what goes wrong before one has a log of its own.
        """
        self._line, theirs = Pipe()
        self._codes: dict[int, int] = {}
        self._log_path, self._lock = log_path, threading.Lock()
        with log_path.open("ab") as log_file:
            self._process = subprocess.Popen(  # noqa: S603  (our own module)
                [sys.executable, "-m", "services.runs.fork_server", str(theirs.fileno()), *modules],
                stdin=subprocess.DEVNULL,
                stdout=log_file,
                stderr=log_file,
                # Threads of every service's linear algebra would only wait for those of others.
                env={"OPENBLAS_NUM_THREADS": "1", **environment},
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        theirs.close()

    def start(self, birth: Birth) -> Forked:
        """Start a process; raises OSError where it cannot have a log, ServiceFailedError without a server."""
        Path(birth.log_path).touch()
        try:
            with self._lock:
                self._line.send(birth)
                while not isinstance(said := self._line.recv(), int):
                    self._note(said)
        except (EOFError, OSError):
            lines = self._log_path.read_text(errors="replace").splitlines()
            why = lines[-1] if lines else "it said nothing"
            raise ServiceFailedError(f"the process that starts services has ended: {why}") from None
        return Forked(self, said)

    def code_of(self, pid: int) -> int | None:
        """The exit code of a process; None while it runs."""
        try:
            with self._lock:
                while pid not in self._codes and self._line.poll():
                    self._note(self._line.recv())
        except (EOFError, OSError):  # the server is gone; its services notice, and stop
            return None if _exists(pid) else self._codes.setdefault(pid, _UNKNOWN)
        return self._codes.get(pid)

    def _note(self, end: tuple[int, int]) -> None:
        pid, code = end
        self._codes[pid] = code

    def close(self) -> None:
        """End the server, after all that it has started."""
        self._line.close()
        self._process.wait()
        if self._log_path.exists() and not self._log_path.stat().st_size:
            self._log_path.unlink()


def _exists(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def serve(line: Connection, modules: Iterable[str]) -> None:
    """Start what is asked for, and tell what has ended; raises EOFError or ConnectionError at the end."""
    for module in modules:
        import_module(f"{module}.__main__")
    generic_mesh()
    server = os.getpid()
    running: dict[int, int] = {}
    """A descriptor of each process -> its id."""
    while True:
        for ready in wait([line, *running]):
            if isinstance(ready, int):
                pid = running.pop(ready)
                os.close(ready)
                line.send((pid, os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])))
                continue
            birth: Birth = line.recv()
            main = import_module(f"{birth.module}.__main__").main
            gc.freeze()  # what no copy changes, all of them share
            pid = os.fork()
            if pid == 0:
                line.close()
                for descriptor in running:
                    os.close(descriptor)
                _settle(birth, server)
                typer.run(main)
            running[os.pidfd_open(pid)] = pid
            line.send(pid)


def _settle(birth: Birth, server: int) -> None:
    """Make a copy of the server a process of its own, as if it had been started by itself."""
    os.environ[PARENT_VARIABLE] = str(server)
    os.setsid()
    log = os.open(birth.log_path, os.O_WRONLY | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(log, stream)
    os.close(log)
    Path("/proc/self/comm").write_text(birth.module.rpartition(".")[2])  # what ps and top call it
    sys.argv = [birth.module, *birth.arguments]


if __name__ == "__main__":
    # Python from 3.12 on warns of threads; those of linear algebra, if any, are built for this.
    warnings.filterwarnings("ignore", "This process .* is multi-threaded", DeprecationWarning)
    with suppress(EOFError, ConnectionError):
        serve(Connection(int(sys.argv[1])), sys.argv[2:])
