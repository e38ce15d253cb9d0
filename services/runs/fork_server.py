"""Services as copies of one process that has imported them all, and has loaded their compiled code.

Both take a second or more of processor time a service, and a run has seven services, so they would dominate
the start on a small machine. `ForkServer` is the launcher's side; the other one is
`python -m services.runs.fork_server FD MODULE …`. They communicate over a socket: requests are Births;
answers are the new process's id at once, and (id, exit code) at its end.

multiprocessing's forkserver is not used: a process can have only one, with the environment and the output of
its first start; here each run may have its own.
"""

import gc
import os
import shutil
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from importlib import import_module
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import NamedTuple

import typer

from services.mocap.energy.engine import open_engine
from services.mocap.energy.settings import EngineSettings
from services.mocap.search.warm_up import warm_up
from services.process import PARENT_VARIABLE
from services.runs import ServiceFailedError

_EXIT_CHECK_S = 0.02
"""Time between two looks whether a process has ended."""
_SOLVER = "services.limb_worker"
"""What it compiles, or loads once compiled, every copy of it and of the coordinator needs."""
_UNKNOWN = 1
"""The exit code of a process whose end was not observed."""


def can_fork() -> bool:
    """Whether this system supports it: elsewhere libraries do not survive a fork."""
    if sys.platform != "linux":
        return False
    try:
        os.close(os.pidfd_open(os.getpid()))
    except OSError:  # an old kernel, or a sandbox
        return False
    return True


class Birth(NamedTuple):
    """The description of a new process."""

    module: str
    """A package whose __main__ has a function main for typer."""
    arguments: list[str]
    log_path: str
    """The file to which its output is appended."""


class Forked:
    """A process of a ForkServer, with the methods of subprocess.Popen that launchers use."""

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
            time.sleep(_EXIT_CHECK_S)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal; no effect if the process has ended."""
        if self.poll() is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)


class ForkServer:
    """Starts processes; threads may share it."""

    def __init__(self, modules: Iterable[str], environment: Mapping[str, str], log_path: Path) -> None:
        """modules: imported at once, before started processes need the processor; environment: of all
        processes; log_path: for errors before a process has its own log.
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
                # Linear-algebra threads of several services would only wait for each other.
                env={"OPENBLAS_NUM_THREADS": "1", **environment},
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        theirs.close()

    def start(self, birth: Birth) -> Forked:
        """Start a process; raises OSError if its log cannot be opened, ServiceFailedError if the server has
        ended."""
        Path(birth.log_path).touch()
        try:
            with self._lock:
                self._line.send(birth)
                while not isinstance(said := self._line.recv(), int):
                    self._codes.update([said])
                self._codes.pop(said, None)  # of an earlier process with this id
        except (EOFError, OSError):
            why = last_line(self._log_path)
            raise ServiceFailedError(f"the process that starts services has ended: {why}") from None
        return Forked(self, said)

    def code_of(self, pid: int) -> int | None:
        """The exit code of a process; None while it runs."""
        try:
            with self._lock:
                while pid not in self._codes and self._line.poll():
                    self._codes.update([self._line.recv()])
        except (EOFError, OSError):  # the server is gone; its services detect this and stop
            with suppress(ProcessLookupError):
                os.kill(pid, 0)
                return None
            self._codes.setdefault(pid, _UNKNOWN)
        return self._codes.get(pid)

    @property
    def is_running(self) -> bool:
        """Whether it can start processes."""
        return self._process.poll() is None

    def keep_log(self, folder: Path) -> None:
        """Copy the server's own log to a folder, unless it is empty."""
        if self._log_path.exists() and self._log_path.stat().st_size:
            shutil.copy(self._log_path, folder)

    def close(self) -> None:
        """Kill the server, even while it loads code; call it once all processes that it started have
        ended."""
        self._line.close()
        self._process.terminate()
        self._process.wait()
        if self._log_path.exists() and not self._log_path.stat().st_size:
            self._log_path.unlink()


def serve(line: Connection, modules: Collection[str]) -> None:
    """Start requested processes and report ended ones; raises EOFError or ConnectionError at the end."""
    for module in modules:
        import_module(f"{module}.__main__")
    if _SOLVER in modules:
        with open_engine(EngineSettings(backend="cpu")) as engine:
            warm_up(engine)
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
            gc.freeze()  # all copies share the objects that none of them changes
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
    """Turn a copy of the server into an independent process."""
    os.environ[PARENT_VARIABLE] = str(server)
    os.setsid()
    log = os.open(birth.log_path, os.O_WRONLY | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(log, stream)
    os.close(log)
    Path("/proc/self/comm").write_text(birth.module.rpartition(".")[2])  # its name in ps and top
    sys.argv = [birth.module, *birth.arguments]


def last_line(log_path: Path) -> str:
    """The last line of a log."""
    lines = lines_of(log_path)
    return lines[-1] if lines else "it said nothing"


def lines_of(log_path: Path) -> list[str]:
    """The lines of a log that are not blank."""
    return [line for line in log_path.read_text(errors="replace").splitlines() if line.strip()]


if __name__ == "__main__":
    # Python 3.12 and later warn of threads; linear-algebra threads, if there are any, support forking.
    warnings.filterwarnings("ignore", "This process .* is multi-threaded", DeprecationWarning)
    with suppress(EOFError, ConnectionError):
        serve(Connection(int(sys.argv[1])), sys.argv[2:])
