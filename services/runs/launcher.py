"""All services of one take as local processes: started, watched, and ended together."""

import logging
import os
import secrets
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self, TypeAlias

from services import logs
from services.mocap.errors import UserError
from services.options import KEYS_VARIABLE, METRICS_VARIABLE
from services.process import EXIT_STOPPED, EXIT_USER_ERROR, PARENT_VARIABLE
from services.runs import ServiceFailedError
from services.runs.fork_server import Birth, Forked, ForkServer, can_fork, last_line, lines_of

log = logging.getLogger(__name__)

_PORTS = 3
_STOP_S = 4.0
"""How long processes may take to end after a SIGTERM before they get another."""
_ORDERLY = (0, EXIT_STOPPED, -signal.SIGTERM)
"""Exit codes of a process that was told to stop; the last, if the signal came before its handler was
installed."""
_LOWEST_PORT, _HIGHEST_PORT = 20_000, 32_000
"""Below Linux's range of client ports. A client that connects to a port there without a listener may get the
same port as its own, connect to itself, and block the port for a restarted coordinator."""


@dataclass(frozen=True)
class ServiceSpec:
    """A kind of process."""

    module: str
    most_restarts: int
    """How often in one run a process of this kind is restarted; more crashes mean that it cannot work
    here."""
    stop_s: float = 5.0
    """How long a process may take to end after a second SIGTERM before it is killed."""


SERVICES: dict[str, ServiceSpec] = {
    "coordinator": ServiceSpec("services.coordinator", most_restarts=5),
    "limb_worker": ServiceSpec("services.limb_worker", most_restarts=20),
    "segmentation": ServiceSpec("services.segmentation", most_restarts=20),
    "viewer": ServiceSpec("services.viewer", most_restarts=20),
    "recorder": ServiceSpec("services.recorder", most_restarts=5, stop_s=60.0),  # it may be writing results
}


_Process: TypeAlias = "subprocess.Popen[bytes] | Forked"
_STARTS_LOG = "starts.log"
"""Kept only if it is not empty."""


@dataclass
class _Running:
    name: str
    arguments: list[str]
    log_path: Path
    process: _Process
    started_s: float = field(default_factory=time.monotonic)


def fork_server(kinds: Iterable[str], log_folder: Path) -> ForkServer | None:
    """A server that starts services of some kinds, the caller's to close; None where the system cannot
    fork."""
    if not can_fork():
        return None
    modules = [SERVICES[kind].module for kind in kinds]
    return ForkServer(modules, _own_environment(), log_folder / _STARTS_LOG)


class Launcher:
    """A context manager that leaves no process behind."""

    def __init__(
        self, log_folder: Path, kinds: Iterable[str] = SERVICES, forks: ForkServer | None = None
    ) -> None:
        """kinds: those that will be started. forks: starts them in place of a server of the launcher's own,
        unless it has ended; it imports the modules of these kinds."""
        self._log_folder, self._kinds = log_folder, kinds
        self._running: list[_Running] = []
        self._restarts: Counter[str] = Counter()
        self._told: set[str] = set()
        self._forks = forks
        self._own_forks: ForkServer | None = None

    def __enter__(self) -> Self:
        if self._forks is None or not self._forks.is_running:
            self._forks = self._own_forks = fork_server(self._kinds, self._log_folder)
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        if self._own_forks is not None:
            self._own_forks.close()
        elif self._forks is not None:
            self._forks.keep_log(self._log_folder)

    def start(self, name: str, *arguments: str, copies: int = 1) -> None:
        """Start processes of a kind; each logs to a file of its own."""
        for _ in range(copies):
            log_path = self._log_folder / f"{name}-{len(self._running)}.log"
            process = self._spawn(name, list(arguments), log_path)
            self._running.append(_Running(name, list(arguments), log_path, process))

    def _spawn(self, name: str, arguments: list[str], log_path: Path) -> _Process:
        """A process in its own session: Ctrl-C reaches only the launcher, which stops all services
        cleanly."""
        module = SERVICES[name].module
        if self._forks is not None:
            return self._forks.start(Birth(module, arguments, str(log_path)))
        with log_path.open("ab") as log_file:
            return subprocess.Popen(  # noqa: S603  (our own modules)
                [sys.executable, "-m", module, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log_file,
                stderr=log_file,
                env={**_own_environment(), PARENT_VARIABLE: str(os.getpid())},
                start_new_session=True,
            )

    def _of(self, name: str) -> list[_Running]:
        return [running for running in self._running if running.name == name]

    def pids(self, name: str) -> list[int]:
        """Process ids of a kind's living processes."""
        return [running.process.pid for running in self._of(name) if running.process.poll() is None]

    def has_ended(self, name: str) -> bool:
        """Whether no process of a kind is left."""
        return not self.pids(name)

    def is_done(self, name: str) -> bool:
        """Whether all processes of a kind have ended without an error."""
        ours = self._of(name)
        return bool(ours) and all(self._ended_well(running) for running in ours)

    def _ended_well(self, running: _Running) -> bool:
        code = running.process.poll()
        return code == 0 or (running.name in self._told and code in _ORDERLY)

    def up_s(self, name: str) -> float:
        """How long ago the latest process of a kind was started."""
        return time.monotonic() - max(running.started_s for running in self._of(name))

    def watch(self, over: Collection[str] = ()) -> None:
        """Restart each process that has died; over: kinds that have finished their work.

        Raises UserError with a service's own sentence, or ServiceFailedError for a service that keeps dying.
        """
        for running in self._running:
            code, name = running.process.poll(), running.name
            if code is None or self._ended_well(running):
                continue
            last = last_line(running.log_path)
            if code == EXIT_USER_ERROR:
                raise UserError(last)
            if name in over:
                continue
            self._restarts[name] += 1
            if self._restarts[name] > SERVICES[name].most_restarts:
                after = f"after {SERVICES[name].most_restarts} restarts (exit code {code})"
                raise ServiceFailedError(f"{name} crashed again {after}: {last}")
            log.warning("%s ended with code %d: starting another; it said: %s", name, code, last)
            self._told.discard(name)
            running.process = self._spawn(name, running.arguments, running.log_path)
            running.started_s = time.monotonic()

    def tell_to_stop(self, name: str) -> None:
        """Tell a kind's processes to stop, once."""
        if name not in self._told:
            self._told.add(name)
            for running in self._of(name):
                running.process.send_signal(signal.SIGTERM)

    def warnings(self, name: str) -> list[str]:
        """Warnings of a kind's processes, one sentence each, without time and name."""
        lines = [line for running in self._of(name) for line in lines_of(running.log_path)]
        return [line.partition(" WARNING ")[2] for line in lines if " WARNING " in line]

    def stop(self) -> None:
        """End all processes: SIGTERM, a short wait, SIGTERM again for those still working, SIGKILL."""
        self._told |= set(SERVICES)
        for _ in range(2):
            for running in self._running:
                running.process.send_signal(signal.SIGTERM)
            self._wait(lambda _: _STOP_S)
        self._wait(lambda spec: spec.stop_s)
        for running in self._running:
            running.process.send_signal(signal.SIGKILL)
            running.process.wait()

    def _wait(self, patience_s: Callable[[ServiceSpec], float]) -> None:
        """Wait for all processes, each as long as its kind allows."""
        began = time.monotonic()
        for running in self._running:
            left_s = began + patience_s(SERVICES[running.name]) - time.monotonic()
            with suppress(subprocess.TimeoutExpired):
                running.process.wait(max(left_s, 0.01))


def _own_environment() -> dict[str, str]:
    """This process's, without settings for services on several machines, which do not apply on loopback."""
    left_out = (KEYS_VARIABLE, METRICS_VARIABLE, logs.VARIABLE)
    return {name: value for name, value in os.environ.items() if name not in left_out}


def free_endpoint() -> str:
    """A loopback endpoint whose ports are free at this moment."""
    return f"tcp://127.0.0.1:{free_port(_PORTS)}"


def free_port(ports: int = 1) -> int:
    """The first of so many ports in a row that are free on loopback at this moment."""
    for _ in range(100):
        port = _LOWEST_PORT + secrets.randbelow(_HIGHEST_PORT - _LOWEST_PORT)
        with suppress(OSError):
            for k in range(ports):
                with socket.socket() as probe:
                    probe.bind(("127.0.0.1", port + k))
            return port
    raise ServiceFailedError(f"no {ports} free ports in a row on 127.0.0.1")
