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
import tempfile
import time
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import NamedTuple

import typer

from services.mocap.body.body_mesh import generic_mesh
from services.process import PARENT_VARIABLE
from services.runs.failures import ServiceFailedError

_LOOK_S = 0.02
_UNKNOWN = 1
"""The exit code of a process whose end nobody saw."""


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
    """Starts processes; none of them outlives it for long."""

    def __init__(self, modules: Sequence[str], environment: Mapping[str, str]) -> None:
        """modules: what will be asked for, to be imported ahead."""
        self._line, theirs = Pipe()
        self._codes: dict[int, int] = {}
        self._words = tempfile.TemporaryFile("w+")  # noqa: SIM115  (open as long as the server is)
        self._process = subprocess.Popen(  # noqa: S603  (our own module)
            [sys.executable, "-m", "services.runs.fork_server", str(theirs.fileno()), *modules],
            stdin=subprocess.DEVNULL,
            stdout=self._words,
            stderr=self._words,
            # Threads of every service's linear algebra would only wait for those of others.
            env={"OPENBLAS_NUM_THREADS": "1", **environment},
            pass_fds=[theirs.fileno()],
            start_new_session=True,
        )
        theirs.close()

    def start(self, birth: Birth) -> Forked:
        """Start a process; raises ServiceFailedError where the server has ended."""
        try:
            self._line.send(birth)
            while not isinstance(said := self._line.recv(), int):
                self._note(said)
        except (EOFError, OSError):
            self._words.seek(0)
            why = (self._words.read().splitlines() or ["it said nothing"])[-1]
            raise ServiceFailedError(f"the process that starts services has ended: {why}") from None
        return Forked(self, said)

    def code_of(self, pid: int) -> int | None:
        """The exit code of a process; None while it runs. Without the server they all end, orderly or not."""
        try:
            while pid not in self._codes and self._line.poll():
                self._note(self._line.recv())
        except (EOFError, OSError):
            return self._codes.setdefault(pid, _UNKNOWN)
        return self._codes.get(pid)

    def _note(self, end: tuple[int, int]) -> None:
        pid, code = end
        self._codes[pid] = code

    def close(self) -> None:
        """End the server; processes that still run notice, and stop."""
        self._line.close()
        self._process.wait()
        self._words.close()


def serve(line: Connection, modules: Sequence[str]) -> None:
    """Start what is asked for, and tell what has ended; raises EOFError once the other side has closed."""
    mains = {module: import_module(f"{module}.__main__").main for module in modules}
    generic_mesh()
    gc.freeze()  # what no copy changes, all of them share
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
            pid = os.fork()
            if pid == 0:
                line.close()
                for descriptor in running:
                    os.close(descriptor)
                _settle(birth)
                typer.run(mains[birth.module])
            running[os.pidfd_open(pid)] = pid
            line.send(pid)


def _settle(birth: Birth) -> None:
    """Make a copy of the server a process of its own, as if it had been started by itself."""
    os.setsid()
    log = os.open(birth.log_path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
    for stream in (1, 2):
        os.dup2(log, stream)
    os.close(log)
    os.environ[PARENT_VARIABLE] = str(os.getppid())
    Path("/proc/self/comm").write_text(birth.module.rpartition(".")[2])  # what ps and top call it
    sys.argv = [birth.module, *birth.arguments]


if __name__ == "__main__":
    # Python from 3.12 on warns of threads; those of linear algebra, if any, are built for this.
    warnings.filterwarnings("ignore", "This process .* is multi-threaded", DeprecationWarning)
    with suppress(EOFError, BrokenPipeError):
        serve(Connection(int(sys.argv[1])), sys.argv[2:])
